"""The limits of a plan, number of positions and time, and the positions that still fit."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.chain.head_ability import HeadAbility, Times
from tumblecal.design.model.cells import Cells
from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class Limits:
    """The largest number of positions and the longest duration, s; infinite: no limit.

    `repeats`: largest number of positions in one cell. `allowed`: cells that may be chosen. `present`: cell in which the head
    is before the first position, which is then reached by a move; None: the first position is set already.
    """

    cells: Cells
    times: Times
    count: float
    seconds: float
    repeats: int
    allowed: Bool[np.ndarray, " cells"]
    present: int | None = None

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Temperature and mounting of each of their combinations."""
        found = np.unique(np.stack([self.cells.soak, self.cells.mounting], axis=1), axis=0)
        return [(int(soak), int(mounting)) for soak, mounting in found]

    @cached_property
    def sitting(self) -> Int[np.ndarray, " cells"]:
        """Number of the combination of temperature and mounting of each cell."""
        pairs = np.stack([self.cells.soak, self.cells.mounting], axis=1)
        return np.unique(pairs, axis=0, return_inverse=True)[1].ravel()

    @property
    def timed(self) -> bool:
        """Whether the duration is limited."""
        return bool(np.isfinite(self.seconds))


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
    seconds = np.inf if minutes is None else 60.0 * minutes
    limits = Limits(cells, ability.times, np.inf if count is None else count, seconds, repeats, mask, present)
    if not np.any(Occupied(limits).fits()):
        least = (ability.times.dwell_s + ability.times.settle_s) / 60
        raise InputError(f"no position fits; one takes {least:.3g} min, in an allowed setting")
    return limits


@dataclass
class Occupied:
    """How often each cell is occupied; with that, its pitch settings, mountings and temperatures, each visited once."""

    limits: Limits
    cell: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        cells, present = self.limits.cells, self.limits.present
        self.cell = np.zeros(len(cells), int)
        self._group, self._sitting, self._soak = (
            np.zeros(int(label.max()) + 1, int) for label in (cells.group, self.limits.sitting, cells.soak)
        )
        self._set = np.zeros(len(cells), int)
        if present is not None:
            self._count(present, 1)

    def change(self, cell: int, by: int) -> None:
        """Add a position (1) or remove it (-1)."""
        self.cell[cell] += by
        self._count(cell, by)

    def _count(self, cell: int, by: int) -> None:
        """Count the settings of a cell."""
        cells = self.limits.cells
        self._set[cell] += by
        self._group[cells.group[cell]] += by
        self._sitting[self.limits.sitting[cell]] += by
        self._soak[cells.soak[cell]] += by

    @property
    def _sittings(self) -> tuple[tuple[int, int], ...]:
        """Temperature and mounting of each occupied combination."""
        return tuple(pair for pair, count in zip(self.limits.pairs, self._sitting, strict=True) if count)

    def _remounts(self, pairs: tuple[tuple[int, int], ...]) -> int:
        present = self.limits.present
        return sittings_in_order(pairs, None if present is None else self.limits.pairs[self.limits.sitting[present]])[0]

    @property
    def seconds(self) -> float:
        """Duration: at most this, since the spindle need not turn at every change of the pitch setting."""
        times, total = self.limits.times, int(self.cell.sum())
        if not total:
            return 0.0
        distinct, groups, soaks = (int(np.count_nonzero(counts)) for counts in (self._set, self._group, self._soak))
        return (
            total * (times.dwell_s + times.settle_s)
            + (distinct - 1) * times.turn_s
            + (groups - 1) * times.pitch_change_s
            + self._remounts(self._sittings) * times.remount_s
            + (soaks - 1) * times.temperature_change_s
        )

    @property
    def exceeds(self) -> bool:
        """Whether there are more positions, or a longer duration, than the limits allow."""
        return int(self.cell.sum()) > self.limits.count or self.seconds > self.limits.seconds + 1e-9

    def fits(self) -> Bool[np.ndarray, " cells"]:
        """Cells in which one more position can be measured."""
        limits, cells, times = self.limits, self.limits.cells, self.limits.times
        total = int(self.cell.sum())
        if total + 1 > limits.count:
            return np.zeros(len(cells), bool)
        free = limits.allowed & (self.cell < limits.repeats)
        if not limits.timed:
            return free
        left = limits.seconds - self.seconds - times.dwell_s - times.settle_s + 1e-9
        if not total and limits.present is None:
            return free & (left >= 0)
        here = self._sittings
        remounts = [
            0 if count else self._remounts(tuple(sorted((*here, pair)))) - self._remounts(here)
            for pair, count in zip(limits.pairs, self._sitting, strict=True)
        ]
        more = (
            times.turn_s * (self._set == 0)
            + times.pitch_change_s * (self._group == 0)[cells.group]
            + times.remount_s * np.array(remounts)[limits.sitting]
            + times.temperature_change_s * (self._soak == 0)[cells.soak]
        )
        return free & (more <= left)


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
        positions = limits.repeats * number.max()
        total = min(limits.count, limits.repeats * number.sum())
        if limits.timed:
            total = min(total, (limits.seconds + change_s) / (dwell + change_s) + 1e-9)
        return max(1, int(min(positions, (total + 1) // 2)))

    both = np.unique(np.stack([mounting, pitch]), axis=1, return_inverse=True)[1].ravel()
    return most(both, times.pitch_change_s), most(mounting, times.remount_s)


def in_order(
    cells: Cells, taken: Sequence[int] | np.ndarray, present: int | None = None
) -> Int[np.ndarray, " positions"]:
    """Cells in an order that visits each setting once: temperatures upwards, the fewest remounts, pitch settings there and
    back, and within a pitch setting one turn of the spindle from its last angle on. The `present` cell comes first."""
    taken, order = np.asarray(taken, int), list[int]()
    angle = 0.0 if present is None else float(cells.alpha_deg[present])
    before = taken if present is None else np.append(taken, present)
    pairs = np.unique(np.stack([cells.soak[before], cells.mounting[before]], axis=1), axis=0)
    first = None if present is None else (int(cells.soak[present]), int(cells.mounting[present]))
    for number, (soak, mounting) in enumerate(sittings_in_order(tuple(map(tuple, pairs.tolist())), first)[1]):
        here = taken[(cells.soak[taken] == soak) & (cells.mounting[taken] == mounting)]
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
def sittings_in_order(
    pairs: tuple[tuple[int, int], ...], present: tuple[int, int] | None = None
) -> tuple[int, tuple[tuple[int, int], ...]]:
    """The fewest remounts of combinations of temperature and mounting, and their order: temperatures upwards, that of the
    `present` one first (dynamic programming)."""
    # By the last mounting: remounts, then the order.
    best: dict[int, tuple[int, tuple[tuple[int, int], ...]]] = {} if present is None else {present[1]: (0, ())}
    for soak in sorted(
        {soak for soak, _ in pairs}, key=lambda soak: (present is not None and soak != present[0], soak)
    ):
        mounts, then = sorted(mounting for at, mounting in pairs if at == soak), dict(best)
        best = {}
        for last in mounts:
            for first in mounts:
                if (first == last) != (len(mounts) == 1):
                    continue
                middle = [mounting for mounting in mounts if mounting not in (first, last)]
                here = tuple((soak, mounting) for mounting in dict.fromkeys((first, *middle, last)))
                for before, (remounts, order) in then.items() or [(first, (0, ()))]:
                    found = remounts + (before != first) + len(mounts) - 1, (*order, *here)
                    best[last] = min(best.get(last, found), found)
    return min(best.values()) if best else (0, ())
