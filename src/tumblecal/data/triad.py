"""The linear correction of a triad: the same for all rows, or for each row at its temperature."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


Rows = Float[np.ndarray, "rows 3"]


@dataclass(frozen=True)
class Triad:
    """Matrix and bias of `f = matrix (A - bias)`, and the sensitive axes of `u = axes f`, their inputs.

    For all rows, (3, 3) and (3,), or for each, (rows, 3, 3) and (rows, 3). In the triad's frame the axes are
    T = [1 0 0; gamma_21 1 0; gamma_31 gamma_32 1].
    """

    matrix: Float[np.ndarray, "*rows 3 3"]
    bias: Float[np.ndarray, "*rows 3"]
    axes: Float[np.ndarray, "*rows 3 3"]

    def force(self, readings: Rows) -> Rows:
        """Specific force from readings, g."""
        return _product(self.matrix, readings - self.bias)

    def inputs(self, force: Rows) -> Rows:
        """Inputs along the sensitive axes from specific force, g."""
        return _product(self.axes, force)


def _product(matrix: np.ndarray, rows: Rows) -> Rows:
    return rows @ matrix.T if matrix.ndim == 2 else np.einsum("rij,rj->ri", matrix, rows)
