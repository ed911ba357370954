"""Positions by randomised exchange with restarts, under the time that they take on the head.

A position is removed, and the best cell that the head can measure in the time is added (Cook and Nachtsheim 1980, Technometrics
22, 315). Whole pitch settings are closed and opened too, because their time is shared by several positions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.plan.criterion import Criterion
from tumblecal.plan.information import LinearModel, covariance_of
from tumblecal.plan.limits import Limits, in_order


# An exchange counts if it reduces the value by more than this share; a pass of them, if by more than the second one.
_GAIN, _OF_PASS = 1e-6, 1e-5
# Largest number of passes, and of positions that are tried in each.
_PASSES, _TRIED = 30, 48
# Largest number of rounds in which pitch settings are opened and closed.
_ROUNDS = 6
# Largest number of sets of mountings and temperatures that are tried.
_SETS = 48


class Term(NamedTuple):
    """The largest of some criteria, each in a model of the same cells, with a weight."""

    criteria: tuple[tuple[LinearModel, Criterion], ...]
    weight: float = 1.0


class Selection:
    """Some positions within limits, and their value, a sum of terms; smaller is better.

    `cells`: of the positions; one that is measured twice is there twice.
    """

    def __init__(self, limits: Limits, terms: Sequence[Term], cells: Sequence[int] | np.ndarray = ()) -> None:
        self.limits, self.terms, self.cells = limits, terms, [int(cell) for cell in cells]
        self._parts = [part for term in terms for part in term.criteria]
        self._first = np.cumsum([0, *(len(term.criteria) for term in terms[:-1])])
        self._weights = np.array([term.weight for term in terms])
        self._information = [model.information_with(self.cells) for model, _ in self._parts]
        self._settle()

    def _settle(self) -> None:
        self._covariances = [covariance_of(one) for one in self._information]
        pairs = zip(self._parts, self._covariances, strict=True)
        values = [criterion.of(own[: len(model.names), : len(model.names)]) for (model, criterion), own in pairs]
        self.value = float(self._total(values))

    def _total(self, values: Sequence[Float[np.ndarray, "*n"]]) -> Float[np.ndarray, "*n"]:
        """The weighted sum of the largest value of each term."""
        return self._weights @ np.maximum.reduceat(np.array(values), self._first, axis=0)

    def if_changed(self, cells: Sequence[int] | np.ndarray, sign: int) -> Float[np.ndarray, " some"]:
        """Values with one position more (1) or less (-1) in each of some cells (Woodbury)."""
        values = []
        for (model, criterion), covariance in zip(self._parts, self._covariances, strict=True):
            rows, shared = model.columns[np.asarray(cells, int)], len(model.names)
            across = (rows.reshape(-1, rows.shape[2]) @ covariance).reshape(rows.shape)
            inner, across = across @ rows.swapaxes(1, 2), across[:, :, :shared]
            change = across.swapaxes(1, 2) @ (np.linalg.inv(inner + sign * np.eye(3)) @ across)
            values.append(criterion.of(covariance[:shared, :shared] - change))
        return self._total(values)

    def add(self, cell: int) -> None:
        """Add a position."""
        self.cells.append(cell)
        self._update(cell, 1)

    def remove(self, cell: int) -> None:
        """Remove a position in this cell."""
        self.cells.remove(cell)
        self._update(cell, -1)

    def _update(self, cell: int, sign: int) -> None:
        for information, (model, _) in zip(self._information, self._parts, strict=True):
            information += sign * model.columns[cell].T @ model.columns[cell]
        self._settle()

    @property
    def number(self) -> Int[np.ndarray, " cells"]:
        """Number of positions in each cell."""
        return np.bincount(np.array(self.cells, int), minlength=len(self.limits.cells))

    def best(self, among: Bool[np.ndarray, " cells"] | bool = True) -> tuple[int, float]:
        """The best cell for one more position, and the value with it; infinite if none fits."""
        some = np.flatnonzero(self.limits.fits(self.number) & among)
        if not len(some):
            return -1, np.inf
        values = self.if_changed(some, 1)
        return int(some[np.argmin(values)]), float(values.min())

    def complete(self) -> "Selection":
        """Remove the least valuable positions as long as they exceed the limits, then add the best one as long as one fits."""
        while self.cells and self.limits.exceeded(self.number):
            self.remove(self.cells[int(np.argmin(self.if_changed(self.cells, -1)))])
        while (cell := self.best()[0]) >= 0:
            self.add(cell)
        return self


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
    """Choose positions.

    **Arguments:**

    - `terms`: of the value. `restarts`: random starts. `starts`: positions to begin with in addition.
    """
    rng = np.random.default_rng(seed)
    sets = [limits.sets[k] for k in rng.permutation(len(limits.sets))[:_SETS]]
    listed = [*starts, *(_random(limits, rng, one) for one in sets * restarts)]
    first = [_exchanged(Selection(limits, terms, one), rng) for one in listed]
    first.sort(key=lambda plan: plan.value)
    best = first[0]
    for plan in first[: max(1, restarts)] if limits.timed else []:
        for _ in range(_ROUNDS):
            if (better := _regrouped(plan, rng)) is plan:
                break
            plan = _exchanged(better, rng)
        best = min(best, plan, key=lambda one: one.value)
    return Chosen(in_order(limits.cells, best.cells, limits.present), best.value)


def _random(limits: Limits, rng: np.random.Generator, among: Bool[np.ndarray, " cells"]) -> list[int]:
    """Random cells, as many as fit; with limited time one of each mounting at each temperature, then of a random number of
    pitch settings."""
    group, sitting = limits.cells.group, limits.cells.sitting
    order = rng.permutation(np.flatnonzero(among))
    if limits.timed:
        groups = rng.permutation(np.unique(group[order]))
        some = order[np.isin(group[order], groups[: rng.integers(1, len(groups) + 1)])]
        order = np.concatenate([order[np.unique(sitting[order], return_index=True)[1]], some, order])
    number = np.zeros(len(limits.cells), int)
    for cell in order:
        while limits.fits(number)[cell]:
            number[cell] += 1
    return np.repeat(np.arange(len(number)), number).tolist()


def _exchanged(plan: Selection, rng: np.random.Generator) -> Selection:
    """Complete, with single positions exchanged, those that are missed least, in random order, until a whole pass improves
    nothing."""
    plan.complete()
    for _ in range(_PASSES):
        before, least = plan.value, np.argsort(plan.if_changed(plan.cells, -1), kind="stable")[:_TRIED]
        for cell in rng.permutation(np.array(plan.cells)[least]).tolist():
            had = plan.value
            plan.remove(cell)
            other, value = plan.best()
            plan.add(other if value < had * (1 - _GAIN) else cell)
        plan.complete()
        if plan.value > before * (1 - _OF_PASS):
            break
    return plan


def _regrouped(plan: Selection, rng: np.random.Generator) -> Selection:
    """Each pitch setting closed, or each other one opened in place of the least valuable positions, if that is better; the plan
    itself if nothing is."""
    groups, allowed, terms = plan.limits.cells.group, plan.limits.allowed, plan.terms
    for group in rng.permutation(np.unique(groups[allowed])).tolist():
        others = [cell for cell in plan.cells if groups[cell] != group]
        if len(others) == len(plan.cells):
            here = np.flatnonzero(allowed & (groups == group))
            others += here[np.argsort(plan.if_changed(here, 1))[:2]].tolist()
        other = Selection(plan.limits, terms, others).complete()
        plan = other if other.value < plan.value * (1 - _GAIN) else plan
    return plan
