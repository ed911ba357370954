"""The limits of a plan, number of positions and time; the positions that still fit, and the order that takes the least time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import permutations, product

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.chain.head_ability import HeadAbility, Times
from tumblecal.ground.errors import InputError
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
    count: float
    seconds: float
    repeats: int
    allowed: Bool[np.ndarray, " cells"]
    present: int | None = None

    @property
    def timed(self) -> bool:
        """Whether the duration is limited."""
        return bool(np.isfinite(self.seconds))

    @cached_property
    def _sittings(self) -> dict[int, Sitting]:
        return dict(zip(self.cells.sitting.tolist(), self.cells.sittings, strict=True))

    def _remounts(self, sittings: Sequence[int]) -> int:
        """The fewest remounts of some sittings, by their numbers."""
        first = None if self.present is None else self.cells.sittings[self.present]
        return sittings_in_order(tuple(self._sittings[k] for k in sorted(sittings)), first)[0]

    def durations_s(self, number: Int[np.ndarray, " cells"]) -> tuple[float, Float[np.ndarray, " cells"]]:
        """Duration of so many positions in each cell, settings visited once, and what one more in each cell adds. It is at most
        this, since the spindle need not turn at every change of the pitch setting."""
        times, cells = self.times, self.cells
        at, dwell = np.flatnonzero(number), float(times.dwell_s + times.settle_s)
        at = at if self.present is None else np.append(at, self.present)
        if not len(at):
            return 0.0, np.full(len(number), dwell)
        labels = (np.arange(len(number)), cells.group, cells.soak, cells.sitting)
        steps = (times.turn_s, times.pitch_change_s, times.temperature_change_s)
        used = [np.bincount(label[at], minlength=int(label.max()) + 1) > 0 for label in labels]
        here = np.flatnonzero(used[3]).tolist()
        now = self._remounts(here)
        remounts = np.array(
            [0 if open else self._remounts([*here, k]) - now for k, open in enumerate(used[3].tolist())]
        )
        total, more = number.sum() * dwell + now * times.remount_s, dwell + times.remount_s * remounts[cells.sitting]
        for step, label, open in zip(steps, labels, used, strict=False):
            total, more = total + step * (np.count_nonzero(open) - 1), more + step * ~open[label]
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
    times = limits.times
    dwell = times.dwell_s + times.settle_s

    def most(label: np.ndarray, change_s: float) -> int:
        number = limits.repeats * np.bincount(label[limits.allowed])
        if np.count_nonzero(number) == 1:
            return 1
        total = min(limits.count, number.sum())
        if limits.timed:
            total = min(total, (limits.seconds + change_s) / (dwell + change_s) + 1e-9)
        return max(1, int(min(number.max(), (total + 1) // 2)))

    return most(limits.cells.setting, times.pitch_change_s), most(limits.cells.mounting, times.remount_s)


def in_order(
    cells: Cells,
    taken: Sequence[int] | np.ndarray,
    present: int | None = None,
    rng: np.random.Generator | None = None,
) -> Int[np.ndarray, " positions"]:
    """Cells in an order that visits each setting once: temperatures upwards, the fewest remounts, pitch settings there and
    back, and within a pitch setting one turn of the spindle from its last angle on; pitch settings and their positions in
    random order with `rng`. The `present` cell comes first."""
    taken, order, sitting_of = np.asarray(taken, int), list[int](), cells.sittings
    angle, first = (0.0, None) if present is None else (float(cells.alpha_deg[present]), sitting_of[present])
    used = {*(sitting_of[k] for k in taken), *([] if first is None else [first])}
    for number, sitting in enumerate(sittings_in_order(tuple(sorted(used)), first)[1]):
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
def sittings_in_order(sittings: tuple[Sitting, ...], present: Sitting | None = None) -> tuple[int, tuple[Sitting, ...]]:
    """The fewest remounts of some sittings, and their order: temperatures upwards, that of the `present` one first (dynamic
    programming over the last mounting)."""
    # The fewest remounts and the order, by the last mounting.
    nothing: tuple[int, tuple[Sitting, ...]] = (0, ())
    best = {mounting: nothing for _, mounting in ([present] if present else sittings)}
    for soak in sorted(
        {soak for soak, _ in sittings}, key=lambda one: (present is not None and one != present[0], one)
    ):
        mounts, before, best = sorted(mounting for one, mounting in sittings if one == soak), best, {}
        ends = permutations(mounts, 2) if len(mounts) > 1 else [(mounts[0], mounts[0])]
        for (first, last), (from_mount, (remounts, order)) in product(ends, before.items()):
            path = dict.fromkeys((first, *(mounting for mounting in mounts if mounting != last), last))
            here = tuple((soak, mounting) for mounting in path)
            found = remounts + (from_mount != first) + len(mounts) - 1, (*order, *here)
            best[last] = min(best.get(last, found), found)
    return min(best.values(), default=nothing)
