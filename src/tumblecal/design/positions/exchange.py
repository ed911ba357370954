"""Positions by randomised exchange with restarts, under the time that they take on the head.

A position is removed, and the best cell that the head can measure in the time is added (Cook and Nachtsheim 1980, Technometrics
22, 315). Whole pitch settings are closed and opened too, because their time is shared by several positions; mountings and
temperatures are enumerated for the same reason.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Int

from tumblecal.design.criteria.measure import Measure, Measures
from tumblecal.design.model.limits import Limits, Occupied, in_order
from tumblecal.design.model.schedule import continued, schedule


# An exchange counts if it reduces the value by more than this share.
_GAIN = 1e-6
_PASSES = 30
# Largest number of sets of mountings and temperatures that are tried.
_SETS = 31


@dataclass(frozen=True)
class Chosen:
    """Chosen cells in an order that visits each setting once, their value, the duration in this order, and the value of
    each restart."""

    cells: Int[np.ndarray, " positions"]
    value: float
    minutes: float
    restarts: tuple[float, ...]


def exchange(
    limits: Limits,
    factory: Measures,
    *,
    restarts: int = 4,
    seed: int = 0,
    starts: Sequence[Sequence[int] | np.ndarray] = (),
) -> Chosen:
    """The best cells by a measure within limits.

    **Arguments:**

    - `factory`: the measure that begins with given cells.
    - `restarts`: from random positions; with limited time, of each set of mountings and temperatures, in rounds of half of
      the sets that remain (the first without changes of whole pitch settings). `starts`: positions to begin with in addition.
    """
    rng = np.random.default_rng(seed)
    found = [_Plan(limits, factory, rng, start).improved() for start in starts]
    sets = list(_sets(limits, rng))
    for number in range(restarts if starts else max(1, restarts)):
        tried = []
        for one in sets:
            here = replace(limits, allowed=limits.allowed & one)
            whole = len(sets) == 1 or number > 0
            tried.append(_Plan(here, factory, rng, _random(here, rng)).improved(whole=whole))
        order = np.argsort([plan.measure.value for plan in tried], kind="stable")
        sets = [sets[k] for k in order[: (len(sets) + 1) // 2]]
        found += tried
    best = min(found, key=lambda plan: plan.measure.value)
    taken = in_order(limits.cells, best.measure.cells, limits.present)
    return Chosen(taken, best.measure.value, _minutes(limits, taken), tuple(plan.measure.value for plan in found))


def _minutes(limits: Limits, taken: np.ndarray) -> float:
    """Duration of cells in this order, from the present position on if there is one."""
    if limits.present is None:
        return schedule(limits.cells, taken, limits.times).minutes
    one = schedule(limits.cells, np.array([limits.present]), limits.times)
    return continued(limits.cells, one, taken, limits.times).minutes - one.minutes


def _sets(limits: Limits, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Cells of each set of mountings and temperatures; without a limit of time all at once, since none costs anything."""
    sitting = limits.sitting
    live = np.unique(sitting[limits.allowed])
    if not limits.timed:
        yield np.ones(len(sitting), bool)
        return
    listed = [one for size in range(1, len(live) + 1) for one in combinations(live, size) if _affordable(limits, one)]
    if len(listed) > _SETS:
        listed = [listed[k] for k in np.sort(rng.permutation(len(listed))[:_SETS])]
    for one in listed:
        yield np.isin(sitting, one)


def _affordable(limits: Limits, sittings: Sequence[int]) -> bool:
    """Whether one position at each of these mountings and temperatures fits."""
    occupied = Occupied(limits)
    for one in sittings:
        fit = occupied.fits() & (limits.sitting == one)
        if not np.any(fit):
            return False
        occupied.change(int(np.argmax(fit)), 1)
    return True


