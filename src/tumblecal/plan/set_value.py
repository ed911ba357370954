"""The value of a growing and shrinking set of positions, and its value after each possible step."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.plan.criterion import Criterion
from tumblecal.plan.information import covariance_of
from tumblecal.plan.linear_model import LinearModel


# Least variance of a reading that a position adds or takes away, of its variance before.
_FLOOR = 1e-12


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
        self._parts = [part for term in terms for part in term.criteria]
        self._first = np.cumsum([0, *(len(term.criteria) for term in terms[:-1])])
        self._weights = np.array([term.weight for term in terms])
        self._settle([model.information_with(self.cells) for model, _ in self._parts])

    def _settle(self, information: list[Float[np.ndarray, "all all"]]) -> None:
        self._information, self._covariances = information, [covariance_of(one) for one in information]
        pairs = zip(self._parts, self._covariances, strict=True)
        self.value = float(self._total([criterion.of(_shared(model, own)) for (model, criterion), own in pairs]))

    def _total(self, values: Sequence[Float[np.ndarray, "*n"]]) -> Float[np.ndarray, "*n"]:
        """The weighted sum of the largest value of each term."""
        return self._weights @ np.maximum.reduceat(np.array(values), self._first, axis=0)

    def if_added(self, cells: Int[np.ndarray, " some"]) -> Float[np.ndarray, " some"]:
        """Values after one more position in each of some cells."""
        return self._changed(cells, 1)

    def if_removed(self) -> Float[np.ndarray, " positions"]:
        """Values without each of the positions."""
        return self._changed(np.array(self.cells, int), -1)

    def _changed(self, cells: Int[np.ndarray, " some"], sign: int) -> Float[np.ndarray, " some"]:
        pairs = zip(self._parts, self._covariances, strict=True)
        return self._total(
            [
                criterion.changed(_shared(model, own), _change(model, own, cells, sign), -sign)
                for (model, criterion), own in pairs
            ]
        )

    def add(self, cell: int) -> None:
        """Add a position."""
        self.cells.append(cell)
        self._update(cell, 1)

    def remove(self, cell: int) -> None:
        """Remove a position in this cell."""
        self.cells.remove(cell)
        self._update(cell, -1)

    def _update(self, cell: int, sign: int) -> None:
        rows = [model.columns[cell] for model, _ in self._parts]
        self._settle([one + sign * own.T @ own for one, own in zip(self._information, rows, strict=True)])


def _shared(model: LinearModel, covariance: Float[np.ndarray, "all all"]) -> Float[np.ndarray, "shared shared"]:
    return covariance[: len(model.names), : len(model.names)]


def _change(
    model: LinearModel, covariance: Float[np.ndarray, "all all"], cells: Int[np.ndarray, " some"], sign: int
) -> Float[np.ndarray, "some 3 shared"]:
    """Parts of the change of the covariance by a position more (1) or less (-1) in each cell: L^-1 U with L L' = 1 + sign times
    its prediction, U the covariance of its readings with the shared parameters."""
    rows = model.columns[cells]
    across = (rows.reshape(-1, rows.shape[2]) @ covariance).reshape(rows.shape)
    inner, across = sign * across @ rows.swapaxes(1, 2), across[:, :, : len(model.names)]
    first = np.sqrt(np.maximum(1 + inner[:, 0, 0], _FLOOR))
    low, lower = inner[:, 1, 0] / first, inner[:, 2, 0] / first
    second = np.sqrt(np.maximum(1 + inner[:, 1, 1] - low**2, _FLOOR))
    lowest = (inner[:, 2, 1] - low * lower) / second
    third = np.sqrt(np.maximum(1 + inner[:, 2, 2] - lower**2 - lowest**2, _FLOOR))
    one = across[:, 0] / first[:, None]
    two = (across[:, 1] - low[:, None] * one) / second[:, None]
    three = (across[:, 2] - lower[:, None] * one - lowest[:, None] * two) / third[:, None]
    return np.stack([one, two, three], axis=1)
