"""Noise of an accelerometer triad: parts with closed forms, Allan deviation, fits, samples, covariances. numpy only."""

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
