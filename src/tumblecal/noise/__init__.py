"""Noise of an accelerometer triad: parts with closed forms, Allan deviation, fits, samples, covariances. numpy only.

`Part` is the type of one part: each has `allan_variance` (*tau, 3) and `mean_covariance` (3, positions, positions), in g^2.

Examples:
    >>> import numpy as np
    >>> from tumblecal.noise import Noise, Part, RandomWalk, White
    >>> parts: list[Part] = [White(np.full(3, 60e-6)), RandomWalk(np.full(3, 1e-7))]
    >>> Noise(tuple(parts)).allan_deviation(np.array([1.0])).shape
    (1, 3)
"""

from tumblecal.noise.covariance import Covariance
from tumblecal.noise.parts import (
    Dwells,
    Flicker,
    GaussMarkov,
    Noise,
    Part,
    Quantisation,
    RandomWalk,
    White,
    regular_dwells,
)


__all__ = [
    "Covariance",
    "Dwells",
    "Flicker",
    "GaussMarkov",
    "Noise",
    "Part",
    "Quantisation",
    "RandomWalk",
    "White",
    "regular_dwells",
]
