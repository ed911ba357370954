"""How a cause without an entry of the catalogue acts on the blind instrument, and how it gets its size; plain numpy."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from blind_instrument import Setup, readings, turned


# The readings, g, of an instrument in which the cause has a given size (rad or g).
Sized = Callable[[float], np.ndarray]
TURN = 2 * np.pi


def sized_to(sized: Sized, projector: np.ndarray, sigma: float, d: float) -> tuple[float, np.ndarray] | None:
    """The size at which the visible part has the norm d sigma, and that part; None if hardly any of it is visible."""
    plain, size = sized(0.0), 1e-5
    for _ in range(5):
        whole = (sized(size) - plain).ravel() / sigma
        signal = projector @ whole
        norm = np.linalg.norm(signal)
        if not norm > 0.05 * np.linalg.norm(whole):
            return None
        size *= d / norm
    # An angle in error by turns gives the correct reading: no such size exists.
    reached = np.linalg.norm(projector @ (sized(size) - plain).ravel() / sigma)
    return (size, signal) if abs(reached - d) < 0.05 * d else None


def on_index(setup: Setup, error: np.ndarray) -> Sized:
    """An error of the spindle angle."""
    return lambda size: readings(replace(setup, alpha=setup.alpha + size * error), setup.nominal, {})


def on_pitch(setup: Setup, error: np.ndarray) -> Sized:
    """An error of the pitch angle."""
    return lambda size: readings(replace(setup, beta=setup.beta + size * error), setup.nominal, {})


def on_outputs(setup: Setup, added: np.ndarray) -> Sized:
    """A signal (positions, 3) in addition to the outputs."""
    plain = readings(setup, setup.nominal, {})
    return lambda size: plain + size * added


def on_output(setup: Setup, axis: int, shape: np.ndarray) -> Sized:
    """A signal in addition to one output."""
    return on_outputs(setup, shape[:, None] * np.eye(3)[axis])


def on_attitude(setup: Setup, vectors: np.ndarray) -> Sized:
    """Small rotations of the triad by vectors (positions, 3)."""
    return on_outputs(setup, np.cross(readings(setup, setup.nominal, {}), vectors))


def on_table(setup: Setup, levelling: np.ndarray, pitch: np.ndarray) -> Sized:
    """Base levelling and pitch that differ from position to position."""
    plain, tilt = readings(setup, setup.nominal, {}), 1e-3
    levelled = readings(setup, setup.nominal, {"base_levelling": np.array([tilt])}) - plain
    pitched = readings(replace(setup, beta=setup.beta + tilt), setup.nominal, {}) - plain
    return on_outputs(setup, (levelling[:, None] * levelled + pitch[:, None] * pitched) / tilt)


def on_spindle(setup: Setup, vectors: np.ndarray) -> Sized:
    """Rotations of the spindle by vectors in the frame of the pitch table."""
    return lambda size: seen_from(setup, Rotation.from_rotvec(size * vectors).apply(pitched(setup)))


def pitched(setup: Setup, level: np.ndarray | None = None) -> np.ndarray:
    """Gravity, or vectors in the level frame, in the frame of the pitch table."""
    level = np.tile([0.0, 0.0, 1.0], (len(setup.beta), 1)) if level is None else level
    return turned("y", setup.beta + setup.nominal["dbeta"][setup.pitch], level)


def in_triad(setup: Setup, f: np.ndarray) -> np.ndarray:
    """Vectors of the pitch table's frame in that of the triad."""
    f = turned("x", setup.alpha, f)
    for axis, angle in zip("zyx", setup.nominal["dtheta"][::-1], strict=True):
        f = turned(axis, np.array(angle), f)
    return f


def seen_from(setup: Setup, f: np.ndarray) -> np.ndarray:
    """Outputs if gravity in the frame of the pitch table is `f`."""
    f, (g21, g31, g32) = in_triad(setup, f), setup.nominal["gamma"]
    u = np.stack([f[:, 0], f[:, 1] + g21 * f[:, 0], f[:, 2] + g31 * f[:, 0] + g32 * f[:, 1]], axis=1)
    return outputs(setup, u)


def outputs(setup: Setup, u: np.ndarray) -> np.ndarray:
    """Outputs of the inputs `u`, g."""
    return (1 + setup.nominal["dK"]) * u + setup.nominal["bias"]


def inputs(setup: Setup) -> np.ndarray:
    """Inputs of the axes without bias and scale factor error, g."""
    return readings(setup, setup.nominal | {"dK": np.zeros(3), "bias": np.zeros(3)}, {})


def direction(rng: np.random.Generator) -> np.ndarray:
    """A random unit vector."""
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def some_axes(rng: np.random.Generator) -> np.ndarray:
    """Signed weights of one, two or three axes."""
    weights = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.3, 1.0, 3)
    return np.where(np.isin(np.arange(3), rng.permutation(3)[: rng.integers(1, 4)]), weights, 0.0)


def bump(alpha: np.ndarray, rng: np.random.Generator, least: float = 0.3, most: float = 0.8) -> np.ndarray:
    """A Gaussian bump over the spindle angle, at a random place and of a random width, rad."""
    away = np.angle(np.exp(1j * (alpha - rng.uniform(0, TURN))))
    return np.exp(-0.5 * (away / rng.uniform(least, most)) ** 2)


def elapsed(setup: Setup) -> np.ndarray:
    """Time, 0 to 1."""
    return (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)


def step_s(setup: Setup) -> float:
    """Median time from position to position, s."""
    return float(np.median(np.diff(np.sort(setup.time_s))))


def past(setup: Setup, time_constant: float) -> np.ndarray:
    """Weights (positions, positions) of each earlier position, which fade with a time constant, s."""
    since = setup.time_s[:, None] - setup.time_s
    return np.exp(-np.maximum(since, 0.0) / time_constant) * (since >= 0)


def followed(setup: Setup, drive: np.ndarray, time_constant: float, *, empty: bool = False) -> np.ndarray:
    """The response of first order to a drive (positions, ...); at rest at first, or zero."""
    state, rows = np.zeros(drive.shape[1:]) if empty else drive[0], []
    for own, step in zip(drive, np.append(60.0, np.diff(setup.time_s)), strict=True):
        state = state + (1 - np.exp(-step / time_constant)) * (own - state)
        rows.append(state)
    return np.array(rows)
