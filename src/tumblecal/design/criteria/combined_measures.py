"""Several measures of the same positions as one: a weighted sum, for criteria of different kinds, or the largest."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.design.criteria.measure import Measure, Measures


class CombinedMeasure:
    """Several measures of the same positions; `combine`: of their values (measures, n) to (n,)."""

    def __init__(self, measures: Sequence[Measure], combine: Callable[[np.ndarray], np.ndarray]):
        self._measures, self._combine = measures, combine

    @property
    def value(self) -> float:
        """Value of the positions so far."""
        return float(self._combine(np.array([[measure.value] for measure in self._measures]))[0])

    @property
    def cells(self) -> tuple[int, ...]:
        """Cells of the positions."""
        return self._measures[0].cells

    def if_added(self) -> Float[np.ndarray, " cells"]:
        """Values after one more position, for each cell."""
        return self._combine(np.stack([measure.if_added() for measure in self._measures]))

    def if_removed(self) -> Float[np.ndarray, " positions"]:
        """Values without each of the positions."""
        return self._combine(np.stack([measure.if_removed() for measure in self._measures]))

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
    shares = np.asarray(weights, float)
    return lambda cells: CombinedMeasure([factory(cells) for factory in factories], lambda values: shares @ values)


def largest_measures(factories: Sequence[Measures]) -> Measures:
    """The largest of the measures of several factories."""
    return lambda cells: CombinedMeasure([factory(cells) for factory in factories], lambda values: values.max(axis=0))
