"""`tumblecal capture`: the guided measurement."""

import contextlib
from pathlib import Path

from tumblecal.cli.capture_options import ChamberOptions, OperatorOptions
from tumblecal.cli.terminal import warn
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import EVERY, suggested


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
            run.plan = run_folder.with_temperatures(run.plan, **run.journal.state.temperature_options | given)
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
