"""`tumblecal capture`: the guided measurement."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.options import options, within
from tumblecal.cli.terminal import warn
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import EVERY, suggested


if TYPE_CHECKING:
    from tumblecal.capture.capture_plan import CapturePlan


@options
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

    wait: Annotated[float, within(gte=0, lte=86400)] = 30.0
    estimate: Annotated[bool, Parameter(negative="--no-estimate")] = True
    plain: bool = False
    yes: bool = False
    trust_instrument: bool = False

    def still_mounted(self) -> bool:
        """Whether the operator confirms that the instrument was not remounted."""
        asked = "Is the instrument still in its fixture, without a remount? [y/n] "
        return self.yes or input(asked).strip().lower().startswith("y")


@options
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
        from tumblecal.capture.capture_plan import SoakTable
        from tumblecal.capture.chamber.soak import OPERATOR
        from tumblecal.ground.strict_toml import checked

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
        soak = checked(Path("--soak-..."), plan.soak.model_dump() | stated, SoakTable)
        url = plan.chamber.url if self.chamber is None else "" if self.chamber == OPERATOR else self.chamber
        return plan.model_copy(update={"soak": soak, "chamber": plan.chamber.model_copy(update={"url": url})})


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
    from tumblecal.capture.run import run_folder
    from tumblecal.capture.run.session import capture as guided
    from tumblecal.capture.run.stop_signals import Stopped
    from tumblecal.cli.endings import end_by
    from tumblecal.cli.live_estimate import live_estimate

    if plan is not None and out is not None and resume is None:
        begun = run_folder.begin(plan, out, port)
    elif resume is not None and plan is out is None:
        begun = run_folder.resume(resume, port)
    else:
        raise InputError("capture: give a plan with --out DIR for a new run, or --resume DIR alone")
    stopped_by = None
    with begun as run:
        accepted, count = run.journal.state.accepted, len(run.plan.steps)
        warn(run.folder, run.journal.damage)
        if not run.complete:
            if resume is not None:
                print(f"{run.folder}: {len(accepted)} of {count} positions done")
            given = {name: value for name, value in vars(temperature).items() if value is not None}
            run.plan = ChamberOptions(**run.journal.state.temperature_options | given).applied(run.plan)
            if given:
                run.journal.write("temperature_options", options=given)
            try:
                guided(
                    run,
                    estimate=live_estimate(run.plan) if operator.estimate else None,
                    confirm=operator.still_mounted,
                    plain=operator.plain,
                    wait_s=operator.wait,
                    trust=operator.trust_instrument,
                )
            except Stopped as stop:
                stopped_by = stop.number
    words = f"all {count} positions are recorded; next: {suggested('reduce', run.folder, less=EVERY)}"
    if not run.complete:
        again = suggested("capture", "--resume", run.folder)
        words = f"stopped with {len(accepted)} of {count} positions; continue with: {again}"
    with contextlib.suppress(OSError):  # the terminal may be gone
        print(f"{run.folder}: {words}", flush=True)
    if stopped_by is not None:
        end_by(stopped_by)
