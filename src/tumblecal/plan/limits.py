"""The time that positions take in an order, and the limits of a plan: number of positions, time, cells that are allowed."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.chain.head_ability import Times
from tumblecal.plan.cells import Cells, Labels, Numbers


@dataclass(frozen=True)
class Schedule:
    """Positions in measuring order, or several orders of them (n).

    - `cells`: number of the cell of each position. `start_s`: of each dwell; `end_s`: of the last one.
    - `pitch_visit`, `mount_visit`: number of the visit of the pitch setting and of the mounting that each position belongs to:
      both are set again whenever they change, the pitch also with the mounting.
    """

    cells: Numbers
    start_s: Float[np.ndarray, "*n positions"]
    end_s: float | Float[np.ndarray, "*n"]
    pitch_visit: Numbers
    mount_visit: Numbers

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def minutes(self) -> float:
        """Duration, min."""
        return float(self.end_s) / 60


def schedule(cells: Cells, order: Numbers, times: Times, measured: Sequence[int] | np.ndarray = ()) -> Schedule:
    """The schedule of some cells in this order, or in each of several, after those that are `measured` already.

    The first position has its mounting, pitch setting and temperature already.
    """
    order = np.asarray(order, int)
    known = np.broadcast_to(np.asarray(measured, int), (*order.shape[:-1], len(measured)))
    path = np.concatenate([known, order], axis=-1)
    before, after = path[..., :-1], path[..., 1:]
    remounted = cells.mounting[before] != cells.mounting[after]
    changed = remounted | (cells.pitch[before] != cells.pitch[after])
    zero = np.zeros((*path.shape[:-1], 1))
    start, pitch, mount = (
        np.concatenate([zero, np.cumsum(each, axis=-1)], axis=-1)
        for each in (_steps_s(cells, times, before, after), changed, remounted)
    )
    start += times.settle_s
    return Schedule(path, start, start[..., -1] + times.dwell_s, pitch.astype(int), mount.astype(int))


def _steps_s(cells: Cells, times: Times, before: Numbers, after: Numbers) -> Float[np.ndarray, "*n positions"]:
    """Time from the start of a dwell in one cell to that of the next one in another cell."""
    turned, tilted, remounted, heated = (
        label[before] != label[after] for label in (cells.alpha_deg, cells.pitch, cells.mounting, cells.soak)
    )
    moved = times.turn_s * turned + times.pitch_change_s * (tilted | remounted) + times.remount_s * remounted
    return times.dwell_s + times.settle_s + moved + times.temperature_change_s * heated


def in_order(
    cells: Cells,
    taken: Sequence[int] | np.ndarray,
    present: int | None = None,
    rng: np.random.Generator | None = None,
) -> Numbers:
    """Cells in an order that visits each setting once: temperatures upwards; mountings, pitch settings and the spindle there
    and back. The `present` cell and its setting come first. With `rng`, pitch settings and their positions are in random order.
    """
    group, turn = cells.group, np.where(cells.group % 2, -cells.alpha_deg, cells.alpha_deg)
    if rng is not None:
        group, turn = rng.permutation(len(cells))[group], rng.random(len(cells))
    keys = [turn, group, cells.sitting]
    if present is not None:
        labels = (np.arange(len(cells)), cells.group, cells.sitting, cells.soak)
        keys += [label != label[present] for label in labels]
    taken = np.asarray(taken, int)
    return taken[np.lexsort([key[taken] for key in keys])]


@dataclass(frozen=True)
class Limits:
    """The largest number of positions and the longest duration, s; infinite: no limit.

    - `repeats`: largest number of positions in one cell. `allowed`: cells that may be chosen.
    - `present`: cell in which the head is before the first position, which is then reached by a move; None: the first position
      is set already.
    """

    cells: Cells
    times: Times
    allowed: Bool[np.ndarray, " cells"]
    count: float = np.inf
    seconds: float = np.inf
    repeats: int = 1
    present: int | None = None

    @property
    def timed(self) -> bool:
        """Whether the duration is limited."""
        return bool(np.isfinite(self.seconds))

    @cached_property
    def sets(self) -> list[Bool[np.ndarray, " cells"]]:
        """The allowed cells of every set of temperatures and of mountings, larger sets first; without a limit of time those of
        all, since none costs anything."""
        if not self.timed:
            return [self.allowed]
        inside = list[list[np.ndarray]]()
        for label in (self.cells.soak, self.cells.mounting):
            every = np.unique(label[self.allowed])
            sizes = range(len(every), 0, -1)
            inside.append([np.isin(label, one) for size in sizes for one in combinations(every, size)])
        return [self.allowed & one & other for one, other in product(*inside)]

    @cached_property
    def _place(self) -> Labels:
        """Place of each cell in the order."""
        return np.argsort(in_order(self.cells, np.arange(len(self.cells)), self.present))

    def _path(self, taken: Sequence[int] | np.ndarray) -> Numbers:
        """The way through some cells, from the present one on."""
        taken = np.asarray(taken, int)
        start = [] if self.present is None else [self.present]
        return np.append(np.array(start, int), taken[np.argsort(self._place[taken], kind="stable")])

    def duration_s(self, taken: Sequence[int] | np.ndarray) -> float:
        """Duration of positions in some cells, settings visited once."""
        path, dwell_s = self._path(taken), self.times.dwell_s + self.times.settle_s
        steps = _steps_s(self.cells, self.times, path[:-1], path[1:])
        return float(np.sum(steps)) + dwell_s * (self.present is None and len(path) > 0)

    def exceeded(self, taken: Sequence[int] | np.ndarray) -> bool:
        """Whether positions in some cells exceed the limits."""
        return len(taken) > self.count or (self.timed and self.duration_s(taken) > self.seconds + 1e-9)

    def fits(self, taken: Sequence[int] | np.ndarray) -> Bool[np.ndarray, " cells"]:
        """Cells in which one more position can be measured, in addition to some."""
        number = np.bincount(np.asarray(taken, int), minlength=len(self.cells))
        free = self.allowed & (number < self.repeats) & (len(taken) + 1 <= self.count)
        if not self.timed:
            return free
        path, every = self._path(taken), np.arange(len(self.cells))
        if not len(path):
            return free & (self.times.dwell_s + self.times.settle_s <= self.seconds + 1e-9)
        # One more position is measured between two of the others, or after or before all.
        behind = np.maximum(np.searchsorted(self._place[path], self._place, side="right"), self.present is not None)
        before, after = path[behind - 1], path[np.minimum(behind, len(path) - 1)]
        to, on, direct = (
            _steps_s(self.cells, self.times, *pair) for pair in ((before, every), (every, after), (before, after))
        )
        more = np.where(behind == 0, on, np.where(behind == len(path), to, to + on - direct))
        return free & (self.duration_s(taken) + more <= self.seconds + 1e-9)

    @property
    def most_visits(self) -> tuple[int, int]:
        """The most visits of one pitch setting in a mounting, and of one mounting, in any order within the limits. Between two
        visits of a setting is at least one position in another one, and both changes take time."""
        times, most = self.times, list[int]()
        dwell_s = times.dwell_s + times.settle_s
        for label, change_s in ((self.cells.setting, times.pitch_change_s), (self.cells.mounting, times.remount_s)):
            number = self.repeats * np.bincount(label[self.allowed])
            total = min(self.count, number.sum(), (self.seconds + change_s) / (dwell_s + change_s) + 1e-9)
            several = np.count_nonzero(number) > 1
            most.append(max(1, int(min(number.max(), (total + 1) // 2))) if several else 1)
        return most[0], most[1]
