"""Readings that no sensor can produce: another unit in some rows, misplaced decimal points, a logger that repeated readings."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.data import PositionSet
from tumblecal.data.gravity_size import FACTORS, NEAR
from tumblecal.estimation.equal_ends import equal_ends
from tumblecal.estimation.setup_error import SetupError
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


# Rows are in several units if at least this share has a norm of 1 g in one of them; otherwise single axes may be.
_OF_ROWS = 0.8
# In g, in the correct unit: smallest reading that contributes to a row, and largest deviation from a perfect triad.
_PART_G, _FAR_OFF_G = 0.15, 0.25
# Larger means (g) do not occur at rest, for any bias.
_RESTING_G = 5.0
# A decimal point is corrected if the result agrees with the prediction of the other positions within this share, and g. The
# prediction must exceed the third number. If the reading is possible at rest, the last, smaller share applies.
_SHARE, _LEAST_G, _PREDICTED_G, _RESTING_SHARE = 0.03, 0.01, 0.1, 0.004
_MOST_PLACES = 9
# Codes of loggers for a missing reading.
_CODES = (999.0, 9999.0, 99999.0, 999999.0, 32767.0, 32768.0)
# A prediction needs this many positions of a mounting, and within the second number (g) of a sensor's reading this share.
_FEWEST, _NEAR_G, _LEAST_NEAR = 8, 0.1, 0.6
# Attitudes that differ by more than this (g) do not give readings equal in every digit (five or more digits).
_OTHER_G, _COARSE_G = 0.1, 1e-4
# So many equal successive readings of an axis occur only if it stuck.
_FEWEST_STUCK = 3
# A reading is clipped if the prediction exceeds the end of the range by more than this (g).
_BEYOND_G = 0.02
# Equal readings at the end of a range with a smaller probability than this are clipped.
_IMPROBABLE = 1e-5


def units_of_rows(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set with rows in another unit converted to g; a single reading that is far too large does not count as such."""
    readings, found = data.readings.copy(), []
    log_size, far = np.log(np.maximum(np.linalg.norm(readings, axis=1), 1e-300)), np.log(NEAR)
    near = {words: np.abs(log_size - np.log(factor)) < far for words, factor in FACTORS.items()}
    if np.mean(np.any([np.abs(log_size) < far, *near.values()], axis=0)) < _OF_ROWS:
        return data, []
    predicted = _predicted(data, np.abs(log_size) < far)
    for words, factor in FACTORS.items():
        odd = [row for row in np.flatnonzero(near[words]).tolist() if _is_one_g(data, row, factor, predicted)]
        if not odd:
            continue
        tenfold = [] if predicted is None or words != "m/s^2" else _tenfold(data, odd, predicted)
        readings[odd] /= factor
        readings[tenfold] *= factor / 10.0
        data = replace(data, sd=_sd_in_g(data, odd, factor))
        for label, rows, fault in (
            ("unit_error", [row for row in odd if row not in tenfold], f"in {words}"),
            ("decimal_slip", tenfold, "ten times too large: the decimal points are one place too far to the right"),
        ):
            if rows:
                listed = ", ".join(data.names[row] for row in rows[:6]) + (" ..." if len(rows) > 6 else "")
                position, are = ("positions", "are") if len(rows) > 1 else ("position", "is")
                found.append(SetupError(label, f"{position} {listed} {are} {fault}"))
    return replace(data, readings=readings), found


