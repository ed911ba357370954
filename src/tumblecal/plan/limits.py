"""The limits of a plan, number of positions and time; the positions that still fit, and the order that takes the least time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations, product

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.chain.head_ability import Times
from tumblecal.plan.cells import Cells, Sitting


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
            subsets = (one for size in range(len(every), 0, -1) for one in combinations(every, size))
            inside.append([np.isin(label, one) for one in subsets])
        return [self.allowed & one & other for one, other in product(*inside)]

    def durations_s(self, number: Int[np.ndarray, " cells"]) -> tuple[float, Float[np.ndarray, " cells"]]:
        """Duration of so many positions in each cell, settings visited once, and what one more in each cell adds. It is at most
        this, since the spindle need not turn at every change of the pitch setting."""
        times, cells = self.times, self.cells
        at, dwell = np.flatnonzero(number), float(times.dwell_s + times.settle_s)
        at = at if self.present is None else np.append(at, self.present)
        if not len(at):
            return 0.0, np.full(len(number), dwell)
        first = None if self.present is None else cells.sittings[self.present]
        here = frozenset(cells.sittings[k] for k in at)
        now = sittings_in_order(here, first)[0]
        remounts = {one: sittings_in_order(here | {one}, first)[0] - now for one in {*cells.sittings}}
        total = number.sum() * dwell + now * times.remount_s
        more = dwell + times.remount_s * np.array([remounts[one] for one in cells.sittings])
        labels = (np.arange(len(number)), cells.group, cells.soak)
        steps = (times.turn_s, times.pitch_change_s, times.temperature_change_s)
        for step, label in zip(steps, labels, strict=True):
            used = np.isin(label, label[at])
            total, more = total + step * (len(np.unique(label[at])) - 1), more + step * ~used
        return float(total), more

    def exceeded(self, number: Int[np.ndarray, " cells"]) -> bool:
        """Whether so many positions in each cell exceed the limits."""
        return int(number.sum()) > self.count or (self.timed and self.durations_s(number)[0] > self.seconds + 1e-9)

    def fits(self, number: Int[np.ndarray, " cells"]) -> Bool[np.ndarray, " cells"]:
        """Cells in which one more position can be measured."""
        free = self.allowed & (number < self.repeats) & (number.sum() + 1 <= self.count)
        if not self.timed:
            return free
        total, more = self.durations_s(number)
        return free & (total + more <= self.seconds + 1e-9)


def most_visits(limits: Limits) -> tuple[int, int]:
    """The most visits of one pitch setting in a mounting, and of one mounting, that any order within the limits has: between
    two visits of a setting is at least one position in another one, and both changes take time."""
    times, most = limits.times, list[int]()
    dwell = times.dwell_s + times.settle_s
    for label, change_s in ((limits.cells.setting, times.pitch_change_s), (limits.cells.mounting, times.remount_s)):
        number = limits.repeats * np.bincount(label[limits.allowed])
        total = min(limits.count, number.sum(), (limits.seconds + change_s) / (dwell + change_s) + 1e-9)
        several = np.count_nonzero(number) > 1
        most.append(max(1, int(min(number.max(), (total + 1) // 2))) if several else 1)
    return most[0], most[1]


def in_order(
    cells: Cells,
    taken: Sequence[int] | np.ndarray,
    present: int | None = None,
    rng: np.random.Generator | None = None,
) -> Int[np.ndarray, " positions"]:
    """Cells in an order that visits each setting once: temperatures upwards, few remounts, pitch settings there and
    back, and within a pitch setting one turn of the spindle from its last angle on; pitch settings and their positions in
    random order with `rng`. The `present` cell comes first."""
    taken, order, sitting_of = np.asarray(taken, int), list[int](), cells.sittings
    angle, first = (0.0, None) if present is None else (float(cells.alpha_deg[present]), sitting_of[present])
    used = frozenset([*(sitting_of[k] for k in taken), *([] if first is None else [first])])
    for number, sitting in enumerate(sittings_in_order(used, first)[1]):
        here = taken[[sitting_of[k] == sitting for k in taken]]
        settings = np.unique(cells.pitch[here])[:: -1 if number % 2 else 1]
        settings = settings if rng is None else rng.permutation(settings)
        if present is not None:
            settings = settings[np.argsort(settings != cells.pitch[present], kind="stable")]
        for pitch in settings:
            group = here[cells.pitch[here] == pitch]
            turn = np.mod(cells.alpha_deg[group] - angle + 1e-9, 360.0) if rng is None else rng.random(len(group))
            order += group[np.argsort(turn, kind="stable")].tolist()
            angle = float(cells.alpha_deg[order[-1]])
    return np.array(order, int)


@lru_cache(maxsize=10_000)
def sittings_in_order(sittings: frozenset[Sitting], present: Sitting | None = None) -> tuple[int, tuple[Sitting, ...]]:
    """Remounts of some sittings, and their order: temperatures upwards, that of the `present` one first; at each temperature
    the last mounting first, and one that the next temperature needs last."""
    mounts_at, remounts, order = dict[int, set[int]](), 0, list[Sitting]()
    for soak, mounting in sorted(sittings, key=lambda one: (present is not None and one[0] != present[0], one)):
        mounts_at.setdefault(soak, set()).add(mounting)
    last = None if present is None else present[1]
    for (soak, mounts), following in zip(mounts_at.items(), [*mounts_at.values(), set[int]()][1:], strict=True):
        for mounting in sorted(mounts, key=lambda one: (one != last, one in following, one)):
            remounts += last not in (None, mounting)
            order.append((soak, mounting))
            last = mounting
    return remounts, tuple(order)
