"""Readings in another unit than g: all, those of an axis, some rows, or with a misplaced decimal point."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tumblecal.data import PositionSet
from tumblecal.data.gravity_size import FACTORS, NEAR, gravity_size, size_fault, unit_of
from tumblecal.estimation.setup.error import SetupError, named
from tumblecal.estimation.setup.sensor_fit import RESTING_G, predicted
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head


Corrected = tuple[PositionSet, list[SetupError]]

# If at least this share of the rows has a norm of 1 g, the columns are in g.
_IN_G = 0.25
# Sizes of readings (g) that a calibration may have and no other unit would produce.
_POSSIBLE_G = (0.5, 2.0)
# Readings in another unit are larger by more than this factor.
_OTHER_UNIT = 3.0
# An axis is judged by this quantile of its readings, so that a single outlier does not decide.
_MOST_IN_G = 0.9
# Rows are in several units if at least this share has a norm of 1 g in one of them; otherwise single axes may be.
_OF_ROWS = 0.8
# In g, in the correct unit: smallest reading that contributes to a row, and largest deviation from a perfect triad.
_PART_G, _FAR_OFF_G = 0.15, 0.25
# A decimal point is corrected if the result agrees with the prediction of the other positions within this share, and g. The
# prediction must exceed the third number. If the reading is possible at rest, the last, smaller share applies.
_SHARE, _LEAST_G, _PREDICTED_G, _RESTING_SHARE = 0.03, 0.01, 0.1, 0.004
_MOST_PLACES = 9
# Codes of loggers for a missing reading.
_CODES = (999.0, 9999.0, 99999.0, 999999.0, 32767.0, 32768.0)
_TENFOLD = "ten times too large: the decimal points are one place too far to the right"


def in_g(data: PositionSet) -> Corrected:
    """The set with readings in another unit converted to g, and misplaced decimal points corrected.

    **Raises:** `InputError` for readings of another size than gravity, or one that is impossible at rest and that no shift of
    the decimal point explains.
    """
    errors = []
    for correct in (_all_readings, _rows, _decimal_points, _axes):
        data, found = correct(data)
        errors += found
    return data, errors


def _all_readings(data: PositionSet) -> Corrected:
    sizes = np.linalg.norm(data.readings, axis=1)
    are_in_g = np.mean(np.abs(np.log(np.maximum(sizes, 1e-300))) < np.log(NEAR)) >= _IN_G
    if not are_in_g and (unit := unit_of(gravity_size(data.readings))):
        return replace(data, readings=data.readings / FACTORS[unit]), [
            SetupError("unit_error", f"all readings are in {unit}")
        ]
    # Some rows, or a single axis, in another unit change the size as well; they are corrected later.
    largest = np.quantile(np.abs(data.readings), _MOST_IN_G, axis=0)
    one_axis = np.max(largest) > _OTHER_UNIT * np.min(largest) and np.any(
        (largest > _POSSIBLE_G[0]) & (largest < _POSSIBLE_G[1])
    )
    if not (one_axis or (are_in_g and np.max(sizes) > _OTHER_UNIT)) and (fault := size_fault(data.readings)):
        raise InputError(f"{data.source}: {fault}")
    return data, []


def _rows(data: PositionSet) -> Corrected:
    """Rows in another unit; a single reading that is far too large does not count as such."""
    readings, found = data.readings.copy(), []
    log_size, far = np.log(np.maximum(np.linalg.norm(readings, axis=1), 1e-300)), np.log(NEAR)
    near = {words: np.abs(log_size - np.log(factor)) < far for words, factor in FACTORS.items()}
    if np.mean(np.any([np.abs(log_size) < far, *near.values()], axis=0)) < _OF_ROWS:
        return data, []
    due = predicted(data, np.abs(log_size) < far)
    for words, factor in FACTORS.items():
        of_unit = [row for row in np.flatnonzero(near[words]).tolist() if _is_one_g(data, row, factor, due)]
        tenfold = [
            row for row in of_unit if due is not None and words == "m/s^2" and _is_tenfold(readings[row], due[row])
        ]
        data = replace(data, sd=_sd_in_g(data, of_unit, factor))
        for label, rows, divisor, fault in (
            ("unit_error", [row for row in of_unit if row not in tenfold], factor, f"in {words}"),
            ("decimal_slip", tenfold, 10.0, _TENFOLD),
        ):
            if rows:
                readings[rows] /= divisor
                listed, several = named(data, rows), len(rows) > 1
                found.append(
                    SetupError(label, f"position{'s' * several} {listed} {'are' if several else 'is'} {fault}")
                )
    return replace(data, readings=readings), found


def _is_one_g(data: PositionSet, row: int, factor: float, due: Float[np.ndarray, "positions 3"] | None) -> bool:
    """Whether a row is 1 g in a unit. If only one reading is far too large, the others are as in g and the row is not."""
    readings, parts = data.readings[row], np.abs(data.readings[row]) / factor
    if np.sum(parts > _PART_G) > 1:
        return True
    if due is not None:
        others = np.arange(3) != np.argmax(parts)
        in_unit, as_it_is = (np.linalg.norm((own - due[row])[others]) for own in (readings / factor, readings))
        return bool(np.linalg.norm(readings / factor - due[row]) < _FAR_OFF_G and in_unit < as_it_is)
    if data.hand_held:
        return bool(factor < 1 or np.sort(parts)[1] * factor > NEAR)
    f = gravity_in_head(data.alpha, data.beta)[row]
    # For any quarter turn of the triad.
    return bool(np.max(np.abs(np.sort(parts) - np.sort(np.abs(f)))) < _FAR_OFF_G)


def _is_tenfold(readings: Float[np.ndarray, "3"], due: Float[np.ndarray, "3"]) -> bool:
    """Whether readings are closer to ten times the prediction of the other positions than to 9.80665 times."""
    ratio = due @ readings / (due @ due)
    return bool(abs(ratio - 10.0) < abs(ratio - FACTORS["m/s^2"]))


def _sd_in_g(data: PositionSet, rows: list[int], factor: float) -> Float[np.ndarray, "positions 3"] | None:
    """The sd columns, with some rows converted to g if they are in another unit than the other rows."""
    others = np.delete(np.arange(len(data)), rows)
    if data.sd is None or not len(others) or not rows:
        return data.sd
    ratio = np.median(data.sd[rows]) / np.median(data.sd[others])
    scale = factor if abs(np.log(ratio / factor)) < abs(np.log(ratio)) else 1.0
    return np.where(np.isin(np.arange(len(data)), rows)[:, None], data.sd / scale, data.sd)


def _axes(data: PositionSet) -> Corrected:
    """Single axes in another unit: their sensitivity to gravity in any direction is that of the unit."""
    if data.hand_held:
        return data, []
    f = gravity_in_head(data.alpha, data.beta)
    sizes = []
    for rows in data.mountings.values():
        basis = np.column_stack([f[rows], np.ones(np.sum(rows))])
        if np.linalg.matrix_rank(basis, tol=1e-3) == 4:
            sizes.append(np.linalg.norm(np.linalg.lstsq(basis, data.readings[rows], rcond=None)[0][:3], axis=0))
    readings, found = data.readings.copy(), []
    for axis, size in enumerate(np.median(sizes, axis=0).tolist() if sizes else ()):
        for words, factor in FACTORS.items():
            if 1 / NEAR < size / factor < NEAR:
                readings[:, axis] /= factor
                found.append(SetupError("unit_error", f"axis {AXES[axis]} is in {words}"))
    return replace(data, readings=readings), found


def _decimal_points(data: PositionSet) -> Corrected:
    """Misplaced decimal points of single readings."""
    readings, found, faults = data.readings.copy(), [], []
    due = predicted(data)
    if due is None:
        # Without known attitudes, or if the readings do not follow them, any reading may be wrong.
        return data, []
    for row, axis in np.argwhere(np.abs(readings - due) > _FAR_OFF_G).tolist():
        reading, expected = float(readings[row, axis]), float(due[row, axis])
        where = f"position {data.names[row]}, axis {AXES[axis]}"
        if places := _places(reading, expected):
            readings[row, axis] = reading / 10.0**places
            words = f"{where}: {reading:.7g} g must be {readings[row, axis]:.7g} g, its decimal point is misplaced"
            found.append(SetupError("decimal_slip", words))
        elif abs(reading) > RESTING_G:
            faults.append(
                f"{data.source}: {where} reads {reading:.7g} g; about {expected:.2f} g is expected: impossible at rest "
                "(perhaps a code for a missing reading); correct it, or remove the row"
            )
    if faults:
        raise InputError(faults)
    return replace(data, readings=readings), found


def _places(reading: float, due: float) -> int:
    """By how many places the decimal point must move to the left; 0 if no shift explains the reading."""
    if abs(due) < _PREDICTED_G or reading * due <= 0 or abs(reading) in _CODES:
        return 0
    places = round(np.log10(reading / due))
    near = abs(reading / 10.0**places - due)
    most = _RESTING_SHARE * abs(due) if abs(reading) < RESTING_G else max(_SHARE * abs(due), _LEAST_G)
    return places if 0 < abs(places) <= _MOST_PLACES and near < most else 0
