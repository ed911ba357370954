"""The value of a growing and shrinking set of positions, and its value after each possible step."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.plan.criterion import Criterion
from tumblecal.plan.information import covariance_of
from tumblecal.plan.linear_model import LinearModel


# Covariances are computed from the information again after so many updates of rank three, and whenever a position
# determines a direction alone to this degree: an update would lose the digits.
_RENEWED = 40
_ALONE = 1e-3


class Term(NamedTuple):
    """The largest of some criteria, each in a model of the same cells, with a weight."""

    criteria: tuple[tuple[LinearModel, Criterion], ...]
    weight: float = 1.0


class SetValue:
    """The value of a set of positions, a sum of terms; smaller is better.

    `cells`: of the positions; one that is measured twice is there twice.
    """

    def __init__(self, terms: Sequence[Term], cells: Sequence[int] | np.ndarray = ()) -> None:
        self.cells = [int(cell) for cell in cells]
        self._terms = [
            ([(_Updated(model, self.cells), criterion) for model, criterion in term.criteria], term.weight)
            for term in terms
        ]

    @property
    def value(self) -> float:
        """Value of the positions so far."""
        return sum(
            weight * max(float(criterion.of(one.shared)) for one, criterion in term) for term, weight in self._terms
        )

    def if_added(self) -> Float[np.ndarray, " cells"]:
        """Values after one more position, for each cell."""
        return self._changed(None, 1)

    def if_removed(self) -> Float[np.ndarray, " positions"]:
        """Values without each of the positions."""
        return self._changed(np.asarray(self.cells, int), -1)

    def _changed(self, cells: np.ndarray | None, sign: int) -> np.ndarray:
        parts = [
            weight
            * np.max([criterion.changed(one.shared, one.change(cells, sign), -sign) for one, criterion in term], 0)
            for term, weight in self._terms
        ]
        return np.sum(parts, axis=0)

    def add(self, cell: int) -> None:
        """Add a position."""
        self.cells.append(cell)
        self._update(cell, 1)

    def remove(self, cell: int) -> None:
        """Remove a position in this cell."""
        self.cells.remove(cell)
        self._update(cell, -1)

    def _update(self, cell: int, sign: int) -> None:
        for term, _ in self._terms:
            for one, _ in term:
                one.update(cell, sign)


class _Updated:
    """The covariance of a model by updates of rank three (Woodbury)."""

    def __init__(self, model: LinearModel, cells: Sequence[int]) -> None:
        self._columns, self._count = model.columns, len(model.names)
        self._flat = np.ascontiguousarray(model.columns.reshape(-1, model.columns.shape[2]).T)
        self._information = model.information_with(cells)
        self._renew()

    @property
    def shared(self) -> Float[np.ndarray, "shared shared"]:
        """Covariance of the shared parameters."""
        return self._covariance[: self._count, : self._count]

    def change(self, cells: np.ndarray | None, sign: int) -> Float[np.ndarray, "positions 3 shared"]:
        """Parts of the change of the covariance by a position more (1) or less (-1) in each cell: L^-1 U with
        L L' = 1 + sign times its prediction."""
        every = slice(None) if cells is None else cells
        inner, to_shared, floor = sign * self._inner[every], self._to_shared[every], 1e-12
        first = np.sqrt(np.maximum(1 + inner[:, 0, 0], floor))
        low, lower = inner[:, 1, 0] / first, inner[:, 2, 0] / first
        second = np.sqrt(np.maximum(1 + inner[:, 1, 1] - low**2, floor))
        lowest = (inner[:, 2, 1] - low * lower) / second
        third = np.sqrt(np.maximum(1 + inner[:, 2, 2] - lower**2 - lowest**2, floor))
        one = to_shared[:, 0] / first[:, None]
        two = (to_shared[:, 1] - low[:, None] * one) / second[:, None]
        three = (to_shared[:, 2] - lower[:, None] * one - lowest[:, None] * two) / third[:, None]
        return np.stack([one, two, three], axis=1)

    def update(self, cell: int, sign: int) -> None:
        """Add (1) or remove (-1) a position."""
        rows = self._columns[cell]
        self._information = self._information + sign * rows.T @ rows
        middle = np.eye(3) + sign * self._inner[cell]
        self._age += 1
        if self._age > _RENEWED or (sign < 0 and np.linalg.eigvalsh(middle)[0] < _ALONE):
            self._renew()
            return
        half = np.linalg.solve(np.linalg.cholesky(middle), rows @ self._covariance)
        self._covariance = self._covariance - sign * half.T @ half
        across = self._flat.T @ half.T
        self._to_shared -= sign * (across @ half[:, : self._count]).reshape(self._to_shared.shape)
        across = across.reshape(-1, 3, 3)
        self._inner -= sign * across @ across.swapaxes(1, 2)

    def _renew(self) -> None:
        """Everything from the information."""
        self._age = 0
        self._covariance = covariance_of(self._information)
        through = (self._flat.T @ self._covariance).reshape(self._columns.shape)
        self._inner = through @ self._columns.swapaxes(1, 2)
        self._to_shared = through[:, :, : self._count].copy()
