"""Causes that are in no catalogue and are no generic term either: bumps, knees, a stick, a creep at some angles only.

Each is a random function of the true angles, the inputs and the time; plain numpy, like the instrument that it acts on.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from blind_instrument import Setup, readings


# The readings, g, of an instrument in which the cause has a given size (rad or g).
Sized = Callable[[float], np.ndarray]


def bump_of_the_index(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index is off around one angle only: a Gaussian bump."""
    bump = _bump(setup.alpha, rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.8))
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * bump), setup.nominal, {})


def cable_pull(setup: Setup, rng: np.random.Generator) -> Sized:
    """A cable turns the triad about a random axis where it comes taut, the more the higher the pitch."""
    taut = _bump(setup.alpha, rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.8)) * (0.5 + np.sin(setup.beta))
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)

    def turned(size: float) -> np.ndarray:
        plain = readings(setup, setup.nominal, {})
        return plain + size * taut[:, None] * np.cross(plain, axis)

    return turned


def knee(setup: Setup, rng: np.random.Generator) -> Sized:
    """The slope of one output changes smoothly at a random input: a saturating tanh."""
    axis, centre, width = rng.integers(3), rng.uniform(-0.7, 0.7), rng.uniform(0.05, 0.25)
    return _on_output(setup, axis, np.tanh((_inputs(setup)[:, axis] - centre) / width))


def angle_times_time(setup: Setup, rng: np.random.Generator) -> Sized:
    """One output follows the double spindle angle more and more as time goes on."""
    time = setup.time_s / setup.time_s[-1]
    return _on_output(setup, rng.integers(3), time * np.sin(2 * setup.alpha - rng.uniform(0, 2 * np.pi)))


def stick_at_one_pitch(setup: Setup, rng: np.random.Generator) -> Sized:
    """At one pitch setting the spindle sticks and stays off for a few positions, then slips back."""
    rows = np.flatnonzero(setup.pitch == rng.choice(setup.pitch))
    length = rng.integers(2, max(3, len(rows) // 2 + 1))
    first = rng.integers(len(rows) - length + 1)
    stuck = np.zeros(len(setup.alpha))
    stuck[rows[first : first + length]] = np.linspace(0.5, 1.0, length)
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * stuck), setup.nominal, {})


UNLISTED = {
    "bump of the index": bump_of_the_index,
    "cable pull": cable_pull,
    "knee of an output": knee,
    "angle times time": angle_times_time,
    "stick at one pitch": stick_at_one_pitch,
}


def square_of_another_axis(setup: Setup, rng: np.random.Generator) -> Sized:
    """u_x u_y^2 and its like: an error that belongs to the attitude."""
    i, j = rng.choice(3, 2, replace=False)
    u = _inputs(setup)
    return _on_output(setup, int(rng.choice([i, j])), u[:, i] * u[:, j] ** 2)


def sized_to(sized: Sized, projector: np.ndarray, sigma: float, d: float) -> tuple[float, np.ndarray] | None:
    """The size at which the unreachable part has norm d sigma, and that part; None when hardly any of it is visible."""
    plain, size = sized(0.0), 1e-5
    for _ in range(5):
        whole = (sized(size) - plain).ravel() / sigma
        signal = projector @ whole
        norm = np.linalg.norm(signal)
        if norm < 0.05 * np.linalg.norm(whole):
            return None
        size *= d / norm
    return size, signal


def _bump(alpha: np.ndarray, centre: float, width: float) -> np.ndarray:
    away = np.angle(np.exp(1j * (alpha - centre)))
    return np.exp(-0.5 * (away / width) ** 2)


def _inputs(setup: Setup) -> np.ndarray:
    return readings(setup, setup.nominal | {"dK": np.zeros(3), "bias": np.zeros(3)}, {})


def _on_output(setup: Setup, axis: int, shape: np.ndarray) -> Sized:
    added = np.zeros((len(shape), 3))
    added[:, axis] = shape
    return lambda size: readings(setup, setup.nominal, {}) + size * added
