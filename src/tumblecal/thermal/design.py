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
from tumblecal.ground.temperature_functions import TemperatureFunctions
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
    - `prior` (priors, constants), `prior_values` (priors): rows of the priors of constants, in each part of the design.
    - `names` (constants), `functions`: of temperature, by family. All columns are for parameters in base units.
    """

    constant: Float[np.ndarray, "rows constants"]
    families: Mapping[str, Float[np.ndarray, "orders components rows"]]
    values: Float[np.ndarray, " rows"]
    row_of: Int[np.ndarray, " rows"]
    prior: Float[np.ndarray, "priors constants"]
    prior_values: Float[np.ndarray, " priors"]
    names: tuple[str, ...]
    functions: Mapping[str, TemperatureFunctions]

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

    def limited(self, highest: Mapping[str, int]) -> "Design":
        """The design with the families of these leaves up to these orders, and of all signals."""
        limits = {
            name: highest.get(name, 0 if name in self.functions else len(each)) for name, each in self.families.items()
        }
        return replace(self, families={name: self.families[name][:limit] for name, limit in limits.items() if limit})

    def part(self, taken: Bool[np.ndarray, " table"]) -> "Design":
        """The design of some rows of the table."""
        rows = taken[self.row_of]
        families = {name: columns[:, :, rows] for name, columns in self.families.items()}
        # The rows of the part are numbered from 0.
        number = np.cumsum(taken) - 1
        return replace(
            self,
            constant=self.constant[rows],
            families=families,
            values=self.values[rows],
            row_of=number[self.row_of[rows]],
        )

    def coefficients(self, orders: Mapping[str, int]) -> Float[np.ndarray, " all"]:
        """Least-squares coefficients of constants and families; zero along undetermined directions."""
        constant, whole = self.with_priors(self.columns(orders))
        values = np.append(self.values, self.prior_values)
        return np.linalg.lstsq(np.column_stack([constant, whole]), values, rcond=RANK)[0]

    def with_priors(
        self, columns: Float[np.ndarray, "rows columns"]
    ) -> tuple[Float[np.ndarray, "all constants"], Float[np.ndarray, "all columns"]]:
        """The constants with the rows of their priors, and other columns with zeros in these rows."""
        return np.vstack([self.constant, self.prior]), np.pad(columns, ((0, len(self.prior)), (0, 0)))

    def predicted(
        self, orders: Mapping[str, int], coefficients: Float[np.ndarray, " all"]
    ) -> Float[np.ndarray, " rows"]:
        """Values by coefficients of another part of the same design."""
        return np.concatenate([self.constant, self.columns(orders)], axis=1) @ coefficients


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
    residual, jacobian = (np.asarray(part) for part in linearised(problem, vector))
    jacobian, rows = jacobian / problem.scales, model.table.readings.size
    values = jacobian @ vector - residual
    families: dict[str, np.ndarray] = {}
    constant, start = np.ones(len(vector), bool), 0
    for leaf in chain.free:
        here = slice(start, start + leaf.value.size)
        start = here.stop
        if leaf.name.endswith(CHANGE):
            name = leaf.name.removesuffix(CHANGE)
            families[name] = jacobian[:rows, here].T.reshape(model.functions[name].count, -1, rows)
            constant[here] = False
    constants = jacobian[:, constant]
    stated = rows + np.flatnonzero(np.any(constants[rows:], axis=1))
    return Design(
        constants[:rows],
        families,
        values[:rows],
        np.repeat(np.arange(len(model.table)), 3),
        constants[stated],
        values[stated],
        tuple(np.array(chain.names)[constant].tolist()),
        model.functions,
    )
