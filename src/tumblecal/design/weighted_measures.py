"""A weighted sum of measures, for criteria of different kinds."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.design.measure import Measure, Measures


class WeightedSum:
    """A weighted sum of several measures of the same positions."""

    def __init__(self, measures: Sequence[Measure], weights: Sequence[float]):
        self._measures, self._weights = measures, np.asarray(weights, float)

    @property
    def value(self) -> float:
        """Value of the positions so far."""
        return float(self._weights @ [measure.value for measure in self._measures])

    @property
    def cells(self) -> tuple[int, ...]:
        """Cells of the positions."""
        return self._measures[0].cells

    def if_added(self) -> Float[np.ndarray, " cells"]:
        """Values after one more position, for each cell."""
        return self._weights @ np.stack([measure.if_added() for measure in self._measures])

    def if_removed(self) -> Float[np.ndarray, " positions"]:
        """Values without each of the positions."""
        return self._weights @ np.stack([measure.if_removed() for measure in self._measures])

    def add(self, cell: int) -> None:
        """Add a position."""
        for measure in self._measures:
            measure.add(cell)

    def remove(self, position: int) -> None:
        """Remove the position with this number in `cells`."""
        for measure in self._measures:
            measure.remove(position)


def weighted_measures(factories: Sequence[Measures], weights: Sequence[float]) -> Measures:
    """Weighted sums of the measures of several factories."""
    return lambda cells: WeightedSum([factory(cells) for factory in factories], weights)
