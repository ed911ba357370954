"""Readings that are no sensor's, whatever the head did: another unit in some rows, lost decimal points, a logger that stuck."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.data import PositionSet
from tumblecal.estimation.equal_ends import equal_ends
from tumblecal.estimation.setup_error import SetupError
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


# By how much readings of 1 g are larger in each unit than the column says.
FACTORS = {
    "mg": 1e3,
    "m/s^2": STANDARD_GRAVITY_MS2,
    "g (in a column of mg)": 1e-3,
    "g (in a column of m/s^2)": 1 / STANDARD_GRAVITY_MS2,
}
# How far (ratio) a reading's size may be from a unit's factor and still be taken for it.
NEAR = 1.3
# Rows are in several units where at least this share of all is of 1 g in one of them; else single axes may be in another.
_OF_ROWS = 0.8
# In g once it is in the right unit: a reading that has a part in a row, and how far one may be from a perfect triad's.
_PART_G, _FAR_OFF_G = 0.15, 0.25
# No mean of a triad at rest is larger (g), whatever its bias.
_RESTING_G = 5.0
# A decimal point is put back where the reading is then this near (share, and g) to what the other positions predict, of more
# than so much; and where the reading may be one at rest, only where it is much nearer.
_SHARE, _LEAST_G, _PREDICTED_G, _RESTING_SHARE = 0.03, 0.01, 0.1, 0.004
_MOST_PLACES = 9
# Numbers that loggers write for a reading that is missing.
_CODES = (999.0, 9999.0, 99999.0, 999999.0, 32767.0, 32768.0)
# Fewer positions of a mounting than these, or fewer of them near (g) a sensor's reading, predict nothing.
_FEWEST, _NEAR_G, _LEAST_NEAR = 8, 0.1, 0.6
# Attitudes apart by more than this (g) are not read alike to the last digit, of five or more.
_OTHER_G, _COARSE_G = 0.1, 1e-4
# So many readings of one axis in turn are alike to the last digit only where it stuck.
_FEWEST_STUCK = 3
# More than this (g) is due beyond the end of a range.
_BEYOND_G = 0.02
# Equal readings at the end of a range are no chance where they come by it less often than this.
_NO_CHANCE = 1e-5


def units_of_rows(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set with rows that are in another unit than the others in g; a single reading that is far too large is none."""
    readings, told = data.readings.copy(), []
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
        for label, own, said in (
            ("unit_error", [row for row in odd if row not in tenfold], f"in {words}"),
            ("decimal_slip", tenfold, "ten times too large: the decimal points stand a place too far to the right"),
        ):
            if own:
                listed = ", ".join(data.names[row] for row in own[:6]) + (" ..." if len(own) > 6 else "")
                told.append(SetupError(label, f"position{'s' if len(own) > 1 else ''} {listed} {_are(own)} {said}"))
    return replace(data, readings=readings), told


def correct_decimal_points(data: PositionSet) -> tuple[PositionSet, list[SetupError]]:
    """The set with single readings whose decimal point was lost as the other positions predict them.

    **Raises:** `InputError` for a reading that none at rest is and no decimal point explains.
    """
    readings, told, faults = data.readings.copy(), [], []
    predicted = _predicted(data)
    if predicted is None:
        # Of attitudes that are not known, or not followed, every reading may be off.
        return data, []
    for row, axis in np.argwhere(np.abs(readings - predicted) > _FAR_OFF_G).tolist():
        reading, due = float(readings[row, axis]), float(predicted[row, axis])
        places = _places(reading, due)
        where = f"position {data.names[row]}, axis {AXES[axis]}"
        if places:
            readings[row, axis] = reading / 10.0**places
            told.append(
                SetupError(
                    "decimal_slip",
                    f"{where}: {reading:.7g} g must be {readings[row, axis]:.7g} g, its decimal point is off",
                )
            )
        elif abs(reading) > _RESTING_G:
            faults.append(
                f"{data.source}: {where} reads {reading:.7g} g, and about {due:.2f} g is due there: no reading at rest (a code "
                "for one that is missing, say); correct it, or take the row out"
            )
    if faults:
        raise InputError(faults)
    return replace(data, readings=readings), told


def refuse_unmeasured(data: PositionSet) -> None:
    """Refuse readings that stayed the same to the last digit while the attitude changed: copied, stuck, at the end of a range.

    **Raises:** `InputError` naming the positions.
    """
    predicted = _predicted(data)
    if predicted is not None:
        _refuse_clipped(data, predicted)
    _refuse_copied(data)
    if predicted is not None:
        _refuse_stuck(data, predicted)


def _refuse_clipped(data: PositionSet, predicted: Float[np.ndarray, "positions 3"]) -> None:
    """Refuse an axis whose largest readings are equal to the last digit: far below what is due, or so many, at so round a
    value, that it is no chance."""
    fine = np.mean(_fine(data), axis=0) > 0.5
    for end in equal_ends(data.readings):
        if not fine[end.axis]:
            continue
        beyond = float(np.max(np.abs(predicted[end.rows, end.axis]))) - end.size
        due = f"where up to {end.size + beyond:.2f} g is due" if beyond > _BEYOND_G else "which is no chance"
        if beyond > _BEYOND_G or end.chance < _NO_CHANCE:
            axis = AXES[end.axis]
            raise InputError(
                f"{data.source}: axis {axis} reads {end.size:.9g} g, of either sign, at {len(end.rows)} positions and never "
                f"more, {due}: it is clipped at the end of its range (clipping.{axis}); choose a larger one, or take positions "
                f"{_listed(data, end.rows)} out"
            )


