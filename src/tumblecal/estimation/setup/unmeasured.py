"""Readings that were not measured: an axis without a signal of its own, copied or stuck rows, a clipped axis."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.data import PositionSet
from tumblecal.estimation.setup.error import named
from tumblecal.estimation.setup.sensor_fit import predicted
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head


# An axis that varies by less than this share of the others, or differs from another by less, has no separate signal.
_NO_SIGNAL = 0.02
# An axis does not follow the attitudes if they leave more than this share of it unexplained.
_UNFOLLOWED = 0.5
# A missing signal is reported only if the ideal inputs of the axis vary by this much (g).
_MOVED_G = 0.5
# Attitudes that differ by more than this (g) do not give readings equal in every digit (five or more digits).
_OTHER_G, _COARSE_G = 0.1, 1e-4
# So many equal successive readings of an axis occur only if it stuck.
_FEWEST_STUCK = 3
# A reading is clipped if the prediction exceeds the end of the range by more than this (g).
_BEYOND_G = 0.02
# Equal readings at the end of a range with a smaller probability than this are clipped.
_IMPROBABLE = 1e-5
# Readings of at least this share of the largest are at the end of the range.
_END = 0.98
_MOST_DECIMALS = 9


def refuse_silent_axes(data: PositionSet, ideal: Float[np.ndarray, "positions 3"]) -> None:
    """Reject an axis that does not vary, or whose readings equal those of another.

    **Raises:** `InputError` naming the axes.
    """
    moved, readings = np.ptp(data.readings, axis=0), data.readings
    if np.any(np.ptp(ideal, axis=0) < _MOVED_G) or len(data) < 4:
        return
    usual = np.median(moved)
    for axis in np.flatnonzero(moved < _NO_SIGNAL * usual).tolist():
        if not _follows(readings[:, axis], ideal):
            raise InputError(
                f"{data.source}: axis {AXES[axis]} reads {readings[0, axis]:.4g} g at every position (it varies by "
                f"{moved[axis]:.2g} g, the others by {usual:.3g} g): a dead axis, or a column without readings; check the "
                "sensor and the column names"
            )
    for first, second in ((0, 1), (0, 2), (1, 2)):
        for sign, words in ((1, "the same as"), (-1, "the negative of")):
            difference = np.ptp(readings[:, second] - sign * readings[:, first])
            if difference < _NO_SIGNAL * max(moved[first], moved[second]):
                raise InputError(
                    f"{data.source}: axis {AXES[second]} reads {words} axis {AXES[first]} at every position: a channel or a "
                    "column was used twice; give each axis its column"
                )


def _follows(readings: Float[np.ndarray, " positions"], ideal: Float[np.ndarray, "positions 3"]) -> bool:
    """Whether one axis follows the attitudes, however little it varies."""
    basis = np.hstack([ideal, np.ones((len(ideal), 1))])
    residual_sd = np.std(readings - basis @ np.linalg.lstsq(basis, readings, rcond=None)[0])
    return bool(np.ptp(readings) > 0 and residual_sd < _UNFOLLOWED * np.std(readings))


def refuse_unmeasured(data: PositionSet) -> None:
    """Reject readings that are equal in every digit at different attitudes: clipped, copied, or stuck.

    **Raises:** `InputError` naming the positions.
    """
    due, fine = predicted(data), _fine(data)
    if due is not None:
        _refuse_clipped(data, due, fine)
    f = gravity_in_head(data.alpha, data.beta)
    _, same = np.unique(data.readings, axis=0, return_inverse=True)
    for number in np.flatnonzero(np.bincount(same.ravel()) > 1).tolist():
        rows = np.flatnonzero(same.ravel() == number)
        if np.any(fine[rows[0]]) and np.max(np.linalg.norm(f[rows] - f[rows[0]], axis=1)) > _OTHER_G:
            raise InputError(
                f"{data.source}: positions {named(data, rows)} have identical readings at different attitudes: "
                "the logger stuck, or a row was copied; remove the rows that were not measured"
            )
    if due is not None:
        _refuse_stuck(data, due, fine)


def _fine(data: PositionSet) -> Bool[np.ndarray, "positions 3"]:
    """Which readings are not multiples of a coarse step, which would repeat by chance."""
    return np.abs(data.readings / _COARSE_G - np.round(data.readings / _COARSE_G)) > 1e-6


def _refuse_clipped(
    data: PositionSet, due: Float[np.ndarray, "positions 3"], fine: Bool[np.ndarray, "positions 3"]
) -> None:
    """Reject an axis whose largest readings are equal in every digit, if they are far below the prediction, or too many, or at
    too round a value, for coincidence."""
    for end in equal_ends(data.readings):
        beyond = float(np.max(np.abs(due[end.rows, end.axis]))) - end.size
        if np.mean(fine[:, end.axis]) > 0.5 and (beyond > _BEYOND_G or end.chance < _IMPROBABLE):
            expected = (
                f"where up to {end.size + beyond:.2f} g is expected"
                if beyond > _BEYOND_G
                else "which is not a coincidence"
            )
            axis = AXES[end.axis]
            raise InputError(
                f"{data.source}: axis {axis} reads {end.size:.9g} g, of either sign, at {len(end.rows)} positions and never "
                f"more, {expected}: it is clipped at the end of its range (clipping.{axis}); choose a larger range, or remove "
                f"positions {named(data, end.rows)}"
            )


def _refuse_stuck(
    data: PositionSet, due: Float[np.ndarray, "positions 3"], fine: Bool[np.ndarray, "positions 3"]
) -> None:
    """Reject an axis that does not change between different attitudes."""
    for axis, column in enumerate(data.readings.T):
        for rows in np.split(np.arange(len(data)), np.flatnonzero(np.diff(column) != 0) + 1):
            if len(rows) >= _FEWEST_STUCK and fine[rows[0], axis] and np.ptp(due[rows, axis]) > _OTHER_G:
                raise InputError(
                    f"{data.source}: axis {AXES[axis]} reads exactly {column[rows[0]]:.9g} g at positions {named(data, rows)}, "
                    f"where it must change by {np.ptp(due[rows, axis]):.2g} g: it stuck; remove the rows that were not measured"
                )


class EqualEnd(NamedTuple):
    """Equal readings at the end of the range of an axis.

    `axis`: its index. `rows`: positions. `size`: absolute value, g; of either sign or of one. `chance`: probability of so many
    equal readings, at so round a value, by coincidence.
    """

    axis: int
    rows: Int[np.ndarray, " rows"]
    size: float
    chance: float


def equal_ends(readings: Float[np.ndarray, "positions 3"]) -> Iterator[EqualEnd]:
    """The largest readings of each axis, if several are equal."""
    tie = _chance_of_a_tie(readings)
    for axis, column in enumerate(readings.T):
        size = np.abs(column)
        for at_end in (size == size.max(), column == column.max(), column == column.min()):
            rows, end = np.flatnonzero(at_end), float(size[at_end][0])
            if len(rows) > 1 and end > _END * size.max():
                # One row written twice is one reading.
                several = len(np.unique(readings[rows], axis=0)) - 1
                decimals, of_end = _decimals(column), _decimals(size[at_end])
                # If other readings differ by only one last digit, equal ones are probable.
                near = 10.0**-decimals / np.min(end - size[~at_end], initial=end, where=size[~at_end] < end)
                others = readings[~at_end]
                as_round = max(10.0 ** (of_end - decimals), float(np.mean(_has_decimals(others, of_end))))
                yield EqualEnd(axis, rows, end, as_round * max(float(tie[axis]), float(near)) ** several)


def _chance_of_a_tie(readings: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, " 3"]:
    """Share of neighbours in size that are equal in every digit, for each axis, without its extreme readings; at
    least the share on all axes together."""
    inner = [
        np.sort(column[(column > column.min()) & (column < column.max()) & (np.abs(column) < np.abs(column).max())])
        for column in readings.T
    ]
    pairs = np.array([max(len(column) - 1, 1) for column in inner])
    ties = np.array([np.sum(np.diff(column) < 1e-12) for column in inner])
    return np.maximum(ties / pairs, (np.sum(ties) + 0.5) / np.sum(pairs))


def _decimals(values: Float[np.ndarray, " values"]) -> int:
    """Number of decimals of the values (g)."""
    whole = (bool(np.all(_has_decimals(values, digits))) for digits in range(_MOST_DECIMALS))
    return next((digits for digits, exact in enumerate(whole) if exact), _MOST_DECIMALS)


def _has_decimals(values: Float[np.ndarray, "*shape"], digits: int) -> Bool[np.ndarray, "*shape"]:
    return np.abs(values - np.round(values, digits)) < 1e-12