def correct_decimal_points(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set with misplaced decimal points of single readings corrected.

    **Raises:** `InputError` for a reading that is impossible at rest and that no shift of the decimal point explains.
    """
    readings, found, faults = data.readings.copy(), [], []
    predicted = _predicted(data)
    if predicted is None:
        # Without known attitudes, or if the readings do not follow them, any reading may be wrong.
        return data, []
    for row, axis in np.argwhere(np.abs(readings - predicted) > _FAR_OFF_G).tolist():
        reading, due = float(readings[row, axis]), float(predicted[row, axis])
        places = _places(reading, due)
        where = f"position {data.names[row]}, axis {AXES[axis]}"
        if places:
            readings[row, axis] = reading / 10.0**places
            found.append(
                SetupError(
                    "decimal_slip",
                    f"{where}: {reading:.7g} g must be {readings[row, axis]:.7g} g, its decimal point is misplaced",
                )
            )
        elif abs(reading) > _RESTING_G:
            faults.append(
                f"{data.source}: {where} reads {reading:.7g} g; about {due:.2f} g is expected: impossible at rest "
                "(perhaps a code "
                "for a missing reading); correct it, or remove the row"
            )
    if faults:
        raise InputError(faults)
    return replace(data, readings=readings), found


def refuse_unmeasured(data: PositionSet) -> None:
    """Reject readings that are equal in every digit at different attitudes: copied, stuck, or clipped.

    **Raises:** `InputError` naming the positions.
    """
    predicted = _predicted(data)
    if predicted is not None:
        _refuse_clipped(data, predicted)
    _refuse_copied(data)
    if predicted is not None:
        _refuse_stuck(data, predicted)


def _refuse_clipped(data: PositionSet, predicted: Float[np.ndarray, "positions 3"]) -> None:
    """Reject an axis whose largest readings are equal in every digit, if they are far below the prediction, or too many, or at
    too round a value, for coincidence."""
    fine = np.mean(_fine(data), axis=0) > 0.5
    for end in equal_ends(data.readings):
        if not fine[end.axis]:
            continue
        beyond = float(np.max(np.abs(predicted[end.rows, end.axis]))) - end.size
        due = (
            f"where up to {end.size + beyond:.2f} g is expected" if beyond > _BEYOND_G else "which is not a coincidence"
        )
        if beyond > _BEYOND_G or end.chance < _IMPROBABLE:
            axis = AXES[end.axis]
            raise InputError(
                f"{data.source}: axis {axis} reads {end.size:.9g} g, of either sign, at {len(end.rows)} positions and never "
                f"more, {due}: it is clipped at the end of its range (clipping.{axis}); choose a larger range, or remove "
                f"positions {_listed(data, end.rows)}"
            )


def _fine(data: PositionSet) -> Bool[np.ndarray, "positions 3"]:
    """Which readings are not multiples of a coarse step, which would repeat by chance."""
    return np.abs(data.readings / _COARSE_G - np.round(data.readings / _COARSE_G)) > 1e-6


def _refuse_copied(data: PositionSet) -> None:
    """Reject rows with identical readings."""
    f = gravity_in_head(data.alpha, data.beta)
    fine, (_, same) = _fine(data), np.unique(data.readings, axis=0, return_inverse=True)
    for number in np.flatnonzero(np.bincount(same.ravel()) > 1).tolist():
        rows = np.flatnonzero(same.ravel() == number)
        if np.any(fine[rows[0]]) and np.max(np.linalg.norm(f[rows] - f[rows[0]], axis=1)) > _OTHER_G:
            raise InputError(
                f"{data.source}: positions {_listed(data, rows)} have identical readings at different attitudes: "
                "the logger stuck, or a row was copied; remove the rows that were not measured"
            )


def _refuse_stuck(data: PositionSet, predicted: Float[np.ndarray, "positions 3"]) -> None:
    """Reject an axis that does not change between different attitudes."""
    fine = _fine(data)
    for axis in range(3):
        stays = np.flatnonzero(np.diff(data.readings[:, axis]) != 0) + 1
        for rows in np.split(np.arange(len(data)), stays):
            if len(rows) >= _FEWEST_STUCK and fine[rows[0], axis] and np.ptp(predicted[rows, axis]) > _OTHER_G:
                raise InputError(
                    f"{data.source}: axis {AXES[axis]} reads exactly {data.readings[rows[0], axis]:.9g} g at "
                    f"positions {_listed(data, rows)}, where it must change by {np.ptp(predicted[rows, axis]):.2g} g: it "
                    "stuck; remove the rows that were not measured"
                )


def _listed(data: PositionSet, rows: np.ndarray) -> str:
    return ", ".join(data.names[row] for row in rows[:6]) + (" ..." if len(rows) > 6 else "")


def _is_one_g(data: PositionSet, row: int, factor: float, predicted: Float[np.ndarray, "positions 3"] | None) -> bool:
    """Whether a row is 1 g in a unit. If only one reading is far too large, the others are as in g and the row is not."""
    parts = np.abs(data.readings[row]) / factor
    if np.sum(parts > _PART_G) > 1:
        return True
    if predicted is not None:
        due, readings = predicted[row], data.readings[row]
        others = np.arange(3) != np.argmax(parts)
        in_unit, in_g = (np.linalg.norm((values - due)[others]) for values in (readings / factor, readings))
        return bool(np.linalg.norm(readings / factor - due) < _FAR_OFF_G and in_unit < in_g)
    if data.hand_held:
        return bool(factor < 1 or np.sort(parts)[1] * factor > NEAR)
    f = gravity_in_head(data.alpha, data.beta)[row]
    # For any quarter turn of the triad.
    return bool(np.max(np.abs(np.sort(parts) - np.sort(np.abs(f)))) < _FAR_OFF_G)


def _sd_in_g(data: PositionSet, rows: list[int], factor: float) -> Float[np.ndarray, "positions 3"] | None:
    """The sd columns, with some rows converted to g if they are in another unit than the other rows."""
    others = np.delete(np.arange(len(data)), rows)
    if data.sd is None or not len(others):
        return data.sd
    ratio = np.median(data.sd[rows]) / np.median(data.sd[others])
    scale = factor if abs(np.log(ratio / factor)) < abs(np.log(ratio)) else 1.0
    return np.where(np.isin(np.arange(len(data)), rows)[:, None], data.sd / scale, data.sd)


def _tenfold(data: PositionSet, rows: list[int], predicted: Float[np.ndarray, "positions 3"]) -> list[int]:
    """The rows whose readings are closer to ten times the prediction of the other positions than to 9.80665 times."""
    due, readings = predicted[rows], data.readings[rows]
    ratio = np.sum(due * readings, axis=1) / np.sum(due**2, axis=1)
    return [
        row for row, times in zip(rows, ratio, strict=True) if abs(times - 10.0) < abs(times - STANDARD_GRAVITY_MS2)
    ]


def _places(reading: float, due: float) -> int:
    """By how many places the decimal point must move to the left; 0 if no shift explains the reading."""
    if abs(due) < _PREDICTED_G or reading * due <= 0 or abs(reading) in _CODES:
        return 0
    places = round(np.log10(reading / due))
    near = abs(reading / 10.0**places - due)
    resting = abs(reading) < _RESTING_G
    most = _RESTING_SHARE * abs(due) if resting else max(_SHARE * abs(due), _LEAST_G)
    return places if 0 < abs(places) <= _MOST_PLACES and near < most else 0


def _predicted(
    data: PositionSet, in_g: Bool[np.ndarray, " positions"] | None = None
) -> Float[np.ndarray, "positions 3"] | None:
    """Readings (g) of a linear sensor fitted robustly to each mounting; None if the readings do not follow one.

    The weights are those of Geman and McClure, from wide to narrow, so that outliers do not decide.

    **Arguments:**

    - `in_g`: mask of the positions to use; all if omitted.
    """
    if data.hand_held:
        return None
    f = gravity_in_head(data.alpha, data.beta)
    basis, predicted = np.hstack([f, np.ones((len(f), 1))]), np.empty_like(data.readings)
    mount = np.array(data.mount or ("1",) * len(data))
    for label in dict.fromkeys(mount.tolist()):
        rows, counted = np.flatnonzero(mount == label), np.ones(len(data), bool) if in_g is None else in_g
        if np.sum(counted[rows]) < _FEWEST:
            return None
        reading, design = data.readings[rows].T, basis[rows]
        weight = ((np.abs(reading) < _RESTING_G) & counted[rows]).astype(float)
        for near in (0.5, 0.3, 0.1, 0.05, 0.05):
            root = np.sqrt(weight)[:, :, None]
            sensor = np.linalg.pinv(design * root, rcond=1e-9) @ (root * reading[:, :, None])
            fitted = (design @ sensor)[:, :, 0]
            weight = counted[rows] / (1.0 + ((reading - fitted) / near) ** 2) ** 2
        predicted[rows] = fitted.T
    followed = np.mean(
        (np.max(np.abs(data.readings - predicted), axis=1) < _NEAR_G)[slice(None) if in_g is None else in_g]
    )
    return predicted if followed > _LEAST_NEAR else None
