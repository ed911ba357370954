"""The limits of a plan, number of positions and time; the positions that still fit, and the order that takes the least time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import permutations

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.chain.head_ability import HeadAbility, Times
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import Cells


# A sitting: number of the temperature, and of the mounting.
Sitting = tuple[int, int]


@dataclass(frozen=True)
class Limits:
    """The largest number of positions and the longest duration, s; infinite: no limit.

    - `repeats`: largest number of positions in one cell. `allowed`: cells that may be chosen.
    - `present`: cell in which the head is before the first position, which is then reached by a move; None: the first position
      is set already.
    """

    cells: Cells
    times: Times
    count: float
    seconds: float
    repeats: int
    allowed: Bool[np.ndarray, " cells"]
    present: int | None = None

    @cached_property
    def sittings(self) -> tuple[list[Sitting], Int[np.ndarray, " cells"]]:
        """All sittings, and the number of that of each cell."""
        pairs = np.stack([self.cells.soak, self.cells.mounting], axis=1)
        found, number = np.unique(pairs, axis=0, return_inverse=True)
        return [(int(soak), int(mounting)) for soak, mounting in found], number.ravel()

    @property
    def sitting(self) -> Int[np.ndarray, " cells"]:
        """Number of the sitting of each cell."""
        return self.sittings[1]

    @property
    def timed(self) -> bool:
        """Whether the duration is limited."""
        return bool(np.isfinite(self.seconds))

    def _used(self, number: Int[np.ndarray, " cells"]) -> list[Int[np.ndarray, " labels"]]:
        """Positions, and the present one, in each cell, pitch setting, sitting and temperature."""
        at = np.flatnonzero(number) if self.present is None else np.append(np.flatnonzero(number), self.present)
        labels = np.arange(len(number)), self.cells.group, self.sitting, self.cells.soak
        return [np.bincount(label[at], minlength=int(label.max()) + 1) for label in labels]

    def _remounts(self, used: Sequence[int] | np.ndarray) -> int:
        """The fewest remounts of some sittings, by their numbers."""
        known, number = self.sittings
        first = None if self.present is None else known[number[self.present]]
        return sittings_in_order(tuple(known[k] for k in used), first)[0]

    def duration_s(self, number: Int[np.ndarray, " cells"]) -> float:
        """Duration of so many positions in each cell, settings visited once: at most this, since the spindle need not turn at
        every change of the pitch setting."""
        used = self._used(number)
        return self._duration_s(int(number.sum()), used, self._remounts(np.flatnonzero(used[2])))

    def _duration_s(self, total: int, used: Sequence[Int[np.ndarray, " labels"]], remounts: int) -> float:
        """Duration of `total` positions with so many remounts; `used`: as from `_used`."""
        times = self.times
        distinct, groups, _, soaks = (int(np.count_nonzero(one)) for one in used)
        return (total > 0) * (
            total * (times.dwell_s + times.settle_s)
            + (distinct - 1) * times.turn_s
            + (groups - 1) * times.pitch_change_s
            + remounts * times.remount_s
            + (soaks - 1) * times.temperature_change_s
        )

    def exceeded(self, number: Int[np.ndarray, " cells"]) -> bool:
        """Whether so many positions in each cell exceed the limits."""
        return int(number.sum()) > self.count or (self.timed and self.duration_s(number) > self.seconds + 1e-9)

    def fits(self, number: Int[np.ndarray, " cells"]) -> Bool[np.ndarray, " cells"]:
        """Cells in which one more position can be measured."""
        times, cells, total = self.times, self.cells, int(number.sum())
        free = self.allowed & (number < self.repeats) & (total + 1 <= self.count)
        if not self.timed:
            return free
        at, groups, sittings, soaks = used = self._used(number)
        here = np.flatnonzero(sittings)
        now = self._remounts(here)
        rest = self.seconds - self._duration_s(total, used, now) - times.dwell_s - times.settle_s + 1e-9
        if not total and self.present is None:
            return free & (rest >= 0)
        remounts = [
            0 if count else self._remounts(np.union1d(here, [k])) - now for k, count in enumerate(sittings.tolist())
        ]
        more = (
            times.turn_s * (at == 0)
            + times.pitch_change_s * (groups == 0)[cells.group]
            + times.remount_s * np.array(remounts)[self.sitting]
            + times.temperature_change_s * (soaks == 0)[cells.soak]
        )
        return free & (more <= rest)


def limits_of(
    cells: Cells,
    ability: HeadAbility,
    *,
    count: int | None = None,
    minutes: float | None = None,
    allowed: Bool[np.ndarray, " cells"] | None = None,
    repeats: int = 1,
    present: int | None = None,
) -> Limits:
    """The limits of a plan: `count` positions, or as many as are best within `minutes`, or both.

    `allowed`: cells that may be chosen; all if omitted. `repeats`: largest number of positions in one cell. `present`: the
    cell of the last position of a running measurement.

    **Raises:** `InputError` if neither a number nor a duration is stated, or no position fits.
    """
    if count is None and minutes is None:
        raise InputError("a plan needs a number of positions or a duration; state one")
    mask = np.ones(len(cells), bool) if allowed is None else np.asarray(allowed, bool)
    most, seconds = np.inf if count is None else count, np.inf if minutes is None else 60.0 * minutes
    limits = Limits(cells, ability.times, most, seconds, repeats, mask, present)
    if not np.any(limits.fits(np.zeros(len(cells), int))):
        least = (ability.times.dwell_s + ability.times.settle_s) / 60
        raise InputError(f"no position fits; one takes {least:.3g} min, in an allowed setting")
    return limits


def most_visits(limits: Limits) -> tuple[int, int]:
    """The most visits of one pitch setting in a mounting, and of one mounting, that any order within the limits has: between
    two visits of a setting is at least one position in another one, and both changes take time."""
    cells, times = limits.cells, limits.times
    mounting, pitch = cells.mounting[limits.allowed], cells.pitch[limits.allowed]
    dwell = times.dwell_s + times.settle_s

    def most(label: np.ndarray, change_s: float) -> int:
        number = np.bincount(label)
        if np.count_nonzero(number) == 1:
            return 1
        total = min(limits.count, limits.repeats * number.sum())
        if limits.timed:
            total = min(total, (limits.seconds + change_s) / (dwell + change_s) + 1e-9)
        return max(1, int(min(limits.repeats * number.max(), (total + 1) // 2)))

    both = np.unique(np.stack([mounting, pitch]), axis=1, return_inverse=True)[1].ravel()
    return most(both, times.pitch_change_s), most(mounting, times.remount_s)


def in_order(
    cells: Cells, taken: Sequence[int] | np.ndarray, present: int | None = None
) -> Int[np.ndarray, " positions"]:
    """Cells in an order that visits each setting once: temperatures upwards, the fewest remounts, pitch settings there and
    back, and within a pitch setting one turn of the spindle from its last angle on. The `present` cell comes first."""
    taken, order = np.asarray(taken, int), list[int]()
    angle = 0.0 if present is None else float(cells.alpha_deg[present])
    sitting_of = list(zip(cells.soak.tolist(), cells.mounting.tolist(), strict=True))
    used = {sitting_of[k] for k in taken} | (set() if present is None else {sitting_of[present]})
    first = None if present is None else sitting_of[present]
    for number, sitting in enumerate(sittings_in_order(tuple(sorted(used)), first)[1]):
        here = taken[[sitting_of[k] == sitting for k in taken]]
        settings = np.unique(cells.pitch[here])[:: -1 if number % 2 else 1]
        if present is not None:
            settings = settings[np.argsort(settings != cells.pitch[present], kind="stable")]
        for pitch in settings:
            group = here[cells.pitch[here] == pitch]
            turn = np.mod(cells.alpha_deg[group] - angle + 1e-9, 360.0)
            order += group[np.argsort(turn, kind="stable")].tolist()
            angle = float(cells.alpha_deg[order[-1]])
    return np.array(order, int)


@lru_cache(maxsize=10_000)
def sittings_in_order(sittings: tuple[Sitting, ...], present: Sitting | None = None) -> tuple[int, tuple[Sitting, ...]]:
    """The fewest remounts of some sittings, and their order: temperatures upwards, that of the `present` one first (dynamic
    programming over the last mounting)."""
    best: dict[int, tuple[int, tuple[Sitting, ...]]] = {} if present is None else {present[1]: (0, ())}
    for soak in sorted(
        {soak for soak, _ in sittings}, key=lambda one: (present is not None and one != present[0], one)
    ):
        mounts, before = sorted(mounting for one, mounting in sittings if one == soak), best
        ends = [(mounts[0], mounts[0])] if len(mounts) == 1 else list(permutations(mounts, 2))
        best = {}
        for first, last in ends:
            middle = [mounting for mounting in mounts if mounting not in (first, last)]
            here = tuple((soak, mounting) for mounting in dict.fromkeys((first, *middle, last)))
            for mounting, (remounts, order) in before.items() or [(first, (0, ()))]:
                found = remounts + (mounting != first) + len(mounts) - 1, (*order, *here)
                best[last] = min(best.get(last, found), found)
    return min(best.values()) if best else (0, ())
