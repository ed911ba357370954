"""A calibration in the format of a target: its text, the losses of the format, and options without effect."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tumblecal import __version__
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import undetermined_words
from tumblecal.data.not_applied import use_lines
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.devices import TARGETS
from tumblecal.devices.format_losses import losses
from tumblecal.devices.target import Export, Target
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import SAME_MS2, STANDARD, Gravity, gravity_of_option
from tumblecal.ground.option_texts import numbers


def exported(
    whole: Calibration,
    path: Path,
    name: str,
    *,
    gravity: str | None = None,
    temperatures: str | None = None,
    at_degc: float | None = None,
    noise: Sequence[dict[str, float]] = (),
    **options: Any,
) -> tuple[str, str, list[str]]:
    """A calibration in the format of a target.

    **Arguments:**

    - `path`: of the calibration. `name`: of the target. `gravity`: as of `gravity_of_option`. `temperatures`: a range such as
      `0:60`, degC. Others as of `Export`.

    **Returns:** the text, the format in words, and notes for the user.

    **Raises:** `InputError` for options that contradict the calibration or each other, or that cannot be read.
    """
    target, one_g, measured = TARGETS[name], _one_g(path, whole, gravity), _measured(whole)
    span = _span(measured, temperatures, at_degc)
    date, serial = whole.provenance.get("date_utc"), whole.serial_number
    of = f"{f'serial number {serial}, ' if serial else ''}{path.name}{f' of {date}' if date else ''}"
    header, carried = f"tumblecal {__version__}: calibration of {of}", target.carried(whole, span, at_degc)
    bare = Export(carried, one_g.value_ms2, (header,), span, tuple(noise), at_degc=at_degc, **options)
    written = target.write(bare)
    notes = [*_notes(whole, target, bare, written, measured)]
    if gravity is not None and whole.gravity:
        notes.append(f"one g is {one_g}, as in the calibration")
    if one_g.assumed and name not in ("c-header", "csv"):
        notes.append(f"one g is {one_g}: {'calibrate again' if whole.gravity else 'state it'} with --gravity")
    text = target.write(replace(bare, header=(header, target.words, *notes)))
    # The content without an option is written to see whether the option has an effect.
    without = {
        "gravity": (gravity, replace(bare, gravity_ms2=one_g.value_ms2 * 1.001)),
        "temperatures": (temperatures, replace(bare, temperatures_degc=None)),
        "noise": (noise, replace(bare, noise=())),
        "table-step": (bare.table_step_degc, replace(bare, table_step_degc=None)),
        "run-time": (bare.run_s, bare if not any(term.per_hour for term in whole.terms) else None),
        "at": (at_degc, None if "temperature_degc" in whole.columns_needed else bare),
    }
    notes += [
        f"--{option}: no effect on the export of this calibration to {name}"
        for option, (value, other) in without.items()
        if value not in (None, ()) and other is not None and target.write(other) == written
    ]
    return text, target.words, notes


def _notes(
    whole: Calibration, target: Target, bare: Export, written: str, measured: tuple[float, float] | None
) -> Iterator[str]:
    """Losses of the format, use of the calibration, and limits of both."""
    lost = [f"lost: {loss}" for loss in losses(target, bare, whole, written)]
    yield from lost or ["nothing of this calibration is lost"]
    yield from filter(None, [undetermined_words(whole.terms), *use_lines(whole)])
    span = bare.temperatures_degc
    if span and measured and (span[0] < measured[0] or span[1] > measured[1]):
        yield (
            f"the data cover {measured[0]:.4g} to {measured[1]:.4g} degC: in the rest of {span[0]:g} to {span[1]:g} degC the "
            "dependence on temperature is extrapolated"
        )
    yield from filter(None, target.notes)
    if undetermined := whole.sensor.of(SENSOR).undetermined_words:
        yield f"the data did not determine {undetermined}"


def _measured(whole: Calibration) -> tuple[float, float] | None:
    """The range of temperature (degC) of the data of curves or thermal terms; None without them, or if it is not stated."""
    if whole.temperature is not None:
        return whole.temperature.range_degc
    low, high = whole.provenance.get("temperature_range_degc") or (0.0, 0.0)
    return (low, high) if low < high and any(term.thermal for term in whole.terms) else None


def _one_g(path: Path, whole: Calibration, gravity: str | None) -> Gravity:
    """One g of a calibration: that of the calibration, then of `--gravity`, then standard gravity.

    **Raises:** `InputError` if the option contradicts the calibration, because it would change the bias in m/s^2.
    """
    stated, calibrated = None if gravity is None else gravity_of_option(gravity), whole.gravity
    if stated and calibrated and abs(stated.value_ms2 - calibrated.value_ms2) > SAME_MS2:
        cure = "calibrate again with --gravity" if calibrated.assumed else "remove this option"
        raise InputError(
            f"--gravity {gravity}: one g of {path} is {calibrated} at every site, and its bias in m/s^2 depends on that; {cure}"
        )
    return calibrated or stated or STANDARD


def _span(
    measured: tuple[float, float] | None, temperatures: str | None, at: float | None
) -> tuple[float, float] | None:
    """The range of `--temperatures`, degC, otherwise that of the data.

    **Raises:** `InputError` for a text that is not a range, and if `--at` is outside.
    """
    span = measured
    if temperatures is not None:
        low, *high = numbers("--temperatures", temperatures, "0:60", ":")
        if len(high) != 1 or not -100 <= low < high[0] <= 200:
            raise InputError(f"--temperatures {temperatures}: write LOW:HIGH in degC, such as 0:60")
        span = low, high[0]
    if at is not None and span is not None and not span[0] <= at <= span[1]:
        raise InputError(f"--at {at:g}: outside the range of {span[0]:.4g} to {span[1]:.4g} degC; widen --temperatures")
    return span
