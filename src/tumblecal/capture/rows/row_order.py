"""Rows that are not in the order of their clock, and their correct places if the clock shows them.

The longest part of the recording whose time never falls is not changed, so the number of displaced rows is smallest. Displaced
rows are moved to gaps of the clock: at least half a step from their neighbours, among the others or next to them. A long
displaced stretch without such a place is a second session whose clock restarted: the recording is split there, and rows are
not sorted across the split. A short one is left out.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.still.blocks import stretches_of


# A clock is regular if this share of its steps is within a quarter of the usual one.
_REGULAR, _REGULAR_WITHIN = 0.8, 0.25
# With this share of steps backwards or more, the usual step is that of the sorted times.
_OFTEN = 0.01
# Longer displaced stretches without a place are separate sessions.
_LONGEST_LATE = 50
# More than this share of a second session is closer to other rows than half a step.
_CROWDED = 0.1
# Rows within this many steps are next to the others.
_NEXT_TO = 3.0


@dataclass(frozen=True)
class RowOrder:
    """The order of the rows by their clock.

    **Arguments:**

    - `rows`: indices of the rows in order, without excluded rows.
    - `moved`: indices of displaced rows. `unplaced`: of rows without a place. `repeated`: of rows whose time occurs already.
    - `largest_s`: longest time by which a displaced row is late or early, s.
    """

    rows: NDArray[np.int64]
    moved: NDArray[np.int64]
    unplaced: NDArray[np.int64]
    repeated: NDArray[np.int64]
    largest_s: float


def usual_step(times: NDArray[np.float64]) -> float:
    """The usual step of a clock, s; 0 if it is not regular. Rows with equal times count as one."""
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
        session = stamps[first:last]
        displaced = ~_longest_rising(session)
        if not displaced.any():
            parts.append(np.arange(first, last))
            continue
        split, no_place, again = _placed(session, displaced, step)
        if split is not None:
            waiting += [(first + split, last), (first, first + split)]
            continue
        placed = ~(no_place | again)
        unplaced.append(first + np.flatnonzero(no_place))
        repeated.append(first + np.flatnonzero(again))
        late[first:last] = displaced & placed
        ahead = np.maximum.accumulate(session) - session
        behind = session - np.minimum.accumulate(session[::-1])[::-1]
        largest_s = max(largest_s, float(np.maximum(ahead, behind)[displaced & placed].max(initial=0.0)))
        rows = first + np.flatnonzero(placed)
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
    return stretches_of(starts[stamps], counts[stamps])[0]


def _longest_rising(stamps: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Members of a longest rising subsequence (patience sorting); stamps in order with all others need no search."""
    ahead = np.maximum.accumulate(np.append(-np.inf, stamps))[:-1]
    behind = np.minimum.accumulate(np.append(stamps, np.inf)[::-1])[::-1][1:]
    chosen = (stamps > ahead) & (stamps < behind)
    rows = np.flatnonzero(~chosen)
    values = stamps[rows].tolist()
    # For each length: the smallest last value of a rising subsequence, its place, and its predecessor.
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
    """The start of a second session, if there is one; the displaced stamps without a place, and those that occur already."""
    sorting = np.argsort(stamps, kind="stable")
    sorted_stamps = stamps[sorting]
    gaps = np.diff(sorted_stamps, prepend=-np.inf, append=np.inf)
    nearest = np.empty(len(stamps))
    nearest[sorting] = np.minimum(gaps[:-1], gaps[1:])
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
