"""What causes that are in no catalogue are written with, and how they are given a size; plain numpy."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from blind_instrument import Setup, readings


# The readings, g, of an instrument in which the cause has a given size (rad or g).
Sized = Callable[[float], np.ndarray]


def sized_to(sized: Sized, projector: np.ndarray, sigma: float, d: float) -> tuple[float, np.ndarray] | None:
    """The size at which the unreachable part has norm d sigma, and that part; None when hardly any of it is visible, or no
    such size is found: an angle that is off by turns reads what it should."""
    plain, size = sized(0.0), 1e-5
    for _ in range(5):
        whole = (sized(size) - plain).ravel() / sigma
        signal = projector @ whole
        norm = np.linalg.norm(signal)
        if not norm > 0.05 * np.linalg.norm(whole):
            return None
        size *= d / norm
    reached = np.linalg.norm(projector @ (sized(size) - plain).ravel() / sigma)
    return (size, signal) if abs(reached - d) < 0.05 * d else None


def rocked(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """What the readings gain for a radian of base levelling, and of pitch, g (positions, 3)."""
    plain, tilt = readings(setup, setup.nominal, {}), 1e-3
    levelled = readings(setup, setup.nominal, {"base_levelling": np.array([tilt])})
    pitched = readings(replace(setup, beta=setup.beta + tilt), setup.nominal, {})
    return (levelled - plain) / tilt, (pitched - plain) / tilt


def direction(rng: np.random.Generator) -> np.ndarray:
    """A random unit vector."""
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def bump_at(alpha: np.ndarray, centre: float, width: float) -> np.ndarray:
    """A Gaussian bump over the spindle angle."""
    away = np.angle(np.exp(1j * (alpha - centre)))
    return np.exp(-0.5 * (away / width) ** 2)


def inputs(setup: Setup) -> np.ndarray:
    """The inputs of the axes without bias and scale error, g."""
    return readings(setup, setup.nominal | {"dK": np.zeros(3), "bias": np.zeros(3)}, {})


def on_output(setup: Setup, axis: int, shape: np.ndarray) -> Sized:
    """A shape in time or over the positions that is added to one output."""
    added = np.zeros((len(shape), 3))
    added[:, axis] = shape
    return lambda size: readings(setup, setup.nominal, {}) + size * added
