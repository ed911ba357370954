"""`tumblecal export`: a calibration for devices and other programs."""

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from tumblecal.cli.options import Positive, Quiet
from tumblecal.ground.errors import InputError


Format = Literal[
    "c-header", "json", "csv", "matlab", "px4", "ardupilot", "kalibr", "imu_tk", "imucal", "ros", "vectornav"
]


def export(
    calibration: Path,
    /,
    *,
    to: Annotated[Format, Parameter(name="--to")],
    out: Path | None = None,
    gravity: str | None = None,
    temperatures: str | None = None,
    at: float | None = None,
    table_step: Positive | None = None,
    noise: Path | None = None,
    run_time: str | None = None,
    use_anyway: bool = False,
    quiet: Quiet = False,
) -> None:
    """Write a calibration in the format of a device or another program, and report in mg the losses of that format.

    Parameters
    ----------
    calibration
        The calibration.json of calibrate or diagnose.
    to
        Target format; docs/devices.md has the formula of each. Example: --to px4.
    out
        Output file. Default: stdout, with all messages on stderr. Example: --out unit17.params.
    gravity
        Gravity of the calibration, for targets in m/s^2: m/s^2, or a site (lat=48.14,height=520). A value that contradicts the
        calibration is rejected. Default: that of the calibration, or 9.80665. Example: --gravity 9.8123.
    temperatures
        Temperature range (degC) of curves and thermal terms: px4, ardupilot and c-header apply them within it, and losses are
        stated for it. Default: the range of the calibration data. Example: --temperatures 0:60.
    at
        Temperature (degC) of exported constants: for px4 and ardupilot the reference of their polynomials, for other targets
        of all parameters, in place of curves. Default: the reference of the calibration. Example: --at 40.
    table_step
        Step (degC) of a table over temperature that is interpolated linearly, for c-header and csv. Default: polynomials in
        c-header, and 5 degC in csv. Example: --table-step 2.
    noise
        The reduction.json of tumblecal reduce, for noise density and random walk of kalibr. Default: none. Example:
        --noise reduced/reduction.json.
    run_time
        Operating time of the device, for losses of drift terms (`per_hour`). Default: losses for each hour. Example:
        --run-time '8 h'.
    use_anyway
        Export of a calibration with the judgement `use: no`. Default: an error.
    """
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.data.result_records import noise_of_reduction, read_checked
    from tumblecal.devices.exported import exported
    from tumblecal.ground.atomic import writable_file, write_text
    from tumblecal.ground.option_texts import size

    if quiet and out is None:
        raise InputError("--quiet prints nothing, so the export would be lost; add --out")
    whole = read_checked(calibration)
    whole.use.require(calibration, anyway=use_anyway)
    protect_inputs([calibration, noise], out=out)
    text, words, notes = exported(
        whole,
        calibration,
        to,
        gravity=gravity,
        temperatures=temperatures,
        at_degc=at,
        table_step_degc=table_step,
        noise=noise_of_reduction(noise) if noise else (),
        run_s=None if run_time is None else size("--run-time", run_time, "s"),
    )
    if out is None:
        print(text, end="")
    else:
        writable_file(out)
        write_text(out, text)
        print(f"{out}: {words}")
    print("\n".join(notes), file=sys.stderr if out is None else sys.stdout)
