"""A triad on a dividing head in the fields of the Earth: plans, frames, the plain instrument, and noise by Allan coefficients.

Written for `second_instrument.py` from the geometry alone; it uses nothing of the program, nor of `blind_instrument.py`.
Ground: x along the level spindle, z up. Angles in rad, specific force in g of the site, time in s, temperature in degC.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from in_use_instrument import Schedule, reachable


UP = np.array([0.0, 0.0, 1.0])
# Pitch settings (deg), spindle angles, the first angle (deg), and whether every second setting is measured backwards.
PLANS = {
    "3x8 tilted": ((10, 40, 75), 8, 0.0, False),
    "4x12 tilted": ((-30, 5, 40, 80), 12, 15.0, False),
    "paper 3x8": ((0, 45, 90), 8, 0.0, False),
    "two mountings": ((0, 45, 90), 6, 0.0, False),
    "6x6": ((0, 18, 36, 54, 72, 90), 6, 0.0, True),
}


class Felt(NamedTuple):
    """What the sensor feels at each position: inputs along its axes (g), ground to case (matrices), temperature (degC)."""

    u: np.ndarray
    attitude: np.ndarray
    degc: np.ndarray


@dataclass(frozen=True)
class Instrument:
    """True parameters of a triad on a head, and the errors of one mechanism, position by position.

    - `index`: error of the spindle angle. `tip`: by how much the spindle's axis is turned, seen from the pitch table, and
      `table`: the table under the head, seen from the ground; rotation vectors (positions, 3).
    - `respond`: the output of each axis, g, before scale factor and bias.
    """

    scale: np.ndarray
    bias: np.ndarray
    gamma: np.ndarray
    mounts: np.ndarray
    turns: np.ndarray
    pitch_errors: np.ndarray
    index: np.ndarray | float = 0.0
    tip: np.ndarray | None = None
    table: np.ndarray | None = None
    respond: Callable[[Felt], np.ndarray] = lambda felt: felt.u


# Size (rad or g), and the instrument with the errors of a mechanism of that size.
Mechanism = Callable[[Instrument, float], Instrument]


def schedule(name: str, rng: np.random.Generator) -> Schedule:
    """A plan of `PLANS`; the room warms by 2 to 6 degC from 21 to 25 degC, with a slow wander."""
    settings, angles, first, backwards = PLANS[name]
    turn = np.radians(first) + 2 * np.pi * np.arange(angles) / angles
    alpha = np.concatenate([turn[::-1] if backwards and k % 2 else turn for k in range(len(settings))])
    pitch = np.repeat(np.arange(len(settings)), angles)
    mounting = np.repeat(np.arange(2 if name == "two mountings" else 1), len(alpha))
    mountings = mounting[-1] + 1
    alpha, pitch = np.tile(alpha, mountings), np.tile(pitch, mountings)
    time = np.cumsum(rng.uniform(40, 90, len(alpha))) + 1500.0 * mounting
    rise = rng.uniform(2, 6) * (time - time[0]) / np.ptp(time)
    degc = rng.uniform(21, 25) + rise + np.cumsum(rng.normal(0, 0.08, len(alpha)))
    approach = rng.choice([-1.0, 1.0], len(alpha))
    return Schedule(alpha, np.radians(settings)[pitch], pitch, mounting, time, degc, approach)


def instrument(plan: Schedule, rng: np.random.Generator) -> Instrument:
    """A triad with usual errors on a head with usual errors; a second mounting is a quarter turn about y."""
    mountings = plan.mounting.max() + 1
    turns = np.stack([np.eye(3), _passive("y", np.pi / 2).as_matrix()])[:mountings]
    return Instrument(
        scale=rng.normal(0, 4e-3, 3),
        bias=rng.normal(0, 4e-3, 3),
        gamma=rng.normal(0, 1e-3, 3),
        mounts=rng.normal(0, 4e-3, (mountings, 3)),
        turns=turns,
        pitch_errors=rng.normal(0, 1e-3, (mountings, plan.pitch.max() + 1)),
    )


def _passive(axis: str, angle: np.ndarray | float) -> Rotation:
    """What gives a vector's components in a frame turned about `axis` by `angle`."""
    return Rotation.from_rotvec(-np.multiply.outer(angle, np.eye(3)["xyz".index(axis)]))


def _turned(vectors: np.ndarray | None) -> Rotation:
    """What gives a vector's components in frames turned by rotation vectors."""
    return Rotation.identity() if vectors is None else Rotation.from_rotvec(-vectors)


def readings(own: Instrument, plan: Schedule) -> np.ndarray:
    """Readings without noise, g (positions, 3)."""
    about_x, about_y, about_z = own.mounts[plan.mounting].T
    mount = _passive("x", about_x) * _passive("y", about_y) * _passive("z", about_z)
    mount = mount * Rotation.from_matrix(own.turns[plan.mounting])
    pitch = _passive("y", plan.beta + own.pitch_errors[plan.mounting, plan.pitch])
    head = _passive("x", plan.alpha + own.index) * _turned(own.tip) * pitch * _turned(own.table)
    return outputs(own, (mount * head).as_matrix(), plan.temperature_degc)


def outputs(own: Instrument, attitude: np.ndarray, degc: np.ndarray) -> np.ndarray:
    """Readings at attitudes (matrices, ground to the triad's frame) and temperatures, g."""
    g21, g31, g32 = own.gamma
    x, y, z = (attitude @ UP).T
    u = np.stack([x, y + g21 * x, z + g31 * x + g32 * y], axis=1)
    return (1 + own.scale) * own.respond(Felt(u, attitude, degc)) + own.bias


def unreachable(own: Instrument, plan: Schedule) -> np.ndarray:
    """Projector on readings that the nominal parameters cannot make near the truth."""
    basis = reachable(own, plan, readings)
    return np.eye(len(basis)) - basis @ basis.T


def noise(plan: Schedule, sd: float, floor: float, walk: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of dwells of 20 s with an Allan deviation `sd` at 20 s, g (positions, 3), axes independent.

    White noise, flicker with a bias instability whose flat part is `floor * sd`, and a random walk that comes to `walk * sd`
    over the whole measurement. Flicker is the sum of Gauss-Markov processes, two a decade of time constants (1 s to 1e5 s);
    with a one-sided density B^2 / (pi f) and a flat part of 0.664 B (IEEE 952) each has the variance B^2 ln(10) / (2 pi).
    """
    dwell, pieces = 20.0, 8
    times = (plan.time_s[:, None] + dwell * (np.arange(pieces) + 0.5) / pieces).ravel()
    steps = np.append(0.0, np.diff(times))[:, None]
    walked = np.cumsum(walk * sd * np.sqrt(steps / np.ptp(times)) * rng.normal(size=(len(times), 3)), axis=0)
    bias = floor * sd / 0.664
    for tau in 10.0 ** np.arange(0, 5.1, 0.5):
        stays = np.exp(-steps / tau)
        state = rng.normal(size=3)
        drive = np.sqrt(1 - stays**2) * rng.normal(size=(len(times), 3))
        for k in range(len(times)):
            state = stays[k] * state + drive[k]
            walked[k] += bias * np.sqrt(np.log(10) / (2 * np.pi)) * state
    slow = walked.reshape(-1, pieces, 3).mean(axis=1)
    return slow + sd * np.sqrt(1 - floor**2) * rng.normal(size=slow.shape)
