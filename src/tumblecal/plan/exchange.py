"""Positions by randomised exchange with restarts, under the time that they take on the head.

A position is removed, and the best cell that the head can measure in the time is added (Cook and Nachtsheim 1980, Technometrics
22, 315). Whole pitch settings are closed and opened too, because their time is shared by several positions.
"""

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.plan.cells import Numbers
from tumblecal.plan.criterion import Criterion
from tumblecal.plan.information import Covariance, LinearModel, covariance_of
from tumblecal.plan.limits import Limits, in_order


# An exchange counts if it reduces the value by more than this share; a pass of them, if by more than the second one.
_GAIN, _OF_PASS = 1e-6, 1e-5
# Largest number of passes, and of positions that are tried in each.
_PASSES, _TRIED = 30, 48
# Largest number of rounds in which pitch settings are opened and closed, and of sets of mountings and temperatures.
_ROUNDS, _SETS = 6, 48


class Term(NamedTuple):
    """The largest of some criteria, each in a model of the same cells, with a weight."""

    criteria: tuple[tuple[LinearModel, Criterion], ...]
    weight: float = 1.0


class Selection:
    """Some positions within limits, and their value, a sum of terms; smaller is better.

    `cells`: of the positions; one that is measured twice is there twice.
    """

    def __init__(self, limits: Limits, terms: Sequence[Term], cells: Sequence[int] | np.ndarray = ()) -> None:
        self.limits, self.terms, self.cells = limits, terms, np.asarray(cells, int).tolist()
        self._models = [model for term in terms for model, _ in term.criteria]
        self._information = [model.information_with(self.cells) for model in self._models]
        self._settle()

    def _settle(self) -> None:
        self._covariances = [covariance_of(one) for one in self._information]
        pairs = zip(self._covariances, self._models, strict=True)
        self.value = float(self._value([own[: len(model.names), : len(model.names)] for own, model in pairs]))

    def _value(self, covariances: Sequence[Covariance]) -> Float[np.ndarray, "*n"]:
        """The weighted sum of the largest value of each term, from the covariances of the models."""
        each, total = iter(covariances), np.zeros(covariances[0].shape[:-2])
        for criteria, weight in self.terms:
            total += weight * np.max([criterion.of(next(each)) for _, criterion in criteria], axis=0)
        return total

    def if_changed(self, cells: Sequence[int] | np.ndarray, sign: int) -> Float[np.ndarray, " some"]:
        """Values with one position more (1) or less (-1) in each of some cells (Woodbury)."""
        changed = list[np.ndarray]()
        for model, covariance in zip(self._models, self._covariances, strict=True):
            rows, shared = model.columns[np.asarray(cells, int)], len(model.names)
            across = (rows.reshape(-1, rows.shape[2]) @ covariance).reshape(rows.shape)
            inner, across = across @ rows.swapaxes(1, 2), across[:, :, :shared]
            change = across.swapaxes(1, 2) @ (np.linalg.inv(inner + sign * np.eye(3)) @ across)
            changed.append(covariance[:shared, :shared] - change)
        return self._value(changed)

    def add(self, cell: int, sign: int = 1) -> None:
        """Add a position in a cell, or remove one (-1)."""
        if sign > 0:
            self.cells.append(cell)
        else:
            self.cells.remove(cell)
        for information, model in zip(self._information, self._models, strict=True):
            information += sign * model.columns[cell].T @ model.columns[cell]
        self._settle()

    def best(self) -> tuple[int, float]:
        """The best cell for one more position, and the value with it; -1 and infinite if none fits."""
        some = np.flatnonzero(self.limits.fits(self.cells))
        if not len(some):
            return -1, np.inf
        values = self.if_changed(some, 1)
        return int(some[np.argmin(values)]), float(values.min())

    def complete(self) -> "Selection":
        """Remove the least valuable positions as long as they exceed the limits, then add the best one as long as one fits."""
        while self.cells and self.limits.exceeded(self.cells):
            self.add(self.cells[int(np.argmin(self.if_changed(self.cells, -1)))], -1)
        while (cell := self.best()[0]) >= 0:
            self.add(cell)
        return self

    def exchanged(self, rng: np.random.Generator) -> "Selection":
        """Complete, with single positions exchanged, those that are missed least, in random order, until a whole pass improves
        nothing."""
        self.complete()
        for _ in range(_PASSES):
            before, least = self.value, np.argsort(self.if_changed(self.cells, -1), kind="stable")[:_TRIED]
            for cell in rng.permutation(np.array(self.cells)[least]).tolist():
                had = self.value
                self.add(cell, -1)
                other, value = self.best()
                self.add(other if value < had * (1 - _GAIN) else cell)
            self.complete()
            if self.value > before * (1 - _OF_PASS):
                break
        return self

    def regrouped(self, rng: np.random.Generator) -> "Selection":
        """Each pitch setting closed, or each other one opened in place of the least valuable positions, if that is better;
        itself if nothing is."""
        group, allowed, plan = self.limits.cells.group, self.limits.allowed, self
        for number in rng.permutation(np.unique(group[allowed])).tolist():
            others = [cell for cell in plan.cells if group[cell] != number]
            if len(others) == len(plan.cells):
                here = np.flatnonzero(allowed & (group == number))
                others += here[np.argsort(plan.if_changed(here, 1))[:2]].tolist()
            other = Selection(self.limits, self.terms, others).complete()
            plan = other if other.value < plan.value * (1 - _GAIN) else plan
        return plan


def exchange(
    limits: Limits,
    terms: Sequence[Term],
    *,
    restarts: int = 4,
    seed: int = 0,
    starts: Sequence[Sequence[int] | np.ndarray] = (),
) -> Selection:
    """Choose positions; its cells are in an order that visits each setting once.

    **Arguments:**

    - `terms`: of the value. `restarts`: random starts. `starts`: positions to begin with in addition.
    """
    rng = np.random.default_rng(seed)
    sets = [limits.sets[k] for k in rng.permutation(len(limits.sets))[:_SETS]]
    listed = [*starts, *(_random(limits, rng, one) for one in sets * restarts)]
    plans = [Selection(limits, terms, one).exchanged(rng) for one in listed]
    plans.sort(key=lambda plan: plan.value)
    for number, plan in enumerate(plans[: max(1, restarts)] if limits.timed else []):
        for _ in range(_ROUNDS):
            if (better := plan.regrouped(rng)) is plan:
                break
            plan = better.exchanged(rng)
        plans[number] = plan
    best = min(plans, key=lambda plan: plan.value)
    best.cells = in_order(limits.cells, best.cells, limits.present).tolist()
    return best


def _random(limits: Limits, rng: np.random.Generator, among: Bool[np.ndarray, " cells"]) -> Numbers:
    """Random cells, as many as fit; with limited time one of each mounting at each temperature, then of a random number of
    pitch settings."""
    order, group = rng.permutation(np.repeat(np.flatnonzero(among), limits.repeats)), limits.cells.group
    if limits.timed:
        groups = rng.permutation(np.unique(group[order]))
        late = ~np.isin(group[order], groups[: rng.integers(1, len(groups) + 1)])
        late[np.unique(limits.cells.sitting[order], return_index=True)[1]] = False
        order = order[np.argsort(late, kind="stable")]
    return order[: bisect_left(range(len(order)), True, key=lambda last: limits.exceeded(order[: last + 1]))]
