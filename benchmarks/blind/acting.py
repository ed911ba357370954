"""How a cause without an entry of the catalogue acts on the blind instrument, and how it gets its size; plain numpy."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from blind_instrument import Setup, along_axes, mounted, readings, turned


# The readings, g, of an instrument in which the cause has a given size (rad or g).
Sized = Callable[[float], np.ndarray]
Cause = Callable[[Setup, np.random.Generator], Sized]
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


def inputs(setup: Setup) -> np.ndarray:
    """Inputs of the axes without bias and scale factor error, g."""
    return readings(setup, setup.nominal | {"dK": np.zeros(3), "bias": np.zeros(3)}, {})


def direction(rng: np.random.Generator) -> np.ndarray:
    """A random unit vector."""
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


class Scene:
    """A setup and a generator, and what the shapes of causes are made of.

    - `time_s`: from the start; `share` and `of`: the time over its end, 0 to 1 for `of`; `step_s`: median step.
    - `u`: inputs (positions, 3), g; `side`: of the approach.
    """

    def __init__(self, setup: Setup, rng: np.random.Generator):
        self.setup, self.rng, self.between, self.normal = setup, rng, rng.uniform, rng.normal
        self.alpha, self.beta, self.pitch, self.side = setup.alpha, setup.beta, setup.pitch, setup.approach
        self.degc, self.count, self.time_s = setup.temperature_degc, len(setup.alpha), setup.time_s - setup.time_s[0]
        self.share, self.of = setup.time_s / setup.time_s[-1], self.time_s / np.ptp(setup.time_s)
        self.step_s = float(np.median(np.diff(np.sort(setup.time_s))))
        self.plain, self.u = readings(setup, setup.nominal, {}), inputs(setup)
        self.settings = [np.flatnonzero(setup.pitch == own) for own in np.unique(setup.pitch)]

    def phase(self) -> float:
        """A random angle."""
        return self.rng.uniform(0, TURN)

    def axis(self) -> int:
        """One of three."""
        return int(self.rng.integers(3))

    def two(self) -> np.ndarray:
        """Two different axes."""
        return self.rng.choice(3, 2, replace=False)

    def vector(self) -> np.ndarray:
        """A random unit vector."""
        return direction(self.rng)

    def axes(self) -> np.ndarray:
        """Signed weights of one, two or three axes."""
        weights = self.rng.choice([-1.0, 1.0], 3) * self.between(0.3, 1.0, 3)
        return np.where(np.isin(np.arange(3), self.rng.permutation(3)[: self.rng.integers(1, 4)]), weights, 0.0)

    def bump(self, least: float = 0.3, most: float = 0.8) -> np.ndarray:
        """A Gaussian bump over the spindle angle, at a random place and of a random width, rad."""
        away = np.angle(np.exp(1j * (self.alpha - self.phase())))
        return np.exp(-0.5 * (away / self.between(least, most)) ** 2)

    def knee(self, v: np.ndarray) -> np.ndarray:
        """A smooth change at a random input."""
        centre, width = self.between(-0.7, 0.7), self.between(0.05, 0.25)
        return np.tanh((v - centre) / width)

    def past(self, low: float, high: float) -> np.ndarray:
        """Weights (positions, positions) of each earlier position, which fade with a time constant in steps."""
        since = self.setup.time_s[:, None] - self.setup.time_s
        return np.exp(-np.maximum(since, 0.0) / (self.between(low, high) * self.step_s)) * (since >= 0)

    def late(self, drive: np.ndarray, time_constant: float, *, empty: bool = False) -> np.ndarray:
        """The response of first order to a drive (positions, ...), time constant in s; at rest at first, or zero."""
        state, rows = np.zeros(drive.shape[1:]) if empty else drive[0], []
        for own, step in zip(drive, np.append(60.0, np.diff(self.setup.time_s)), strict=True):
            state = state + (1 - np.exp(-step / time_constant)) * (own - state)
            rows.append(state)
        return np.array(rows)

    def pitched(self, level: np.ndarray | None = None) -> np.ndarray:
        """Gravity, or vectors in the level frame, in the frame of the pitch table."""
        level = np.tile([0.0, 0.0, 1.0], (self.count, 1)) if level is None else level
        return turned("y", self.beta + self.setup.nominal["dbeta"][self.pitch], level)

    def in_triad(self, f: np.ndarray) -> np.ndarray:
        """Vectors of the pitch table's frame in that of the triad."""
        return mounted(turned("x", self.alpha, f), self.setup.nominal["dtheta"])

    def seen_from(self, f: np.ndarray) -> np.ndarray:
        """Outputs if gravity in the frame of the pitch table is `f`."""
        return self.outputs(along_axes(self.in_triad(f), self.setup.nominal["gamma"]))

    def outputs(self, u: np.ndarray) -> np.ndarray:
        """Outputs of the inputs `u`, g."""
        return (1 + self.setup.nominal["dK"]) * u + self.setup.nominal["bias"]


# Each of these makes a cause of a shape: values of the positions, or vectors, drawn in a scene.
def index(s: Scene, error: np.ndarray) -> Sized:
    """An error of the spindle angle."""
    return lambda size: readings(replace(s.setup, alpha=s.alpha + size * error), s.setup.nominal, {})


def pitch(s: Scene, error: np.ndarray) -> Sized:
    """An error of the pitch angle."""
    return lambda size: readings(replace(s.setup, beta=s.beta + size * error), s.setup.nominal, {})


def outputs(s: Scene, added: np.ndarray) -> Sized:
    """A signal (positions, 3) in addition to the outputs."""
    return lambda size: s.plain + size * added


def output(s: Scene, added: tuple[int, np.ndarray]) -> Sized:
    """An axis, and a signal in addition to its output."""
    return outputs(s, added[1][:, None] * np.eye(3)[added[0]])


def any_output(s: Scene, added: np.ndarray) -> Sized:
    """The same, the axis drawn last."""
    return output(s, (s.axis(), added))


def attitude(s: Scene, vectors: np.ndarray) -> Sized:
    """Small rotations of the triad by vectors."""
    return outputs(s, np.cross(s.plain, vectors))


def tilt(s: Scene, angle: np.ndarray) -> Sized:
    """The same about one random axis."""
    return attitude(s, angle[:, None] * s.vector())


def turns(s: Scene, vectors: np.ndarray) -> Sized:
    """Rotations of the inputs by vectors."""
    return lambda size: s.outputs(Rotation.from_rotvec(size * vectors).apply(s.u))


def table(s: Scene, angles: Any) -> Sized:
    """Base levelling and pitch that differ from position to position."""
    tilt = 1e-3
    levelled = readings(s.setup, s.setup.nominal, {"base_levelling": np.array([tilt])}) - s.plain
    pitched = readings(replace(s.setup, beta=s.beta + tilt), s.setup.nominal, {}) - s.plain
    return outputs(s, (angles[0][:, None] * levelled + angles[1][:, None] * pitched) / tilt)


def level(s: Scene, vectors: np.ndarray) -> Sized:
    """Rotations of the head by vectors in the level frame."""
    up = np.array([0.0, 0.0, 1.0])
    return lambda size: s.seen_from(s.pitched(Rotation.from_rotvec(size * vectors).apply(up)))


def spindle(s: Scene, vectors: np.ndarray) -> Sized:
    """Rotations of the spindle by vectors in the frame of the pitch table."""
    return lambda size: s.seen_from(Rotation.from_rotvec(size * vectors).apply(s.pitched()))