def _random(limits: Limits, rng: np.random.Generator) -> list[int]:
    """Random cells, as many as fit; with limited time, with a random number of pitch settings."""
    cells, occupied, taken = limits.cells, Occupied(limits), list[int]()
    groups = rng.permutation(np.unique(cells.group[limits.allowed]))
    if limits.timed:
        groups = groups[: rng.integers(1, len(groups) + 1)]
    first = rng.permutation(np.flatnonzero(limits.allowed & np.isin(cells.group, groups)))
    if limits.timed:
        # One position of each mounting and temperature before the others.
        one_each = np.unique(limits.sitting[limits.allowed], return_index=True)[1]
        first = np.concatenate([rng.permutation(np.flatnonzero(limits.allowed)[one_each]), first])
    for cell in [*first, *rng.permutation(np.flatnonzero(limits.allowed))]:
        for _ in range(limits.repeats):
            if not occupied.fits()[cell]:
                break
            occupied.change(int(cell), 1)
            taken.append(int(cell))
    return taken


class _Plan:
    """Positions with their measure and the time that they take."""

    def __init__(
        self, limits: Limits, factory: Measures, rng: np.random.Generator, cells: Sequence[int] | np.ndarray
    ) -> None:
        self._limits, self._factory, self._rng = limits, factory, rng
        self._begin(cells)

    def _begin(self, cells: Sequence[int] | np.ndarray) -> None:
        self.measure: Measure = self._factory(cells)
        self._occupied = Occupied(self._limits)
        for cell in cells:
            self._occupied.change(int(cell), 1)

    def _add(self, cell: int) -> None:
        self.measure.add(cell)
        self._occupied.change(cell, 1)

    def _remove(self, cell: int) -> None:
        self.measure.remove(self.measure.cells.index(cell))
        self._occupied.change(cell, -1)

    def improved(self, *, whole: bool = True) -> "_Plan":
        """Exchange until nothing improves; with limited time also `whole` pitch settings."""
        self._trim()
        self._fill()
        for _ in range(_PASSES):
            self._exchange()
            if not whole or not self._limits.timed or not self._regroup():
                break
        return self

    def _trim(self) -> None:
        """Remove the least valuable positions of a start that exceeds the limits."""
        while self.measure.cells and self._occupied.exceeds:
            self._remove(self.measure.cells[int(np.argmin(self.measure.if_removed()))])

    def _fill(self) -> None:
        """Add the best position as long as one fits."""
        while np.any(fit := self._occupied.fits()):
            self._add(int(np.argmin(np.where(fit, self.measure.if_added(), np.inf))))

    def _exchange(self) -> None:
        """Exchange single positions in random order, until a whole pass improves nothing."""
        for _ in range(_PASSES):
            before = self.measure.value
            for cell in self._rng.permutation(self.measure.cells).tolist():
                had = self.measure.value
                self._remove(cell)
                values = np.where(self._occupied.fits(), self.measure.if_added(), np.inf)
                other = int(np.argmin(values))
                self._add(other if values[other] < had * (1 - _GAIN) else cell)
            self._fill()
            if self.measure.value > before * (1 - 1e-5):
                return

    def _regroup(self) -> bool:
        """Close each pitch setting, or open each other one in place of the least valuable positions, if that is better."""
        groups = self._limits.cells.group
        improved = False
        for group in self._rng.permutation(np.unique(groups[self._limits.allowed])):
            had, value = self.measure.cells, self.measure.value
            here = [cell for cell in had if groups[cell] == group]
            for cell in here:
                self._remove(cell)
            if not here:
                self._open(int(group))
            self._fill()
            if self.measure.value < value * (1 - _GAIN):
                improved = True
            else:
                self._begin(had)
        return improved

    def _open(self, group: int) -> None:
        """Add two positions of a pitch setting, after removing others until they fit."""
        groups = self._limits.cells.group
        within = groups == group
        for _ in range(2):
            while not np.any(fit := self._occupied.fits() & within):
                others = groups[list(self.measure.cells)] != group
                if not np.any(others):
                    return
                values = np.where(others, self.measure.if_removed(), np.inf)
                self._remove(self.measure.cells[int(np.argmin(values))])
            self._add(int(np.argmin(np.where(fit, self.measure.if_added(), np.inf))))
