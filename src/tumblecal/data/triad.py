"""The linear correction of a triad: the same for all rows, or for each row at its temperature."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float


Rows = Float[np.ndarray, "rows 3"]


@dataclass(frozen=True)
class Triad:
    """Matrix and bias of `f = matrix (A - bias)`: for all rows, (3, 3) and (3,), or for each, (rows, 3, 3) and (rows, 3).

    The inputs along the sensitive axes are `u = T f`, T = [1 0 0; gamma_21 1 0; gamma_31 gamma_32 1] in the triad's frame.
    `scale`: 1 + dK; of a matrix in the triad's frame the diagonal of its inverse.
    """

    matrix: Float[np.ndarray, "*rows 3 3"]
    bias: Float[np.ndarray, "*rows 3"]
    scale: Float[np.ndarray, "*rows 3"]

    @cached_property
    def _axes(self) -> Float[np.ndarray, "*rows 3 3"]:
        return np.linalg.inv(self.matrix) / self.scale[..., None]

    def force(self, readings: Rows) -> Rows:
        """Specific force from readings, g."""
        return _product(self.matrix, readings - self.bias)

    def inputs(self, force: Rows) -> Rows:
        """Inputs along the sensitive axes from specific force, g."""
        return _product(self._axes, force)


def _product(matrix: np.ndarray, rows: Rows) -> Rows:
    return rows @ matrix.T if matrix.ndim == 2 else np.einsum("rij,rj->ri", matrix, rows)
