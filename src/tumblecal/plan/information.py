"""Information on parameters, and the white rows of cells that would add to it: every choice of positions is made from these."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Information:
    """An information matrix, and what a position in each cell adds.

    - `columns` (cells, 3, all): derivatives of the readings of a cell by the parameters, in standard deviations of the noise.
    - `information`: before these positions.
    """

    columns: Float[np.ndarray, "*n cells 3 all"]
    information: Float[np.ndarray, "*n all all"]

    def rows(self, cells: Sequence[int] | np.ndarray) -> Float[np.ndarray, "*proposals rows all"]:
        """Rows of some cells, one under another, or of each of several lists of cells."""
        chosen = self.columns[np.asarray(cells, int)]
        return chosen.reshape(*chosen.shape[:-3], -1, chosen.shape[-1])

    def information_with(self, cells: Sequence[int] | np.ndarray) -> Float[np.ndarray, "all all"]:
        """Information after positions in some cells; one that is listed twice is measured twice."""
        rows = self.rows(cells)
        return self.information + rows.T @ rows


def covariance_of(information: Float[np.ndarray, "*n all all"]) -> Float[np.ndarray, "*n all all"]:
    """Covariance of all parameters, or of each of several; scaled to a unit diagonal for accuracy."""
    size = 1 / np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
    scale = size[..., :, None] * size[..., None, :]
    return scale * np.linalg.inv(information * scale)
