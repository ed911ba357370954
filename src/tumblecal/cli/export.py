"""`tumblecal export`: a calibration for devices and other programs."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from tumblecal.cli.output import Quiet


if TYPE_CHECKING:
    from tumblecal.data.calibration import Calibration
    from tumblecal.devices import Export, Target
    from tumblecal.ground.gravity import Gravity

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
    run_time: str | None = None,
    use_anyway: Annotated[bool, Parameter(negative=())] = False,
    quiet: Quiet = False,
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
        What one g is where the target counts in m/s^2: m/s^2 or a site (lat=48.14,height=520). For a calibration that does
        not say: where it does, another value is refused.
    temperatures
        Range (degC) in which thermal terms of the bias hold, such as 0:60: px4 and ardupilot carry them within it. Default: the
        range of the calibration data. Losses are stated for this range.
    noise
        The reduction.json of tumblecal reduce: noise density and walk for kalibr.
    run_time
        How long the device runs, such as '8 h': losses of drift terms (`per_hour`) are stated for it. Default: for each hour.
    use_anyway
        Export a calibration whose own judgement is that it must not be used (`use: no`).
    """
    from tumblecal.data.calibration import read_calibration
    from tumblecal.data.calibration_terms import undetermined_words
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.data.sensor_parameters import SENSOR
    from tumblecal.devices import TARGETS, Export, losses
    from tumblecal.ground.atomic import writable_file, write_text
    from tumblecal.ground.errors import InputError

    if quiet and out is None:
        raise InputError("--quiet prints nothing, so that the export would be lost; give --out")
    target, whole = TARGETS[to], read_calibration(calibration)
    whole.use.require(calibration, anyway=use_anyway)
    one_g = _one_g(calibration, whole, gravity)
    inputs_kept([calibration, noise], out=out)
    measured = _measured(whole)
    span = measured if temperatures is None else _span(temperatures)
    part = target.carried(whole, span)
    run_s = None if run_time is None else _run_time(run_time)
    noises = () if noise is None else _noise(noise)
    bare = Export(part, one_g.value_ms2, _about(calibration, whole), span, noises, run_s)
    lost = losses(target, bare, whole, target.write(bare))
    said = [f"lost: {loss}" for loss in lost] or ["nothing of this calibration is lost"]
    said += filter(None, [undetermined_words(whole.terms)])
    said.append(f"use: {whole.use.words}")
    said += losses_words(whole.not_applied)
    said += _extrapolated(whole, span, measured)
    said += target.notes
    if left := whole.sensor.of(SENSOR).undetermined_words:
        said.append(f"the data did not determine {left}")
    if gravity is not None and whole.gravity:
        said.append(f"one g is {one_g}, as in the calibration")
    if one_g.assumed and to not in ("c-header", "csv"):
        said.append(f"one g is {one_g}: {'calibrate again' if whole.gravity else 'state it'} with --gravity")
    text = target.write(Export(part, one_g.value_ms2, (*bare.header, target.words, *said), span, bare.noise))
    if out is None:
        print(text, end="")
    else:
        writable_file(out)
        write_text(out, text)
        print(f"{out}: {target.words}")
    if run_time is not None and not any(term.per_hour for term in whole.terms):
        said.append(f"--run-time {run_time}: this calibration has no drift terms, so no loss depends on it")
    given = {"gravity": gravity, "temperatures": temperatures, "noise": noise}
    for line in [
        *said,
        *_without_effect(target, bare, {name: text for name, text in given.items() if text is not None}),
    ]:
        print(line, file=sys.stderr if out is None else sys.stdout)


def _measured(whole: "Calibration") -> tuple[float, float] | None:
    """The range of temperature (degC) in which the thermal terms were measured; None if there are none, or it is not stated."""
    match whole.provenance.get("temperature_range_degc"):
        case [float() | int() as low, float() | int() as high] if low < high and any(t.thermal for t in whole.terms):
            return float(low), float(high)
    return None


def _extrapolated(
    whole: "Calibration", span: tuple[float, float] | None, measured: tuple[float, float] | None
) -> Iterator[str]:
    """That the range of temperature exceeds that of the data, where it does."""
    if span and measured and any(term.thermal for term in whole.terms):
        low, high = measured
        if span[0] < low or span[1] > high:
            yield (
                f"the data cover {low:.4g} to {high:.4g} degC: in the rest of {span[0]:g} to {span[1]:g} degC the thermal "
                "terms are extrapolated"
            )


def _one_g(path: Path, whole: "Calibration", gravity: str | None) -> "Gravity":
    """What one g of a calibration is: its own, else that of `--gravity`, else standard gravity.

    **Raises:** `InputError` where the option says otherwise than the calibration, whose bias in m/s^2 it would change.
    """
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.gravity import SAME_MS2, STANDARD, gravity_of_option

    stated = None if gravity is None else gravity_of_option(gravity)
    own = whole.gravity
    if own is None or stated is None:
        return own or stated or STANDARD
    if abs(stated.value_ms2 - own.value_ms2) > SAME_MS2:
        cure = "calibrate again with --gravity" if own.assumed else "leave it out"
        raise InputError(
            f"--gravity {gravity}: one g of {path} is {own}, wherever the device is used, and its bias in m/s^2 goes by that; "
            f"{cure}"
        )
    return own


def _without_effect(target: "Target", export: "Export", given: dict[str, object]) -> Iterator[str]:
    """Of options that were given those without which the file would be the same."""
    text = target.write(export)
    without = {
        "gravity": replace(export, gravity_ms2=export.gravity_ms2 * 1.001),
        "temperatures": replace(export, temperatures_degc=None),
        "noise": replace(export, noise=()),
    }
    for name, value in given.items():
        if target.write(without[name]) == text:
            yield f"--{name} {value}: nothing that {target.name} takes of this calibration depends on it"


def _about(path: Path, whole: "Calibration") -> tuple[str, ...]:
    from tumblecal import __version__

    date, serial = whole.provenance.get("date_utc"), whole.serial_number
    of = f"{f'serial number {serial}, ' if serial else ''}{path.name}{f' of {date}' if date else ''}"
    return (f"tumblecal {__version__}: calibration of {of}",)


def _run_time(text: str) -> float:
    """The time of `--run-time`, s.

    **Raises:** `InputError` for a text that is none.
    """
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.units import quantity

    try:
        seconds = quantity(text, "s")
    except InputError as error:
        raise InputError(f"--run-time: {error}") from error
    if seconds <= 0:
        raise InputError(f"--run-time {text}: must be above 0")
    return seconds


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

    from tumblecal.data.calibration_parts import is_number
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
