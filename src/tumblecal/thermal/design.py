"""The linearised design of the largest temperature model: a family of columns for each leaf and each kind of signals.

Changes with temperature are small (mg), so the columns at one estimate serve all models of lower order. The families are
nested: the first columns of a family are the family of lower order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.chain.following import CHANGE
from tumblecal.estimation.linearised import linearised
from tumblecal.estimation.problem import Problem
from tumblecal.thermal.model import ThermalModel
from tumblecal.thermal.signals import Signals


# Gauss-Newton steps to the point of linearisation; the model is nearly linear.
_STEPS = 4
# Directions below this share of the largest singular value are not determined.
RANK = 1e-7


def estimate(model: ThermalModel) -> Float[np.ndarray, " free"]:
    """The least-squares estimate of all parameters of a model; along undetermined directions it remains at the start."""
    problem, vector = model.problem, model.chain.vector
    for _ in range(_STEPS):
        residual, jacobian = (np.asarray(part) for part in linearised(problem, vector))
        vector = vector - np.linalg.lstsq(jacobian, residual, rcond=RANK)[0] * problem.scales
    return vector


@dataclass(frozen=True)
class Design:
    """White rows of a table, as a linear model.

    - `constant` (rows, constants): columns of the parameters at the reference, attitudes included.
    - `families`: by name, the columns (orders, components, rows).
    - `values` (rows): what constants and families have to explain. `row_of`: the row of the table of each white row.
    """

    constant: Float[np.ndarray, "rows constants"]
    families: Mapping[str, Float[np.ndarray, "orders components rows"]]
    values: Float[np.ndarray, " rows"]
    row_of: Int[np.ndarray, " rows"]

    def columns(self, orders: Mapping[str, int]) -> Float[np.ndarray, "rows columns"]:
        """The columns of families up to these orders."""
        parts = [self.families[name][:order].reshape(-1, len(self.values)) for name, order in orders.items() if order]
        return np.concatenate([np.zeros((0, len(self.values))), *parts]).T

    def with_signals(self, problem: Problem, signals: Sequence[Signals]) -> "Design":
        """The design with a family of columns for each kind of signals."""
        families = dict(self.families)
        for given in signals:
            orders, components, rows, _ = given.values.shape
            white = problem.rows(np.moveaxis(given.values.reshape(-1, rows, 3), 0, -1)) * given.scale
            families[given.name] = white.T.reshape(orders, components, -1)
        return replace(self, families=families)

    def part(self, taken: Bool[np.ndarray, " table"]) -> "Design":
        """The design of some rows of the table."""
        rows = taken[self.row_of]
        families = {name: columns[:, :, rows] for name, columns in self.families.items()}
        # The rows of the part are numbered from 0.
        number = np.cumsum(taken) - 1
        return Design(self.constant[rows], families, self.values[rows], number[self.row_of[rows]])

    def coefficients(self, orders: Mapping[str, int]) -> Float[np.ndarray, " all"]:
        """Least-squares coefficients of constants and families; zero along undetermined directions."""
        return np.linalg.lstsq(self._all(orders), self.values, rcond=RANK)[0]

    def predicted(
        self, orders: Mapping[str, int], coefficients: Float[np.ndarray, " all"]
    ) -> Float[np.ndarray, " rows"]:
        """Values by coefficients of another part of the same design."""
        return self._all(orders) @ coefficients

    def _all(self, orders: Mapping[str, int]) -> Float[np.ndarray, "rows all"]:
        return np.concatenate([self.constant, self.columns(orders)], axis=1)


def free_of(
    others: Float[np.ndarray, "rows others"], columns: Float[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """Columns less their projection on other columns."""
    basis, sizes, _ = np.linalg.svd(others, full_matrices=False)
    basis = basis[:, sizes > RANK * np.max(sizes, initial=0.0)]
    return columns - basis @ (basis.T @ columns)


def design_of(model: ThermalModel, vector: Float[np.ndarray, " free"]) -> Design:
    """The design of a model without signals, at an estimate of all its parameters."""
    problem, chain = model.problem, model.chain
    # Rows of priors are no observations.
    residual, jacobian = (np.asarray(part)[: model.table.readings.size] for part in linearised(problem, vector))
    families: dict[str, np.ndarray] = {}
    constant, start = np.ones(len(vector), bool), 0
    for leaf in chain.free:
        here = slice(start, start + leaf.value.size)
        start = here.stop
        if leaf.name.endswith(CHANGE):
            name = leaf.name.removesuffix(CHANGE)
            families[name] = jacobian[:, here].T.reshape(model.functions[name].count, -1, len(residual))
            constant[here] = False
    explained = jacobian @ (vector / problem.scales)
    return Design(jacobian[:, constant], families, explained - residual, np.repeat(np.arange(len(model.table)), 3))
