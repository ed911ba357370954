"""The contribution of effects that were not detected to the uncertainty, from `effect_posterior`."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class UndetectedEffects:
    """Contribution of effects that are not written to some quantities.

    - `covariance`: mean square of the shifts about the values that are written.
    - `shifts`: of the quantities by one unit of each direction of the effects' coefficients; `steps`: the direction in the
      scaled full vector; `products`: mean products of the coefficients, given the data; `numbers`: whose each is among `ids`.
    - `named`: the directions of effects that are written.
    """

    __repr__ = brief

    covariance: Float[np.ndarray, "quantities quantities"]
    shifts: Float[np.ndarray, "quantities directions"]
    steps: Float[np.ndarray, "directions full"]
    products: Float[np.ndarray, "directions directions"]
    numbers: Int[np.ndarray, " directions"]
    ids: tuple[str, ...]
    named: Bool[np.ndarray, " directions"]

    @cached_property
    def effects(self) -> set[str]:
        """Ids of the effects of which nothing is written."""
        return {self.ids[number] for number in np.unique(self.numbers[~self.named]).tolist()}

    def strongest(self, quantity: int, most: int) -> list[str]:
        """The effects that add most to the uncertainty of one quantity."""
        squares = self.shifts[quantity] ** 2 * np.diag(self.products) * ~self.named
        parts = np.bincount(self.numbers, squares, len(self.ids))
        return [self.ids[number] for number in np.argsort(-parts)[:most].tolist() if parts[number] > 0]
