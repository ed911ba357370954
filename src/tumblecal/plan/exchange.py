"""Positions by randomised exchange with restarts, under the time that they take on the head.

A position is removed, and the best cell that the head can measure in the time is added (Cook and Nachtsheim 1980, Technometrics
22, 315). Whole pitch settings are closed and opened too, because their time is shared by several positions; mountings and
temperatures are enumerated for the same reason.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.plan.limits import Limits, in_order
from tumblecal.plan.set_value import SetValue, Term


# An exchange counts if it reduces the value by more than this share.
_GAIN = 1e-6
# Largest number of passes, and of positions that are tried in each.
_PASSES, _TRIED = 30, 48
# Largest number of sets of mountings and temperatures that are tried.
_SETS = 31


@dataclass(frozen=True)
class Chosen:
    """Chosen cells in an order that visits each setting once, and their value."""

    cells: Int[np.ndarray, " positions"]
    value: float


def exchange(
    limits: Limits,
    terms: Sequence[Term],
    *,
    restarts: int = 4,
    seed: int = 0,
    starts: Sequence[Sequence[int] | np.ndarray] = (),
) -> Chosen:
    """The cells with the least value within limits.

    **Arguments:**

    - `restarts`: from random positions; with limited time, of each set of mountings and temperatures, in rounds of half of
      the sets that remain (the first without changes of whole pitch settings). `starts`: positions to begin with in addition.
    """
    rng = np.random.default_rng(seed)
    found = [_improved(limits, terms, rng, start, whole=True) for start in starts]
    sets = _sets(limits, rng)
    for number in range(restarts if starts else max(1, restarts)):
        within = [replace(limits, allowed=limits.allowed & one) for one in sets]
        whole = len(sets) == 1 or number > 0
        tried = [_improved(each, terms, rng, _random(each, rng), whole=whole) for each in within]
        order = np.argsort([one.value for one in tried], kind="stable")
        sets = [sets[k] for k in order[: (len(sets) + 1) // 2]]
        found += tried
    best = min(found, key=lambda one: one.value)
    return Chosen(in_order(limits.cells, best.cells, limits.present), best.value)


def _sets(limits: Limits, rng: np.random.Generator) -> list[Bool[np.ndarray, " cells"]]:
    """Cells of each set of mountings and temperatures of which one position each fits; without a limit of time all at once,
    since none costs anything."""
    if not limits.timed:
        return [limits.allowed]
    allowed, count = np.flatnonzero(limits.allowed), len(limits.cells)
    first = allowed[np.unique(limits.sitting[allowed], return_index=True)[1]]
    sets = (np.array(one) for size in range(1, len(first) + 1) for one in combinations(first.tolist(), size))
    listed = [one for one in sets if not limits.exceeded(np.bincount(one, minlength=count))]
    if len(listed) > _SETS:
        listed = [listed[k] for k in np.sort(rng.permutation(len(listed))[:_SETS])]
    return [np.isin(limits.sitting, limits.sitting[one]) for one in listed]


def _random(limits: Limits, rng: np.random.Generator) -> list[int]:
    """Random cells, as many as fit; with limited time, one of each mounting and temperature, then of a random number of pitch
    settings."""
    group, allowed, number = limits.cells.group, np.flatnonzero(limits.allowed), np.zeros(len(limits.cells), int)
    first = rng.permutation(allowed)
    if limits.timed:
        groups = rng.permutation(np.unique(group[allowed]))
        some = rng.permutation(allowed[np.isin(group[allowed], groups[: rng.integers(1, len(groups) + 1)])])
        one_each = allowed[np.unique(limits.sitting[allowed], return_index=True)[1]]
        first = np.concatenate([rng.permutation(one_each), some, first])
    for cell in first:
        while limits.fits(number)[cell]:
            number[cell] += 1
    return np.repeat(np.arange(len(number)), number).tolist()


def _improved(
    limits: Limits, terms: Sequence[Term], rng: np.random.Generator, start: Sequence[int] | np.ndarray, *, whole: bool
) -> SetValue:
    """A start, without its least valuable positions if it exceeds the limits, exchanged until nothing improves; with limited
    time also `whole` pitch settings."""
    plan = _Plan(limits, terms, rng, start)
    while plan.value.cells and limits.exceeded(plan.number):
        plan.remove(plan.value.cells[int(np.argmin(plan.value.if_removed()))])
    plan.fill()
    for _ in range(_PASSES):
        plan.exchange()
        if not whole or not limits.timed or not plan.regroup():
            break
    return plan.value


class _Plan:
    """Positions with their value, and their number in each cell."""

    def __init__(
        self, limits: Limits, terms: Sequence[Term], rng: np.random.Generator, cells: Sequence[int] | np.ndarray
    ) -> None:
        self._limits, self._terms, self._rng = limits, terms, rng
        self._begin(cells)

    def _begin(self, cells: Sequence[int] | np.ndarray) -> None:
        self.value = SetValue(self._terms, cells)
        self.number = np.bincount(np.asarray(cells, int), minlength=len(self._limits.cells))

    def _add(self, cell: int) -> None:
        self.value.add(cell)
        self.number[cell] += 1

    def remove(self, cell: int) -> None:
        """Remove a position."""
        self.value.remove(cell)
        self.number[cell] -= 1

    def fill(self) -> None:
        """Add the best position as long as one fits."""
        while np.any(fit := self._limits.fits(self.number)):
            self._add(int(np.argmin(np.where(fit, self.value.if_added(), np.inf))))

    def exchange(self) -> None:
        """Exchange single positions, those that are missed least, in random order, until a whole pass improves nothing."""
        for _ in range(_PASSES):
            before, least = self.value.value, np.argsort(self.value.if_removed(), kind="stable")[:_TRIED]
            for cell in self._rng.permutation(np.array(self.value.cells)[least]).tolist():
                had = self.value.value
                self.remove(cell)
                values = np.where(self._limits.fits(self.number), self.value.if_added(), np.inf)
                other = int(np.argmin(values))
                self._add(other if values[other] < had * (1 - _GAIN) else cell)
            self.fill()
            if self.value.value > before * (1 - 1e-5):
                return

    def regroup(self) -> bool:
        """Close each pitch setting, or open each other one in place of the least valuable positions, if that is better."""
        groups, improved = self._limits.cells.group, False
        for group in self._rng.permutation(np.unique(groups[self._limits.allowed])).tolist():
            had, value = list(self.value.cells), self.value.value
            here = [cell for cell in had if groups[cell] == group]
            for cell in here:
                self.remove(cell)
            if not here:
                self._open(group)
            self.fill()
            if self.value.value < value * (1 - _GAIN):
                improved = True
            else:
                self._begin(had)
        return improved

    def _open(self, group: int) -> None:
        """Add two positions of a pitch setting, after removing others until they fit."""
        groups = self._limits.cells.group
        for _ in range(2):
            while not np.any(fit := self._limits.fits(self.number) & (groups == group)):
                others = groups[self.value.cells] != group
                if not np.any(others):
                    return
                self.remove(self.value.cells[int(np.argmin(np.where(others, self.value.if_removed(), np.inf)))])
            self._add(int(np.argmin(np.where(fit, self.value.if_added(), np.inf))))
