"""`tumblecal capture`: the guided measurement."""

import contextlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from tumblecal.cli.output import warn
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import EVERY, suggested


if TYPE_CHECKING:
    from tumblecal.capture.capture_plan import CapturePlan
    from tumblecal.capture.run.run_folder import RunFolder


_LONGEST_WAIT_S = 86400.0


@Parameter(name="*")
@dataclass(frozen=True)
class OperatorOptions:
    """Dialogue with the operator.

    Parameters
    ----------
    wait
        Seconds to wait for a port that is not available yet. Example: --wait 60.
    estimate
        Display of the parameters and their standard uncertainties after each position. Example: --no-estimate.
    plain
        Printed lines instead of a redrawn screen. Example: --plain.
    yes
        With --resume: confirmation that the instrument has not been remounted. Example: --resume run1 --yes.
    trust_instrument
        With --resume: confirmation that an instrument that does not state its serial number is the same one. Example:
        --resume run1 --trust-instrument.
    """

    wait: float = 30.0
    estimate: bool = True
    plain: bool = False
    yes: bool = False
    trust_instrument: bool = False

    def still_mounted(self) -> bool:
        """Whether the operator confirms that the instrument was not remounted."""
        if self.yes:
            return True
        answer = input("Is the instrument still in its fixture, without a remount? [y/n] ")
        return answer.strip().lower().startswith("y")


@Parameter(name="*")
@dataclass(frozen=True)
class ChamberOptions:
    """Temperatures of the plan; the default is the table [soak] or [chamber] of the plan. --resume keeps them.

    Parameters
    ----------
    chamber
        Port of the temperature chamber, with the commands of the plan; "operator": the operator sets it. Example: --chamber
        /dev/ttyUSB1.
    soak_tolerance
        Largest distance of the sensor's temperature to the requested one, degC. Example: --soak-tolerance 2.
    soak_rate
        Largest rate of a stable temperature, degC/min. Example: --soak-rate 0.05.
    soak_minutes
        Time for which the temperature must be stable, min. Example: --soak-minutes 20.
    soak_timeout
        Longest wait for a stable temperature, min. Example: --soak-timeout 300.
    """

    chamber: str | None = None
    soak_tolerance: float | None = None
    soak_rate: float | None = None
    soak_minutes: float | None = None
    soak_timeout: float | None = None

    def applied(self, plan: "CapturePlan") -> "CapturePlan":
        """The plan with these options.

        **Raises:** `InputError` for a value that is not above 0, or for options that the plan does not need.
        """
        from tumblecal.capture.chamber.soak import OPERATOR

        criterion = {
            "tolerance_degc": self.soak_tolerance,
            "rate_degc_per_min": self.soak_rate,
            "stable_min": self.soak_minutes,
            "timeout_min": self.soak_timeout,
        }
        stated = {key: value for key, value in criterion.items() if value is not None}
        if (stated or self.chamber is not None) and not plan.over_temperature:
            raise InputError(
                "capture: the plan requests no temperature; remove --chamber and --soak-..., or add positions.temperature_degc"
            )
        for key, value in stated.items():
            if not 0 < value < float("inf"):
                raise InputError(f"capture: {key} {value:g}: must be a number above 0")
        chamber = plan.chamber
        if self.chamber is not None:
            chamber = chamber.model_copy(update={"url": "" if self.chamber == OPERATOR else self.chamber})
        return plan.model_copy(update={"soak": plan.soak.model_copy(update=stated), "chamber": chamber})


def capture(
    plan: Path | None = None,
    /,
    *,
    out: Path | None = None,
    resume: Path | None = None,
    port: str | None = None,
    operator: OperatorOptions = OperatorOptions(),
    temperature: ChamberOptions = ChamberOptions(),
) -> None:
    """Record the positions of a plan with the instrument on the dividing head, including every received byte.

    The screen shows the angles to set; recording starts when the head is at rest at these angles. A plan with temperatures
    also sets a chamber, or requests them from the operator, and waits until they are stable. Stop at any time (q, Ctrl-C,
    power cut) and continue with --resume. Next: tumblecal reduce DIR.

    Parameters
    ----------
    plan
        Plan file (TOML), such as configs/capture_demo.toml.
    out
        Folder of the capture; created if missing. Example: --out run1.
    resume
        Folder of an interrupted capture, to continue it; given without a plan. Example: --resume run1.
    port
        Serial port. Default: the port of the plan. Example: --port /dev/ttyUSB0.
    """
    from tumblecal.capture.run.session import capture as run
    from tumblecal.capture.run.stop_signals import Stopped
    from tumblecal.cli.interrupts import end_by
    from tumblecal.cli.live_estimate import live_estimate

    if not 0 <= operator.wait <= _LONGEST_WAIT_S:
        raise InputError(f"--wait {operator.wait:g}: seconds, from 0 to {_LONGEST_WAIT_S:g}")
    stopped_by = None
    with _run_folder(plan, out, resume, port) as run_folder:
        if resume is not None and run_folder.complete:
            print(_end(run_folder))
            return
        given = {name: value for name, value in vars(temperature).items() if value is not None}
        temperature = ChamberOptions(**(run_folder.journal.state.temperature_options | given))
        run_folder.plan = temperature.applied(run_folder.plan)
        if given:
            run_folder.journal.write("temperature_options", options=given)
        live = live_estimate(run_folder.plan) if operator.estimate else None
        try:
            how = {"plain": operator.plain, "wait_s": operator.wait, "trust": operator.trust_instrument}
            run(run_folder, estimate=live, confirm=operator.still_mounted, **how)
        except Stopped as stop:
            stopped_by = stop.number
    folder = run_folder.folder
    with contextlib.suppress(OSError):  # the terminal may be gone
        if run_folder.complete:
            print(_end(run_folder))
        else:
            print(
                f"{folder}: stopped with {_done(run_folder)}; continue with: {suggested('capture', '--resume', folder)}"
            )
        sys.stdout.flush()
    if stopped_by is not None:
        end_by(stopped_by)


def _end(run: "RunFolder") -> str:
    """The last line of a complete run."""
    reduced = suggested("reduce", run.folder, less=EVERY)
    return f"{run.folder}: all {len(run.plan.steps)} positions are recorded; next: {reduced}"


def _done(run: "RunFolder") -> str:
    return f"{len(run.journal.state.accepted)} of {len(run.plan.steps)} positions"


def _run_folder(plan: Path | None, out: Path | None, resume: Path | None, port: str | None) -> "RunFolder":
    """The folder of the run, new or resumed.

    **Raises:** `InputError` for options that contradict each other, or a folder that another process uses.
    """
    from tumblecal.capture.run.run_folder import begin
    from tumblecal.capture.run.run_folder import resume as resume_run

    if (plan is None) == (resume is None):
        raise InputError("capture: give either a plan with --out DIR, or --resume DIR")
    if resume is not None:
        if out is not None:
            raise InputError("capture: --out contradicts --resume, which continues in its folder; remove --out")
        resumed = resume_run(resume, port)
        warn(resume, resumed.journal.damage)
        if not resumed.complete:
            print(f"{resume}: {_done(resumed)} done")
        return resumed
    assert plan is not None
    if out is None:
        raise InputError("capture: no folder for the data; add --out DIR")
    return begin(plan, out, port)
