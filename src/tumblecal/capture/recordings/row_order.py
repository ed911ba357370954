"""Rows that are not in the order of their clock: their places, if the clock shows them.

The longest part of the recording whose time never falls is kept as it is: the fewest rows are then displaced. Displaced rows
go where the clock has room for them: at least half a step from their neighbours, among the others or next to them. A displaced
stretch that finds no place is a second session if it is long, since its clock began again: the recording is split there and
nothing is sorted across. If it is short, it is left out.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


# A clock is regular if this share of its steps is within a quarter of the usual one.
_REGULAR, _REGULAR_WITHIN = 0.8, 0.25
# From this share of steps backwards on, disorder is the rule; the usual step is then that of the sorted times.
_OFTEN = 0.01
# Displaced stretches that are longer, and have no place, are sessions of their own.
_LONGEST_LATE = 50
# Of a second session, more than this share is closer to other rows than half a step.
_CROWDED = 0.1
# Next to the others are rows within so many steps.
_NEXT_TO = 3.0


@dataclass(frozen=True)
class RowOrder:
    """The order of the rows by their clock.

    **Arguments:**

    - `rows`: indices of the rows in order; those left out are not among them.
    - `moved`: of the rows that were displaced. `unplaced`: of those without a place. `repeated`: of those whose time is there
      already.
    - `largest_s`: longest time by which one of them is late or early.
    """

    rows: NDArray[np.int64]
    moved: NDArray[np.int64]
    unplaced: NDArray[np.int64]
    repeated: NDArray[np.int64]
    largest_s: float


def usual_step(times: NDArray[np.float64]) -> float:
    """The usual step of a clock, s; 0 if it is not regular. Rows with the same time count once."""
    steps = np.diff(times)
    steps = steps[steps != 0]
    ahead = steps[steps > 0]
    if not len(ahead):
        return 0.0
    if np.mean(steps < 0) > _OFTEN:
        ahead = np.diff(np.unique(times))
    step = float(np.median(ahead))
    return step if np.mean(np.abs(ahead - step) <= _REGULAR_WITHIN * step) >= _REGULAR else 0.0


def order_by_clock(times: NDArray[np.float64]) -> RowOrder | None:
    """The order of rows by their times (n,); None if the clock is not regular, or has no step backwards within a session."""
    step = usual_step(times)
    if not step:
        return None
    starts = np.flatnonzero(np.diff(times, prepend=np.nan) != 0)
    stamps, counts = times[starts], np.diff(np.append(starts, len(times)))
    parts, unplaced, repeated, late, largest_s = [], [], [], np.zeros(len(stamps), bool), 0.0
    waiting = [(0, len(stamps))]
    while waiting:
        first, last = waiting.pop()
        own = stamps[first:last]
        displaced = ~_longest_rising(own)
        if not displaced.any():
            parts.append(np.arange(first, last))
            continue
        split, no_place, again = _placed(own, displaced, step)
        if split is not None:
            waiting += [(first + split, last), (first, first + split)]
            continue
        kept = ~(no_place | again)
        unplaced.append(first + np.flatnonzero(no_place))
        repeated.append(first + np.flatnonzero(again))
        late[first:last] = displaced & kept
        ahead = np.maximum.accumulate(own) - own
        behind = own - np.minimum.accumulate(own[::-1])[::-1]
        largest_s = max(largest_s, float(np.maximum(ahead, behind)[displaced & kept].max(initial=0.0)))
        rows = first + np.flatnonzero(kept)
        parts.append(rows[np.argsort(stamps[rows], kind="stable")])
    if not late.any() and not any(map(len, [*unplaced, *repeated])):
        return None
    order = np.concatenate(parts)
    return RowOrder(
        _rows_of(order, starts, counts),
        _rows_of(np.flatnonzero(late), starts, counts),
        _rows_of(np.concatenate([*unplaced, []]).astype(int), starts, counts),
        _rows_of(np.concatenate([*repeated, []]).astype(int), starts, counts),
        largest_s,
    )


def _rows_of(stamps: NDArray[np.int64], starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """The rows of some stamps, in order."""
    own = counts[stamps]
    within = np.arange(own.sum()) - np.repeat(np.cumsum(own) - own, own)
    return np.repeat(starts[stamps], own) + within


def _longest_rising(stamps: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Members of a longest subsequence that rises (patience sorting); stamps that fit all others are in it without a search."""
    ahead = np.maximum.accumulate(np.append(-np.inf, stamps))[:-1]
    behind = np.minimum.accumulate(np.append(stamps, np.inf)[::-1])[::-1][1:]
    chosen = (stamps > ahead) & (stamps < behind)
    rows = np.flatnonzero(~chosen)
    values = stamps[rows].tolist()
    # Of each length the smallest last value of a rising subsequence, where it is, and what comes before each.
    lasts, places, before = list[float](), list[int](), [-1] * len(values)
    for k, value in enumerate(values):
        length = bisect_right(lasts, value)
        if length and lasts[length - 1] == value:
            continue
        before[k] = places[length - 1] if length else -1
        if length == len(lasts):
            lasts.append(value)
            places.append(k)
        else:
            lasts[length], places[length] = value, k
    k = places[-1] if places else -1
    while k >= 0:
        chosen[rows[k]] = True
        k = before[k]
    return chosen


def _placed(
    stamps: NDArray[np.float64], displaced: NDArray[np.bool_], step: float
) -> tuple[int | None, NDArray[np.bool_], NDArray[np.bool_]]:
    """Where a second session begins, if there is one; which displaced stamps have no place, and which are there already."""
    sorting = np.argsort(stamps, kind="stable")
    sorted_stamps = stamps[sorting]
    apart = np.diff(sorted_stamps, prepend=-np.inf, append=np.inf)
    nearest = np.empty(len(stamps))
    nearest[sorting] = np.minimum(apart[:-1], apart[1:])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], displaced, [False]]).astype(int))).reshape(-1, 2)
    others = stamps[~displaced]
    crowded = displaced & (nearest < step / 2)
    members = np.flatnonzero(displaced)
    places = np.searchsorted(members, edges[:, 0])
    least, most = np.minimum.reduceat(stamps[members], places), np.maximum.reduceat(stamps[members], places)
    # A stretch must be next to others, or, if it is short, among them.
    begin, end = np.searchsorted(others, least), np.searchsorted(others, most)
    short = edges[:, 1] - edges[:, 0] <= _LONGEST_LATE
    away = np.minimum(least - np.append(-np.inf, others)[begin], np.append(others, np.inf)[end] - most)
    away[short & (begin > 0) & (end < len(others))] = 0.0
    far = away > _NEXT_TO * step
    share = np.add.reduceat(crowded[members], places) / (edges[:, 1] - edges[:, 0])
    no_place, again = crowded.copy(), np.zeros(len(stamps), bool)
    for start, stop in edges[far | (share > 0)][~short[far | (share > 0)]].tolist():
        steps = np.diff(stamps[max(start - 1, 0) : stop + 1])
        k = np.searchsorted(edges[:, 0], start)
        if (far[k] or share[k] > _CROWDED) and steps.min() < 0:
            return max(start - 1, 0) + int(np.argmin(steps)) + 1, no_place, again
    for start, stop in edges[far]:
        no_place[start:stop] = True
    at = np.searchsorted(others, stamps).clip(0, len(others) - 1)
    again = no_place & (others[at] == stamps)
    return None, no_place & ~again, again
