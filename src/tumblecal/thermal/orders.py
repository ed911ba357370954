"""The orders of the functions of temperature, and the terms of direction, rate and time: by evidence, checked by prediction.

A model is chosen by the Bayesian information criterion (Schwarz 1978) over nested families, searched by changes of one family
by up to three orders. The highest order of a family is dropped if, fitted to the other branch or the other temperatures, the
model without it predicts the rows that took no part better by more than one standard error.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.thermal.design import Design


# A cubic may be needed although no quadratic is: steps of one to three orders are tried.
_STEPS = (1, 2, 3, -1, -2)
_MOST_CHANGES = 40
# Alternatives with odds above 1 : 20 by the evidence are stated as not separated.
SEPARATED = 2 * np.log(20.0)


@dataclass(frozen=True)
class Score:
    """The Bayesian information criterion of some orders; smaller is better."""

    orders: Mapping[str, int]
    criterion: float


class Search:
    """The best orders of the families of a design."""

    def __init__(self, design: Design):
        self._design = design
        projected = design.projected()
        self._families, self._values = projected.families, projected.values
        self._count = len(self._values) - np.linalg.matrix_rank(design.constant, tol=None)
        self._known: dict[tuple[tuple[str, int], ...], float] = {}
        names = [name for name in projected.families]
        stacked = projected.columns({name: len(projected.families[name]) for name in names})
        # Everything is in the space of the columns and the values: a small triangle instead of all rows.
        _, triangle = np.linalg.qr(np.column_stack([stacked, self._values]))
        self._triangle, self._places, start = triangle, {}, 0
        for name in names:
            orders, components, _ = projected.families[name].shape
            self._places[name] = (start, components)
            start += orders * components

    def criterion(self, orders: Mapping[str, int]) -> float:
        """Rows times the logarithm of the residual sum of squares, plus the logarithm of rows for each coefficient."""
        key = tuple(sorted((name, order) for name, order in orders.items() if order))
        if key not in self._known:
            taken = [self._places[name][0] + k for name, order in key for k in range(order * self._places[name][1])]
            columns, values = self._triangle[:, taken], self._triangle[:, -1]
            if taken:
                basis, triangle = np.linalg.qr(columns)
                good = np.abs(np.diag(triangle)) > 1e-9 * np.linalg.norm(columns, axis=0)
                values = values - basis @ (basis.T @ values)
                if not np.all(good):
                    self._known[key] = np.inf
                    return np.inf
            residual_ss = max(float(values @ values), 1e-300)
            self._known[key] = self._count * np.log(residual_ss / self._count) + len(taken) * np.log(self._count)
        return self._known[key]

    def best(self, start: Mapping[str, int], highest: Mapping[str, int]) -> Score:
        """The best orders from a start, each at most its highest."""
        orders, score = dict(start), self.criterion(start)
        for _ in range(_MOST_CHANGES):
            changes = [
                orders | {name: orders.get(name, 0) + step}
                for name in highest
                for step in _STEPS
                if 0 <= orders.get(name, 0) + step <= highest[name]
            ]
            better = min(changes, key=self.criterion, default=orders)
            if not self.criterion(better) < score - 1e-9:
                break
            orders, score = better, self.criterion(better)
        return Score({name: order for name, order in orders.items() if order}, score)


def without_worse_orders(
    design: Design, orders: Mapping[str, int], folds: Sequence[Bool[np.ndarray, " table"]], names: Sequence[str]
) -> dict[str, int]:
    """The orders less those that predict worse than the order below.

    **Arguments:**

    - `folds`: rows that take no part, for each fold. `names`: families that may lose orders.
    """
    chosen = dict(orders)
    for name in names:
        while chosen.get(name, 0) > 0 and folds:
            lower = chosen | {name: chosen[name] - 1}
            difference = squared_errors(design, chosen, folds) - squared_errors(design, lower, folds)
            error = np.std(difference, ddof=1) / np.sqrt(len(difference)) if len(difference) > 1 else np.inf
            if not np.mean(difference) > error:
                break
            chosen = lower
    return {name: order for name, order in chosen.items() if order}


def squared_errors(
    design: Design, orders: Mapping[str, int], folds: Sequence[Bool[np.ndarray, " table"]]
) -> Float[np.ndarray, " predicted"]:
    """For each row of the table in a fold, the sum of squared white errors of its prediction by the rows outside the fold."""
    errors = []
    for held_out in folds:
        rest, apart = design.part(~held_out), design.part(held_out)
        error = apart.values - apart.predicted(orders, rest.coefficients(orders))
        errors.append(np.sum(error.reshape(-1, 3) ** 2, axis=1))
    return np.concatenate(errors) if errors else np.zeros(0)


def folds_of(
    attitude: Sequence[str], direction: Float[np.ndarray, " table"], degc: Float[np.ndarray, " table"]
) -> list[Bool[np.ndarray, " table"]]:
    """Rows held out together: each direction of change, if both are present at the same attitudes; otherwise each interior
    fifth of the temperatures, or each interior soak."""
    labels = np.array(attitude)
    both = [set(labels[direction == sign]) for sign in (1, -1)]
    if both[0] and both[0] == both[1]:
        return [direction == sign for sign in (1, -1)]
    distinct = np.unique(np.round(degc, 1))
    parts = len(distinct) if len(distinct) <= 8 else 7
    edges = np.quantile(distinct, np.linspace(0, 1, parts + 1)) if len(distinct) > 8 else np.append(distinct, np.inf)
    number = np.clip(np.searchsorted(edges, degc + 0.05, side="right") - 1, 0, parts - 1)
    return [number == k for k in range(1, parts - 1)]