def _fine(data: PositionSet) -> Bool[np.ndarray, "positions 3"]:
    """Which readings are no coarse steps: those repeat."""
    return np.abs(data.readings / _COARSE_G - np.round(data.readings / _COARSE_G)) > 1e-6


def _refuse_copied(data: PositionSet) -> None:
    """Refuse whole rows that are alike."""
    f = gravity_in_head(data.alpha, data.beta)
    fine, (_, same) = _fine(data), np.unique(data.readings, axis=0, return_inverse=True)
    for number in np.flatnonzero(np.bincount(same.ravel()) > 1).tolist():
        rows = np.flatnonzero(same.ravel() == number)
        if np.any(fine[rows[0]]) and np.max(np.linalg.norm(f[rows] - f[rows[0]], axis=1)) > _OTHER_G:
            raise InputError(
                f"{data.source}: positions {_listed(data, rows)} have the same readings to the last digit at different "
                "attitudes: the logger stuck, or a row was copied; take out those that were not measured"
            )


def _refuse_stuck(data: PositionSet, predicted: Float[np.ndarray, "positions 3"]) -> None:
    """Refuse an axis that stays while it must change."""
    fine = _fine(data)
    for axis in range(3):
        stays = np.flatnonzero(np.diff(data.readings[:, axis]) != 0) + 1
        for rows in np.split(np.arange(len(data)), stays):
            if len(rows) >= _FEWEST_STUCK and fine[rows[0], axis] and np.ptp(predicted[rows, axis]) > _OTHER_G:
                raise InputError(
                    f"{data.source}: axis {AXES[axis]} reads {data.readings[rows[0], axis]:.9g} g to the last digit at "
                    f"positions {_listed(data, rows)}, where it must change by {np.ptp(predicted[rows, axis]):.2g} g: it "
                    "stuck; take out the rows that were not measured"
                )


def _are(rows: Sequence[int]) -> str:
    return "are" if len(rows) > 1 else "is"


def _listed(data: PositionSet, rows: np.ndarray) -> str:
    return ", ".join(data.names[row] for row in rows[:6]) + (" ..." if len(rows) > 6 else "")


def _is_one_g(data: PositionSet, row: int, factor: float, predicted: Float[np.ndarray, "positions 3"] | None) -> bool:
    """Whether a row is one g in a unit: of one reading that is far too large the others are as in g."""
    parts = np.abs(data.readings[row]) / factor
    if np.sum(parts > _PART_G) > 1:
        return True
    if predicted is not None:
        due, readings = predicted[row], data.readings[row]
        others = np.arange(3) != np.argmax(parts)
        in_unit, in_g = (np.linalg.norm((own - due)[others]) for own in (readings / factor, readings))
        return bool(np.linalg.norm(readings / factor - due) < _FAR_OFF_G and in_unit < in_g)
    if data.hand_held:
        return bool(factor < 1 or np.sort(parts)[1] * factor > NEAR)
    f = gravity_in_head(data.alpha, data.beta)[row]
    # However the triad is turned by quarter turns.
    return bool(np.max(np.abs(np.sort(parts) - np.sort(np.abs(f)))) < _FAR_OFF_G)


def _sd_in_g(data: PositionSet, rows: list[int], factor: float) -> Float[np.ndarray, "positions 3"] | None:
    """The sd columns, those of some rows in g where they, too, are in another unit than those of the others."""
    others = np.delete(np.arange(len(data)), rows)
    if data.sd is None or not len(others):
        return data.sd
    ratio = np.median(data.sd[rows]) / np.median(data.sd[others])
    scale = factor if abs(np.log(ratio / factor)) < abs(np.log(ratio)) else 1.0
    return np.where(np.isin(np.arange(len(data)), rows)[:, None], data.sd / scale, data.sd)


def _tenfold(data: PositionSet, rows: list[int], predicted: Float[np.ndarray, "positions 3"]) -> list[int]:
    """Those of some rows that are nearer to ten times what the other positions predict than to standard gravity times."""
    due, readings = predicted[rows], data.readings[rows]
    ratio = np.sum(due * readings, axis=1) / np.sum(due**2, axis=1)
    return [row for row, own in zip(rows, ratio, strict=True) if abs(own - 10.0) < abs(own - STANDARD_GRAVITY_MS2)]


def _places(reading: float, due: float) -> int:
    """By how many places the decimal point must go to the left; 0 where none does."""
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
    """What a linear sensor fitted to most of each mounting's positions reads, g; None where they do not follow one. `in_g`: the
    positions that count; all where left out.

    The weights are those of Geman and McClure, from wide to narrow, so that what is far off does not decide.
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
        for axis in range(3):
            reading, own = data.readings[rows, axis], basis[rows]
            weight = ((np.abs(reading) < _RESTING_G) & counted[rows]).astype(float)
            for near in (0.5, 0.3, 0.1, 0.05, 0.05):
                sensor = np.linalg.lstsq(own * np.sqrt(weight)[:, None], reading * np.sqrt(weight), rcond=1e-9)[0]
                left = (reading - own @ sensor) / near
                weight = counted[rows] / (1.0 + left**2) ** 2
            predicted[rows, axis] = own @ sensor
    followed = np.mean(
        (np.max(np.abs(data.readings - predicted), axis=1) < _NEAR_G)[slice(None) if in_g is None else in_g]
    )
    return predicted if followed > _LEAST_NEAR else None
