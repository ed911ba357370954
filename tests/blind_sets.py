"""Position sets of the blind instrument, and the sets of causes of an answer."""

import numpy as np

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.data import PositionSet


def measured(setup, effects, rng, *, known: bool = True, noise=1.0, columns: bool = True) -> PositionSet:
    """Readings with these effects and white noise; `noise`: its sd as a multiple of the stated one."""
    clean = blind.readings(setup, setup.nominal, effects)
    return position_set(setup, clean + blind.SIGMA * noise * rng.normal(size=clean.shape), known, columns)


def of_size(setup, name: str, direction, d: float) -> np.ndarray:
    """Coefficients whose part that the nominal model cannot reach has norm d sigma."""
    plain = blind.readings(setup, setup.nominal, {})
    unit = np.asarray(direction) * 1e-6
    signal = blind.unreachable(setup) @ (blind.readings(setup, setup.nominal, {name: unit}) - plain).ravel()
    return unit * d * blind.SIGMA / np.linalg.norm(signal)


def classes(diagnosis) -> set[tuple[str, ...]]:
    """The leading set of causes and those that the data do not distinguish from it."""
    return {diagnosis.best.labels, *diagnosis.best.equivalents}
