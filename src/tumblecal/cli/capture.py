"""`tumblecal capture`: the guided run."""

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
    from tumblecal.capture.run_folder import RunFolder


_END = "{folder}: all {total} positions are recorded; now: {reduce}"
_LONGEST_WAIT_S = 86400.0


@Parameter(name="*")
@dataclass(frozen=True)
class Sitting:
    """How the operator goes through the run.

    Parameters
    ----------
    wait
        Seconds to wait for a port that is not there yet.
    estimate
        Show the parameters with their sd as positions come in.
    plain
        Print lines instead of redrawing the screen.
    yes
        On resuming, take it that the instrument is still mounted as it was.
    trust_instrument
        Go on with an instrument that does not state its serial number, without a comparison at a finished position.
    """

    wait: float = 30.0
    estimate: bool = True
    plain: bool = False
    yes: bool = False
    trust_instrument: bool = False

    def still_mounted(self) -> bool:
        """Whether the operator says so."""
        if self.yes:
            return True
        answer = input("Is the instrument still mounted, and was it not taken off the fixture? [y/n] ")
        return answer.strip().lower().startswith("y")


def capture(
    plan: Path | None = None,
    /,
    *,
    out: Path | None = None,
    resume: Path | None = None,
    port: str | None = None,
    sitting: Sitting = Sitting(),
) -> None:
    """Walk through a plan of positions with the instrument on the dividing head, and record every byte.

    The screen says where to turn the head; recording begins by itself when the head is there and still. Stop at any
    time (q, Ctrl-C, power cut) and go on with --resume. Then: tumblecal reduce DIR.

    Parameters
    ----------
    plan
        The plan, a TOML file such as configs/capture_demo.toml.
    out
        Folder for the capture; made if it is not there.
    resume
        Folder of a capture that was stopped: go on with it (no plan is given then).
    port
        The serial port, in place of the plan's.
    """
    from tumblecal.capture.session import capture as run
    from tumblecal.capture.stop_signals import Stopped
    from tumblecal.cli.interrupts import end_by

    if not 0 <= sitting.wait <= _LONGEST_WAIT_S:
        raise InputError(f"--wait {sitting.wait:g}: seconds, from 0 to {_LONGEST_WAIT_S:g}")
    stopped_by = None
    with _held(plan, out, resume, port) as held:
        if resume is not None and len(held.standing.accepted) == len(held.plan.steps):
            print(
                _END.format(folder=resume, total=len(held.plan.steps), reduce=suggested("reduce", resume, less=EVERY))
            )
            return
        live = _live_estimate(held.plan) if sitting.estimate else None
        try:
            how = {"plain": sitting.plain, "wait_s": sitting.wait, "trust": sitting.trust_instrument}
            run(held, estimate=live, confirm=sitting.still_mounted, **how)
        except Stopped as stop:
            stopped_by = stop.number
    folder, done, total = held.folder, len(held.standing.accepted), len(held.plan.steps)
    with contextlib.suppress(OSError):  # the terminal may be gone
        if done < total:
            resumed = suggested("capture", "--resume", folder)
            print(f"{folder}: stopped with {done} of {total} positions; go on with: {resumed}")
        else:
            print(_END.format(folder=folder, total=total, reduce=suggested("reduce", folder, less=EVERY)))
        sys.stdout.flush()
    if stopped_by is not None:
        end_by(stopped_by)


def _held(plan: Path | None, out: Path | None, resume: Path | None, port: str | None) -> "RunFolder":
    """The folder of the run, begun or taken up again.

    **Raises:** `InputError` for options that do not go together, or a folder that cannot be held.
    """
    from tumblecal.capture.run_folder import begin
    from tumblecal.capture.run_folder import resume as take_up

    if (plan is None) == (resume is None):
        raise InputError("capture: give either a plan and --out DIR, or --resume DIR")
    if resume is not None:
        if out is not None:
            raise InputError("capture: --out does not go with --resume; the folder is the one being resumed")
        held = take_up(resume, port)
        warn(resume, held.damage)
        if (done := len(held.standing.accepted)) < (total := len(held.plan.steps)):
            print(f"{resume}: {done} of {total} positions done")
        return held
    assert plan is not None
    if out is None:
        raise InputError("capture: give a folder for the data with --out DIR")
    return begin(plan, out, port)


def _live_estimate(plan):
    """The iterated Kalman filter over the exact chain; its imports wait until the first position is accepted."""
    state: dict = {}

    def estimate(rows):
        if "problem" not in state:
            state["problem"] = _problem(plan)
        if len(rows) < 3:
            return []
        return _filtered(state["problem"], plan, rows)

    return estimate


def _problem(plan):
    import numpy as np

    from tumblecal.cli.start import start

    start()
    from tumblecal.data.positions import PositionSet
    from tumblecal.estimation.problem import default_chain, problem_of

    steps = plan.steps
    data = PositionSet(
        names=tuple(step.name for step in steps),
        alpha_deg=np.array([step.alpha_deg for step in steps], float),
        beta_deg=np.array([step.beta_deg for step in steps], float),
        readings=np.array([plan.expected(k) for k in range(len(steps))]),
        sd=np.full((len(steps), 3), 1e-4),
    )
    return problem_of(data, default_chain(data))


# What is known of every parameter before the first position (1, g, rad), and the least sd of a reading that the
# nominal model deserves while effects are still unknown.
_PRIOR_SD, _LEAST_SD_G = 0.005, 1e-4
_SHOWN = {"1": (1e3, "1e-3"), "g": (1e3, "mg"), "rad": (1e3, "mrad")}


def _filtered(problem, plan, rows):
    import numpy as np

    from tumblecal.estimation.iterated import Filter
    from tumblecal.estimation.kalman import Prior

    positions = {(s.alpha_deg, s.beta_deg): k for k, s in enumerate(plan.steps)}
    running = Filter(problem, Prior(sd=_PRIOR_SD))
    for alpha, beta, mean, sd in rows:
        running.take(positions[alpha, beta], mean, np.maximum(sd, _LEAST_SD_G))
    deviations = np.sqrt(np.diag(running.covariance))
    table = []
    for name, unit, value, sd in zip(problem.chain.names, problem.chain.units, running.mean, deviations, strict=True):
        if sd > _PRIOR_SD / 2:
            continue  # nothing has been learned about it yet
        factor, shown = _SHOWN.get(unit, (1.0, unit))
        table.append((name, float(value) * factor, float(sd) * factor, shown))
    return table
