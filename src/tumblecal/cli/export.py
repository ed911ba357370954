"""`tumblecal export`: a calibration for devices and other programs."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

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
    at: float | None = None,
    table_step: float | None = None,
    noise: Path | None = None,
    run_time: str | None = None,
    use_anyway: Annotated[bool, Parameter(negative=())] = False,
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
    from tumblecal.data.calibration_terms import undetermined_words
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.data.result_records import read_checked
    from tumblecal.data.sensor_parameters import SENSOR
    from tumblecal.devices import TARGETS, Export, losses
    from tumblecal.ground.atomic import writable_file, write_text
    from tumblecal.ground.errors import InputError

    if quiet and out is None:
        raise InputError("--quiet prints nothing, so the export would be lost; add --out")
    target, whole = TARGETS[to], read_checked(calibration)
    whole.use.require(calibration, anyway=use_anyway)
    one_g = _one_g(calibration, whole, gravity)
    protect_inputs([calibration, noise], out=out)
    measured = _measured(whole)
    span = measured if temperatures is None else _span(temperatures)
    _require_choice(at, table_step, span)
    part = target.carried(whole, span, at)
    run_s = None if run_time is None else _run_time(run_time)
    noises = () if noise is None else _noise(noise)
    bare = Export(part, one_g.value_ms2, _about(calibration, whole), span, noises, run_s, at, table_step)
    lost = losses(target, bare, whole, target.write(bare))
    notes = [f"lost: {loss}" for loss in lost] or ["nothing of this calibration is lost"]
    notes += filter(None, [undetermined_words(whole.terms)])
    notes.append(f"use: {whole.use.words}")
    notes += losses_words(whole.not_applied)
    notes += _extrapolated(whole, span, measured)
    notes += target.notes
    if undetermined := whole.sensor.of(SENSOR).undetermined_words:
        notes.append(f"the data did not determine {undetermined}")
    if gravity is not None and whole.gravity:
        notes.append(f"one g is {one_g}, as in the calibration")
    if one_g.assumed and to not in ("c-header", "csv"):
        notes.append(f"one g is {one_g}: {'calibrate again' if whole.gravity else 'state it'} with --gravity")
    text = target.write(replace(bare, header=(*bare.header, target.words, *notes)))
    if out is None:
        print(text, end="")
    else:
        writable_file(out)
        write_text(out, text)
        print(f"{out}: {target.words}")
    if run_time is not None and not any(term.per_hour for term in whole.terms):
        notes.append(f"--run-time {run_time}: no effect, because this calibration has no drift terms")
    if at is not None and "temperature_degc" not in whole.columns_needed:
        notes.append(f"--at {at:g}: no effect, because nothing in this calibration depends on temperature")
    given = {"gravity": gravity, "temperatures": temperatures, "noise": noise, "table-step": table_step}
    for line in [
        *notes,
        *_without_effect(target, bare, {name: text for name, text in given.items() if text is not None}),
    ]:
        print(line, file=sys.stderr if out is None else sys.stdout)


def _measured(whole: "Calibration") -> tuple[float, float] | None:
    """The range of temperature (degC) of the data of curves or thermal terms; None without them, or if it is not stated."""
    if whole.temperature is not None:
        return whole.temperature.range_degc
    match whole.provenance.get("temperature_range_degc"):
        case [float() | int() as low, float() | int() as high] if low < high and any(t.thermal for t in whole.terms):
            return float(low), float(high)
    return None


def _extrapolated(
    whole: "Calibration", span: tuple[float, float] | None, measured: tuple[float, float] | None
) -> Iterator[str]:
    """A note, if the temperature range exceeds that of the data."""
    if span and measured and "temperature_degc" in whole.columns_needed:
        low, high = measured
        if span[0] < low or span[1] > high:
            yield (
                f"the data cover {low:.4g} to {high:.4g} degC: in the rest of {span[0]:g} to {span[1]:g} degC the "
                "dependence on temperature is extrapolated"
            )


def _one_g(path: Path, whole: "Calibration", gravity: str | None) -> "Gravity":
    """One g of a calibration: that of the calibration, then of `--gravity`, then standard gravity.

    **Raises:** `InputError` if the option contradicts the calibration, because it would change the bias in m/s^2.
    """
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.gravity import SAME_MS2, STANDARD, gravity_of_option

    stated = None if gravity is None else gravity_of_option(gravity)
    calibrated = whole.gravity
    if calibrated is None or stated is None:
        return calibrated or stated or STANDARD
    if abs(stated.value_ms2 - calibrated.value_ms2) > SAME_MS2:
        cure = "calibrate again with --gravity" if calibrated.assumed else "remove this option"
        raise InputError(
            f"--gravity {gravity}: one g of {path} is {calibrated} at every site, and its bias in m/s^2 depends on that; {cure}"
        )
    return calibrated


def _without_effect(target: "Target", export: "Export", given: dict[str, object]) -> Iterator[str]:
    """Notes on options that do not change the file."""
    text = target.write(export)
    without = {
        "gravity": replace(export, gravity_ms2=export.gravity_ms2 * 1.001),
        "temperatures": replace(export, temperatures_degc=None),
        "noise": replace(export, noise=()),
        "table-step": replace(export, table_step_degc=None),
    }
    for name, value in given.items():
        if target.write(without[name]) == text:
            yield f"--{name} {value}: no effect on the export of this calibration to {target.name}"


def _about(path: Path, whole: "Calibration") -> tuple[str, ...]:
    from tumblecal import __version__

    date, serial = whole.provenance.get("date_utc"), whole.serial_number
    of = f"{f'serial number {serial}, ' if serial else ''}{path.name}{f' of {date}' if date else ''}"
    return (f"tumblecal {__version__}: calibration of {of}",)


def _run_time(text: str) -> float:
    """The time of `--run-time`, s.

    **Raises:** `InputError` for a text that is not a time above 0.
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
    """The range of `--temperatures`, degC.

    **Raises:** `InputError` for a text that is not a range.
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


def _require_choice(at: float | None, table_step: float | None, span: tuple[float, float] | None) -> None:
    """Check `--at` and `--table-step`.

    **Raises:** `InputError` for a temperature that is outside the range, or a step that is not above 0.
    """
    from tumblecal.ground.errors import InputError

    if at is not None and span is not None and not span[0] <= at <= span[1]:
        raise InputError(f"--at {at:g}: outside the range of {span[0]:.4g} to {span[1]:.4g} degC; widen --temperatures")
    if table_step is not None and not 0 < table_step < float("inf"):
        raise InputError(f"--table-step {table_step:g}: must be above 0 degC")


def _noise(path: Path) -> tuple[dict[str, float], ...]:
    """The noise coefficients of the axes in a reduction.

    **Raises:** `InputError` for a file that is not a reduction.
    """
    from tumblecal.ground.axes import AXES
    from tumblecal.ground.errors import InputError
    from tumblecal.ground.json_file import read_json
    from tumblecal.ground.strict_json import Size, validated

    try:
        content: Any = read_json(path)
        axes = [content["axes"][axis]["noise"] for axis in AXES]
        sizes = tuple({key: axis[key] for key in ("white_g_per_rthz", "walk_g_per_rts")} for axis in axes)
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: no noise of three axes; give the reduction.json of tumblecal reduce") from error
    validated(sizes, tuple[dict[str, Size], ...], str(path), "noise")
    return sizes
