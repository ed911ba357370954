"""The value of a growing and shrinking set of positions, and its value after each possible step."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Float

from tumblecal.design.criteria.criterion import OfRows
from tumblecal.design.model.one_visit import OneVisit


class Measure(Protocol):
    """The value of the positions so far; smaller is better."""

    @property
    def value(self) -> float:
        """Value of the positions so far."""
        ...

    @property
    def cells(self) -> tuple[int, ...]:
        """Cells of the positions; one that is measured twice is there twice."""
        ...

    def if_added(self) -> Float[np.ndarray, " cells"]:
        """Values after one more position, for each cell."""
        ...

    def if_removed(self) -> Float[np.ndarray, " positions"]:
        """Values without each of the positions."""
        ...

    def add(self, cell: int) -> None:
        """Add a position."""
        ...

    def remove(self, position: int) -> None:
        """Remove the position with this number in `cells`."""
        ...


Measures = Callable[[Sequence[int] | np.ndarray], Measure]

# Covariances are computed from the information again after so many updates of rank three, and whenever a position
# determines a direction alone to this degree: an update would lose the digits.
_RENEWED = 40
_ALONE = 1e-3


class CriterionMeasure:
    """The value of a criterion by updates of rank three (Woodbury)."""

    def __init__(self, model: OneVisit, criterion: OfRows, cells: Sequence[int] | np.ndarray = ()) -> None:
        self._model, self._criterion = model, criterion
        self._columns = model.columns
        # (all, 3 cells): the readings of an axis are together.
        self._flat = np.ascontiguousarray(model.columns.transpose(2, 1, 0)).reshape(model.columns.shape[2], -1)
        self._cells = [int(cell) for cell in cells]
        self._information = model.information_with(self._cells)
        self._renew()

    @property
    def value(self) -> float:
        """Value of the positions so far."""
        return float(self._criterion.of_rows(self._of_rows))

    @property
    def cells(self) -> tuple[int, ...]:
        """Cells of the positions."""
        return tuple(self._cells)

    def if_added(self) -> Float[np.ndarray, " cells"]:
        """Values after one more position, for each cell."""
        return self._criterion.changed(self._of_rows, _whitened(self._inner, self._to_rows, 1), -1)

    def if_removed(self) -> Float[np.ndarray, " positions"]:
        """Values without each of the positions."""
        at = np.asarray(self._cells, int)
        parts = _whitened(self._inner[:, :, at], self._to_rows[:, :, at], -1)
        return self._criterion.changed(self._of_rows, parts, 1)

    def add(self, cell: int) -> None:
        """Add a position."""
        self._cells.append(int(cell))
        self._update(int(cell), 1)

    def remove(self, position: int) -> None:
        """Remove the position with this number in `cells`."""
        self._update(self._cells.pop(position), -1)

    def _update(self, cell: int, sign: int) -> None:
        rows = self._columns[cell]
        self._information = self._information + sign * rows.T @ rows
        middle = np.eye(3) + sign * self._inner[:, :, cell]
        self._age += 1
        if self._age > _RENEWED or (sign < 0 and np.linalg.eigvalsh(middle)[0] < _ALONE):
            return self._renew()
        half = np.linalg.solve(np.linalg.cholesky(middle), rows @ self._covariance)
        self._covariance = self._covariance - sign * half.T @ half
        across = half @ self._flat
        mine = half[:, : self._criterion.rows.shape[1]] @ self._criterion.rows.T
        self._to_rows -= sign * (mine.T @ across).reshape(self._to_rows.shape)
        self._of_rows = self._of_rows - sign * mine.T @ mine
        across = across.reshape(3, 3, -1)
        self._inner -= sign * np.einsum("kic,kjc->ijc", across, across)
        return None

    def _renew(self) -> None:
        """Everything from the information."""
        self._age = 0
        size = 1 / np.sqrt(np.diag(self._information))
        self._covariance = np.outer(size, size) * np.linalg.inv(self._information * np.outer(size, size))
        rows, cells = self._criterion.rows, len(self._columns)
        shared = rows.shape[1]
        through = (self._covariance @ self._flat).reshape(-1, 3, cells)
        self._inner = np.einsum("pic,pjc->ijc", through, self._flat.reshape(-1, 3, cells))
        self._to_rows = np.tensordot(rows, through[:shared], 1)
        self._of_rows = rows @ self._covariance[:shared, :shared] @ rows.T


def measures(model: OneVisit, criterion: OfRows) -> Measures:
    """Measures of a criterion that begin with given cells."""
    return lambda cells: CriterionMeasure(model, criterion, cells)


def _whitened(inner: np.ndarray, to_rows: np.ndarray, sign: int) -> np.ndarray:
    """L^-1 U (3, k, cells) with L L' = 1 + sign times inner for every cell: inner (3, 3, cells), U (k, 3, cells)."""
    floor = 1e-12
    a, b, c = 1 + sign * inner[0, 0], sign * inner[1, 0], sign * inner[2, 0]
    first = np.sqrt(np.maximum(a, floor))
    low, lower = b / first, c / first
    second = np.sqrt(np.maximum(1 + sign * inner[1, 1] - low**2, floor))
    lowest = (sign * inner[2, 1] - low * lower) / second
    third = np.sqrt(np.maximum(1 + sign * inner[2, 2] - lower**2 - lowest**2, floor))
    one = to_rows[:, 0] / first
    two = (to_rows[:, 1] - low * one) / second
    return np.stack([one, two, (to_rows[:, 2] - lower * one - lowest * two) / third])
