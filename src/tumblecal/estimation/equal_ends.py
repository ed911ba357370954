"""Readings at the end of an axis's range that are equal to the last digit: clipped there, if it is no chance."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


# Readings are at the end of a range from this share of the largest on.
_END = 0.98
_MOST_DECIMALS = 9


class EqualEnd(NamedTuple):
    """Readings of an axis of one `size` (g), of either sign or at one end, in several `rows`; `chance`: how often so many, at
    so round a value, come by chance."""

    axis: int
    rows: Int[np.ndarray, " rows"]
    size: float
    chance: float


def equal_ends(readings: Float[np.ndarray, "positions 3"]) -> Iterator[EqualEnd]:
    """The largest readings of each axis, where several are equal."""
    tie = _chance_of_a_tie(readings)
    for axis, own in enumerate(readings.T):
        size = np.abs(own)
        for at_end in (size == size.max(), own == own.max(), own == own.min()):
            rows, end = np.flatnonzero(at_end), float(size[at_end][0])
            if len(rows) > 1 and end > _END * size.max():
                # One row written twice is one reading.
                several = len(np.unique(readings[rows], axis=0)) - 1
                decimals, of_end = _decimals(own), _decimals(size[at_end])
                # Where others are as near as the last digit, equal ones are no wonder.
                near = 10.0**-decimals / np.min(end - size[~at_end], initial=end, where=size[~at_end] < end)
                others = readings[~at_end]
                as_round = max(10.0 ** (of_end - decimals), float(np.mean(_has_decimals(others, of_end))))
                yield EqualEnd(axis, rows, end, as_round * max(float(tie[axis]), float(near)) ** several)


def _chance_of_a_tie(readings: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, " 3"]:
    """How often two readings of each axis that follow each other in size are equal to the last digit, by those that are not its
    largest or smallest, and no less than on all axes together."""
    inner = [
        np.sort(own[(own > own.min()) & (own < own.max()) & (np.abs(own) < np.abs(own).max())]) for own in readings.T
    ]
    pairs = np.array([max(len(own) - 1, 1) for own in inner])
    ties = np.array([np.sum(np.diff(own) < 1e-12) for own in inner])
    return np.maximum(ties / pairs, (np.sum(ties) + 0.5) / np.sum(pairs))


def _decimals(values: Float[np.ndarray, " values"]) -> int:
    """So many decimals (g) the values have."""
    whole = (bool(np.all(_has_decimals(values, digits))) for digits in range(_MOST_DECIMALS))
    return next((digits for digits, own in enumerate(whole) if own), _MOST_DECIMALS)


def _has_decimals(values: Float[np.ndarray, "*shape"], digits: int) -> Bool[np.ndarray, "*shape"]:
    return np.abs(values - np.round(values, digits)) < 1e-12
