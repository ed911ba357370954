"""Simulated position sets for these tests, made by the independent chain."""

import numpy as np

import independent
from tumblecal.data import PositionSet


PAPER_ALPHA = np.tile(np.arange(8) * 45.0, 3)
PAPER_BETA = np.repeat([0.0, 45.0, 90.0], 8)


def positions(alpha_deg, beta_deg, readings, **columns) -> PositionSet:
    """A position set with made-up names."""
    return PositionSet(
        names=tuple(str(number) for number in range(len(alpha_deg))),
        alpha_deg=np.asarray(alpha_deg, float),
        beta_deg=np.asarray(beta_deg, float),
        readings=np.asarray(readings, float),
        **columns,
    )


def setting(beta_deg) -> np.ndarray:
    """Number of each position's pitch setting, by increasing angle."""
    return np.unique(beta_deg, return_inverse=True)[1]


def measured(vector, alpha_deg=PAPER_ALPHA, beta_deg=PAPER_BETA, sd=0.0, seed=0, **columns) -> PositionSet:
    """A position set of an instrument with these nominal parameters and white noise, g."""
    readings = independent.nominal(np.asarray(vector), np.radians(alpha_deg), np.radians(beta_deg), setting(beta_deg))
    noise = sd * np.random.default_rng(seed).normal(size=readings.shape)
    return positions(alpha_deg, beta_deg, readings + noise, **columns)


def random_vector(seed: int, size: int = 15, spread: float = np.radians(5)) -> np.ndarray:
    """Angles up to 5 degrees, scale errors and biases up to the same number."""
    return np.random.default_rng(seed).uniform(-spread, spread, size)
