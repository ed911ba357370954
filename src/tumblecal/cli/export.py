"""`tumblecal export`: a calibration for devices and other programs."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from tumblecal.cli.options import Positive, Quiet
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.data.calibration import Calibration
    from tumblecal.devices import Export
    from tumblecal.devices.target import Target
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
    from tumblecal import __version__
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.data.result_records import noise_of_reduction, read_checked
    from tumblecal.devices import TARGETS, Export
    from tumblecal.ground.atomic import writable_file, write_text
    from tumblecal.ground.option_texts import size

    if quiet and out is None:
        raise InputError("--quiet prints nothing, so the export would be lost; add --out")
    target, whole = TARGETS[to], read_checked(calibration)
    whole.use.require(calibration, anyway=use_anyway)
    one_g = _one_g(calibration, whole, gravity)
    protect_inputs([calibration, noise], out=out)
    span = _span(whole, temperatures, at)
    date, serial = whole.provenance.get("date_utc"), whole.serial_number
    of = f"{f'serial number {serial}, ' if serial else ''}{calibration.name}{f' of {date}' if date else ''}"
    header, noises = f"tumblecal {__version__}: calibration of {of}", noise_of_reduction(noise) if noise else ()
    run_s = None if run_time is None else size("--run-time", run_time, "s")
    bare = Export(target.carried(whole, span, at), one_g.value_ms2, (header,), span, noises, run_s, at, table_step)
    notes = [*_notes(whole, target, bare)]
    if gravity is not None and whole.gravity:
        notes.append(f"one g is {one_g}, as in the calibration")
    if one_g.assumed and to not in ("c-header", "csv"):
        notes.append(f"one g is {one_g}: {'calibrate again' if whole.gravity else 'state it'} with --gravity")
    text = target.write(replace(bare, header=(header, target.words, *notes)))
    if out is None:
        print(text, end="")
    else:
        writable_file(out)
        write_text(out, text)
        print(f"{out}: {target.words}")
    # The content without an option is written to see whether the option has an effect.
    without = {
        "gravity": (gravity, replace(bare, gravity_ms2=one_g.value_ms2 * 1.001)),
        "temperatures": (temperatures, replace(bare, temperatures_degc=None)),
        "noise": (noise, replace(bare, noise=())),
        "table-step": (table_step, replace(bare, table_step_degc=None)),
        "run-time": (run_time, bare if not any(term.per_hour for term in whole.terms) else None),
        "at": (at, None if "temperature_degc" in whole.columns_needed else bare),
    }
    for name, (value, other) in without.items():
        if value is not None and other is not None and target.write(other) == target.write(bare):
            notes.append(f"--{name} {value}: no effect on the export of this calibration to {to}")
    print("\n".join(notes), file=sys.stderr if out is None else sys.stdout)


def _notes(whole: "Calibration", target: "Target", bare: "Export") -> Iterator[str]:
    """Losses of the format, use of the calibration, and limits of both."""
    from tumblecal.data.calibration_terms import undetermined_words
    from tumblecal.data.not_applied import use_lines
    from tumblecal.data.sensor_parameters import SENSOR
    from tumblecal.devices import losses

    lost = [f"lost: {loss}" for loss in losses(target, bare, whole, target.write(bare))]
    yield from lost or ["nothing of this calibration is lost"]
    yield from filter(None, [undetermined_words(whole.terms), *use_lines(whole)])
    span, measured = bare.temperatures_degc, _measured(whole)
    if span and measured and (span[0] < measured[0] or span[1] > measured[1]):
        yield (
            f"the data cover {measured[0]:.4g} to {measured[1]:.4g} degC: in the rest of {span[0]:g} to {span[1]:g} degC the "
            "dependence on temperature is extrapolated"
        )
    yield from filter(None, target.notes)
    if undetermined := whole.sensor.of(SENSOR).undetermined_words:
        yield f"the data did not determine {undetermined}"


def _measured(whole: "Calibration") -> tuple[float, float] | None:
    """The range of temperature (degC) of the data of curves or thermal terms; None without them, or if it is not stated."""
    if whole.temperature is not None:
        return whole.temperature.range_degc
    low, high = whole.provenance.get("temperature_range_degc") or (0.0, 0.0)
    return (low, high) if low < high and any(term.thermal for term in whole.terms) else None


def _one_g(path: Path, whole: "Calibration", gravity: str | None) -> "Gravity":
    """One g of a calibration: that of the calibration, then of `--gravity`, then standard gravity.

    **Raises:** `InputError` if the option contradicts the calibration, because it would change the bias in m/s^2.
    """
    from tumblecal.ground.gravity import SAME_MS2, STANDARD, gravity_of_option

    stated, calibrated = None if gravity is None else gravity_of_option(gravity), whole.gravity
    if stated and calibrated and abs(stated.value_ms2 - calibrated.value_ms2) > SAME_MS2:
        cure = "calibrate again with --gravity" if calibrated.assumed else "remove this option"
        raise InputError(
            f"--gravity {gravity}: one g of {path} is {calibrated} at every site, and its bias in m/s^2 depends on that; {cure}"
        )
    return calibrated or stated or STANDARD


def _span(whole: "Calibration", temperatures: str | None, at: float | None) -> tuple[float, float] | None:
    """The range of `--temperatures`, degC, otherwise that of the data.

    **Raises:** `InputError` for a text that is not a range, and if `--at` is outside.
    """
    from tumblecal.ground.option_texts import numbers

    span = _measured(whole)
    if temperatures is not None:
        low, *high = numbers("--temperatures", temperatures, "0:60", ":")
        if len(high) != 1 or not -100 <= low < high[0] <= 200:
            raise InputError(f"--temperatures {temperatures}: write LOW:HIGH in degC, such as 0:60")
        span = low, high[0]
    if at is not None and span is not None and not span[0] <= at <= span[1]:
        raise InputError(f"--at {at:g}: outside the range of {span[0]:.4g} to {span[1]:.4g} degC; widen --temperatures")
    return span
