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


def worm_of_the_index(setup: Setup, rng: np.random.Generator) -> Sized:
    """The index follows a worm gear of five to seven turns: a sawtooth."""
    teeth, phase = rng.integers(5, 8), rng.uniform(0, 1)
    saw = (teeth * setup.alpha / (2 * np.pi) + phase) % 1.0 - 0.5
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * saw), setup.nominal, {})


def clamp_gives_way(setup: Setup, rng: np.random.Generator) -> Sized:
    """The triad turns slowly about a random axis in its clamp, and is put right after a third of the time."""
    time, first = setup.time_s / setup.time_s[-1], rng.uniform(0.1, 0.5)
    given = np.where((time > first) & (time < first + 0.35), (time - first) / 0.35, 0.0)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    plain = readings(setup, setup.nominal, {})
    return lambda size: plain + size * given[:, None] * np.cross(plain, axis)


def knee_of_another_axis(setup: Setup, rng: np.random.Generator) -> Sized:
    """One output changes smoothly at a random input of another axis."""
    axis, other = rng.choice(3, 2, replace=False)
    centre, width = rng.uniform(-0.7, 0.7), rng.uniform(0.05, 0.25)
    return _on_output(setup, int(axis), np.tanh((_inputs(setup)[:, other] - centre) / width))


def gust(setup: Setup, rng: np.random.Generator) -> Sized:
    """Two outputs are off for a while."""
    time, when = setup.time_s / setup.time_s[-1], rng.uniform(0.1, 0.9)
    pulse = np.exp(-0.5 * ((time - when) / rng.uniform(0.04, 0.1)) ** 2)
    added = pulse[:, None] * rng.normal(size=3) * (np.arange(3) != rng.integers(3))
    return lambda size: readings(setup, setup.nominal, {}) + size * added


UNLISTED = {
    "bump of the index": bump_of_the_index,
    "cable pull": cable_pull,
    "knee of an output": knee,
    "angle times time": angle_times_time,
    "stick at one pitch": stick_at_one_pitch,
}
# Nothing was tuned on these: they came after the shapes of `diagnosis/shape_causes.py`.
UNSEEN = {
    "worm of the index": worm_of_the_index,
    "clamp gives way": clamp_gives_way,
    "knee of another axis": knee_of_another_axis,
    "gust": gust,
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
