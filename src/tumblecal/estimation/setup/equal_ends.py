"""Readings at the end of an axis's range that are equal in every digit: clipped, unless by coincidence."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


# Readings of at least this share of the largest are at the end of the range.
_END = 0.98
_MOST_DECIMALS = 9


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
