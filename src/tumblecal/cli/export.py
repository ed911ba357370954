"""`tumblecal export`: a calibration for devices and other programs."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter


if TYPE_CHECKING:
    from tumblecal.data.calibration import Calibration

Format = Literal[
    "c-header", "json", "csv", "matlab", "px4", "ardupilot", "kalibr", "imu_tk", "imucal", "ros", "vectornav"
]


def export(
    calibration: Path,
    /,
    *,
    to: Annotated[Format, Parameter(name="--to")],
    out: Path | None = None,
    gravity: Annotated[str | None, Parameter(show_default=False)] = None,
    temperatures: str | None = None,
    noise: Path | None = None,
) -> None:
    """Write a calibration as a device or another program takes it, and say in mg what its format cannot carry.

    Parameters
    ----------
    calibration
        The calibration.json that calibrate or diagnose wrote.
    to
        The target; docs/devices.md has the formula of each.
    out
        The file to write; printed where left out, and what is said goes to stderr.
    gravity
        What one g is where the target counts in m/s^2: m/s^2 or a site (lat=48.14,height=520). Without it, that of the
        calibration.
    temperatures
        Range (degC) in which thermal terms of the bias hold, such as 0:60: px4 and ardupilot carry them within it.
    noise
        The reduction.json of tumblecal reduce: noise density and walk for kalibr.
    """
    from tumblecal.data.calibration import read_calibration
    from tumblecal.data.calibration_extended import columns_needed
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.devices import TARGETS, Export, losses
    from tumblecal.ground.atomic import writable_folder, write_text
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.gravity import STANDARD, gravity_of_option

    target, whole = TARGETS[to], read_calibration(calibration)
    if "time_s" in columns_needed(whole):
        raise InputError(
            f"{calibration}: has drift terms (per_hour), which no target carries; leave them out to export it"
        )
    one_g = whole.gravity or STANDARD if gravity is None else gravity_of_option(gravity)
    inputs_kept([calibration, noise], out=out)
    span = None if temperatures is None else _span(temperatures)
    part = target.carried(whole, ranged=span is not None)
    bare = Export(part, one_g.value_ms2, _about(calibration, whole), span, () if noise is None else _noise(noise))
    lost = losses(target, bare, whole, target.write(bare))
    said = [f"lost: {loss}" for loss in lost] or ["nothing of this calibration is lost"]
    said += target.notes
    if one_g.assumed and to not in ("c-header", "csv"):
        said.append(f"one g is {one_g}: state it with --gravity")
    text = target.write(Export(part, one_g.value_ms2, (*bare.header, target.words, *said), span, bare.noise))
    if out is None:
        print(text, end="")
    else:
        writable_folder(out.parent)
        write_text(out, text)
        print(f"{out}: {target.words}")
    for line in said:
        print(line, file=sys.stderr if out is None else sys.stdout)


def _about(path: Path, whole: "Calibration") -> tuple[str, ...]:
    from tumblecal import __version__

    date, serial = whole.provenance.get("date_utc"), whole.serial_number
    of = f"{f'serial number {serial}, ' if serial else ''}{path.name}{f' of {date}' if date else ''}"
    return (f"tumblecal {__version__}: calibration of {of}",)


def _span(text: str) -> tuple[float, float]:
    """The range of `--temperatures`.

    **Raises:** `InputError` for a text that is none.
    """
    from tumblecal.ground.errors import InputError

    low, colon, high = text.partition(":")
    try:
        span = float(low), float(high)
    except ValueError:
        span = (0.0, 0.0)
    if not colon or not -100 <= span[0] < span[1] <= 200:
        raise InputError(f"--temperatures {text}: write LOW:HIGH in degC, such as 0:60")
    return span


def _noise(path: Path) -> tuple[dict[str, float], ...]:
    """The noise coefficients of the axes in a reduction.

    **Raises:** `InputError` for a file that is none.
    """
    import json

    from tumblecal.data.calibration import is_number
    from tumblecal.ground.axes import AXES
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.text_file import read_text

    try:
        axes = [json.loads(read_text(path, "JSON"))["axes"][axis]["noise"] for axis in AXES]
        sizes = tuple({key: axis[key] for key in ("white_g_per_rthz", "walk_g_per_rts")} for axis in axes)
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(
            f"{path}: no noise of three axes in it; give the reduction.json of tumblecal reduce"
        ) from error
    if not all(is_number(value) and value >= 0 for axis in sizes for value in axis.values()):
        raise InputError(f"{path}: noise: sizes must be numbers, not below 0")
    return sizes
