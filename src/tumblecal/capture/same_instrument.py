"""Comparison of two dwells of an instrument at the same position, within their noise.

The size of the specific force does not depend on how exactly the head returns to a position; its direction does, by the
repeatability of the head. Slow noise between two dwells is estimated from the differences between means of stretches within
them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from tumblecal.capture.stationarity import Block


# One false disagreement in a million comparisons.
LEAST_P = 1e-6
# Standard uncertainty of returning to a position: optical dividing heads repeat to some arc seconds.
REPEATABILITY_RAD = np.radians(10.0 / 3600)
_STRETCHES = 6


@dataclass(frozen=True)
class Comparison:
    """Two dwells at one position.

    **Arguments:**

    - `difference_g`: second minus first mean, local g, shape (3,). `u_g`: its standard uncertainty per axis.
    - `p`: probability of such a difference for the same instrument. `agrees`: whether that is credible.
    """

    difference_g: NDArray[np.float64]
    u_g: NDArray[np.float64]
    p: float

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the noise."""
        return self.p >= LEAST_P

    @property
    def text(self) -> str:
        """The result in words."""
        axis = int(np.argmax(np.abs(self.difference_g) / self.u_g))
        size = float(self.difference_g[axis])
        return (
            f"{'agrees' if self.agrees else 'differs'}: largest difference {1e3 * size:+.3f} mg in {'xyz'[axis]} "
            f"({abs(size) / self.u_g[axis]:.1f} u), p {'= ' + format(self.p, '.2g') if self.p > 1e-100 else '< 1e-100'}"
        )


def mean_variance(blocks: list[Block]) -> NDArray[np.float64]:
    """Variance of a dwell's mean per axis: from its white noise, and from the slow noise between stretches of it, which
    averaging over one dwell does not reduce."""
    n = sum(block.n for block in blocks)
    white = np.mean([block.sd**2 for block in blocks], axis=0)
    means = np.array([block.mean for block in blocks])
    count = min(_STRETCHES, len(means))
    if count < 2:
        return white / n
    stretches = np.array([part.mean(0) for part in np.array_split(means, count)])
    return white / n + np.maximum(stretches.var(0, ddof=1) - white * count / n, 0.0)


def compare(before_g: NDArray[np.float64], before_variance: NDArray[np.float64], blocks: list[Block]) -> Comparison:
    """Compare the mean of an earlier dwell and its variance per axis with a new dwell."""
    mean = np.average([block.mean for block in blocks], axis=0, weights=[block.n for block in blocks])
    difference = mean - before_g
    direction = before_g / np.linalg.norm(before_g)
    # Two arrivals at the position; a turn changes the reading at right angles to gravity only.
    turned = 2 * REPEATABILITY_RAD**2 * (np.eye(3) - np.outer(direction, direction))
    covariance = np.diag(before_variance + mean_variance(blocks)) + turned
    quadratic = float(difference @ np.linalg.solve(covariance, difference))
    return Comparison(difference, np.sqrt(np.diag(covariance)), float(chdtrc(3, quadratic)))
