"""Whole instruments for `in_use.py`: a triad on a dividing head with every effect at once, in plain numpy.

It imports nothing of the program under test, and no other benchmark: frames, effects and plans are derived here separately.
Angles in rad, specific force in g of the site, time in s, temperature in degC.
"""

from dataclasses import dataclass, replace

import numpy as np


MG, MRAD = 1e-3, 1e-3
HOUR = 3600.0
# One standard deviation of each coefficient: sizes that are met in practice with MEMS triads and ordinary heads.
SIZES = {
    "levelling": 0.1 * MRAD,
    "perpendicularity": 0.1 * MRAD,
    "eccentricity": 0.1 * MRAD,
    "ellipticity": 0.1 * MRAD,
    "index_gain": 0.05 * MRAD,
    "backlash": 0.05 * MRAD,
    "wobble_1": 0.1 * MRAD,
    "wobble_2": 0.1 * MRAD,
    "flexure": 0.1 * MRAD,
    "index_zero": 0.1 * MRAD,
    "mount_drift": 0.2 * MRAD / HOUR,
    "mount_temperature": 0.05 * MRAD,
    "second_order": 0.2 * MG,
    "third_order": 0.2 * MG,
    "fifth_order": 0.2 * MG,
    "scale_asymmetry": 0.2 * MG,
    "bias_asymmetry": 0.2 * MG,
    "cross_coupling": 0.2 * MG,
    "cross_axis_square": 0.2 * MG,
    "bias_drift": 0.2 * MG / HOUR,
    "scale_drift": 0.2 * MG / HOUR,
    "bias_temperature": 0.1 * MG,
    "scale_temperature": 0.1 * MG,
    "bias_temperature_square": 0.05 * MG,
    "temperature_rate": 0.1 * MG,
    "misalignment_drift": 0.2 * MRAD / HOUR,
    "misalignment_temperature": 0.05 * MRAD,
    "warm_up": 1.0 * MG,
    "settling": 0.5 * MG,
    "bias_by_pitch": 0.2 * MG,
    "scale_by_pitch": 0.2 * MG,
    "memory": 0.2 * MG,
    "hysteresis": 0.1 * MG,
}
_SHAPES = {
    "levelling": (1,), "perpendicularity": (1,), "eccentricity": (2,), "ellipticity": (2,), "index_gain": (1,),
    "backlash": (1,), "wobble_1": (4,), "wobble_2": (4,), "flexure": (2,), "mount_drift": (3,), "mount_temperature": (3,),
    "cross_coupling": (3, 3), "cross_axis_square": (3, 2), "misalignment_drift": (3, 2), "misalignment_temperature": (3, 2),
}  # fmt: skip
_BY_PITCH = {"index_zero": (), "bias_by_pitch": (3,), "scale_by_pitch": (3,)}
REFERENCE_DEGC = 25.0


@dataclass(frozen=True)
class Schedule:
    """What is measured, in order: commanded angles, number of the pitch setting and of the mounting, conditions."""

    alpha: np.ndarray
    beta: np.ndarray
    pitch: np.ndarray
    mounting: np.ndarray
    time_s: np.ndarray
    temperature_degc: np.ndarray
    approach: np.ndarray


@dataclass(frozen=True)
class Instrument:
    """True parameters and effects of one triad on one head; `effects` by the names of `SIZES`."""

    scale: np.ndarray
    bias: np.ndarray
    gamma: np.ndarray
    mounts: np.ndarray
    turns: np.ndarray
    pitch_errors: np.ndarray
    effects: dict[str, np.ndarray]


def schedule(name: str, rng: np.random.Generator) -> tuple[Schedule, np.ndarray]:
    """A plan by name (`cube`, `3x8`, `4x12`, `two mountings`), and the turns of its mountings (3 x 3 each).

    The room warms by 2 to 6 degC during the measurement, with a slow wander.
    """
    turns = np.eye(3)[None]
    if name == "cube":
        # Each face up, twice; x up and down need the pitch axis at 90 deg both ways.
        alpha = np.radians([0, 90, 180, 270, 0, 0] * 2)
        beta = np.radians([0, 0, 0, 0, 90, -90] * 2)
    else:
        settings, angles = {"3x8": (3, 8), "4x12": (4, 12), "two mountings": (3, 8)}[name]
        beta = np.repeat(np.radians(np.linspace(0, 90, settings)), angles)
        alpha = np.tile(np.arange(angles) * 2 * np.pi / angles, settings)
    mounting = np.zeros(len(alpha), int)
    if name == "two mountings":
        mounting = np.repeat([0, 1], len(alpha))
        alpha, beta = np.tile(alpha, 2), np.tile(beta, 2)
        turns = np.stack([np.eye(3), _passive("y", np.array([np.pi / 2]))[0]])
    count = len(alpha)
    time = np.cumsum(rng.uniform(55, 75, count)) + 1800.0 * mounting
    rise = rng.uniform(2, 6) * (time - time[0]) / np.ptp(time)
    temperature = REFERENCE_DEGC - 2 + rng.normal(0, 0.5) + rise + np.cumsum(rng.normal(0, 0.05, count))
    _, pitch = np.unique(np.round(beta, 9), return_inverse=True)
    approach = rng.choice([-1.0, 1.0], count)
    return Schedule(alpha, beta, pitch, mounting, time, temperature, approach), turns


def instrument(plan: Schedule, turns: np.ndarray, rng: np.random.Generator, names: list[str]) -> Instrument:
    """A random instrument with these effects, each coefficient of its usual size."""
    mountings = len(turns)
    return Instrument(
        scale=rng.normal(0, 3e-3, 3),
        bias=rng.normal(0, 3e-3, 3),
        gamma=rng.normal(0, 1e-3, 3),
        mounts=rng.normal(0, 3e-3, (mountings, 3)),
        turns=turns,
        pitch_errors=rng.normal(0, 1.5e-3, (mountings, plan.pitch.max() + 1)),
        effects={name: SIZES[name] * rng.normal(size=_shape(name, plan)) for name in names},
    )


def _shape(name: str, plan: Schedule) -> tuple[int, ...]:
    if name in _BY_PITCH:
        return (plan.pitch.max(), *_BY_PITCH[name])
    return _SHAPES.get(name, (3,))


def _passive(axis: str, angle: np.ndarray) -> np.ndarray:
    """Matrices (..., 3, 3) that give a vector's components in a frame turned about `axis` by `angle`."""
    c, s, one, nil = np.cos(angle), np.sin(angle), np.ones_like(angle), np.zeros_like(angle)
    rows = {
        "x": ((one, nil, nil), (nil, c, s), (nil, -s, c)),
        "y": ((c, nil, -s), (nil, one, nil), (s, nil, c)),
        "z": ((c, s, nil), (-s, c, nil), (nil, nil, one)),
    }[axis]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _turn(axis: str, angle: np.ndarray | float, f: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", _passive(axis, np.broadcast_to(angle, len(f)).astype(float)), f)


def readings(own: Instrument, plan: Schedule) -> np.ndarray:
    """Noise-free readings of a plan, g, (positions, 3)."""
    f = _in_fixture(own, plan)
    f = np.einsum("nij,nj->ni", own.turns[plan.mounting], f)
    angles = own.mounts[plan.mounting].T
    f = _turn("x", angles[0], _turn("y", angles[1], _turn("z", angles[2], f)))
    since = plan.time_s - plan.time_s[0]
    for name, follows in (("mount_drift", since), ("mount_temperature", plan.temperature_degc - REFERENCE_DEGC)):
        if name in own.effects:
            turn = own.effects[name][:, None] * follows
            f = _turn("x", turn[0], _turn("y", turn[1], _turn("z", turn[2], f)))
    settled = output(own, f, since, plan.temperature_degc)
    return settled + _of_procedure(own, plan, f, since)


def _in_fixture(own: Instrument, plan: Schedule) -> np.ndarray:
    get = lambda name, size: own.effects.get(name, np.zeros(size))  # noqa: E731
    a = plan.alpha
    f = np.tile([0.0, 0.0, 1.0], (len(a), 1))
    f = _turn("x", get("levelling", 1)[0], f)
    f = _turn("y", plan.beta + own.pitch_errors[plan.mounting, plan.pitch], f)
    f = _turn("z", get("perpendicularity", 1)[0], f)
    index = a + get("eccentricity", 2) @ [np.cos(a), np.sin(a)] + get("ellipticity", 2) @ [np.cos(2 * a), np.sin(2 * a)]
    index = index + get("index_gain", 1)[0] * a + get("backlash", 1)[0] * plan.approach
    index = index + np.append(0.0, get("index_zero", plan.pitch.max()))[plan.pitch]
    for order in (1, 2):
        c_y, s_y, c_z, s_z = get(f"wobble_{order}", 4)
        f = _turn("y", c_y * np.cos(order * a) + s_y * np.sin(order * a), f)
        f = _turn("z", c_z * np.cos(order * a) + s_z * np.sin(order * a), f)
    f = _turn("x", index, f)
    bend_y, bend_z = get("flexure", 2)
    along_y = f[:, 1].copy()
    return _turn("z", -bend_z * along_y, _turn("y", bend_y * f[:, 2], f))


def linear(own: Instrument, since: float, degc: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (force to readings) and bias (g) of the sensor's linear part at a time and a temperature."""
    get = lambda name, size: own.effects.get(name, np.zeros(size))  # noqa: E731
    warm = degc - REFERENCE_DEGC
    g21, g31, g32 = own.gamma
    triad = np.array([[1, 0, 0], [g21, 1, 0], [g31, g32, 1]])
    gain = 1 + own.scale + get("scale_drift", 3) * since + get("scale_temperature", 3) * warm
    mixed = np.diag(gain)
    for name, follows in (("misalignment_drift", since), ("misalignment_temperature", warm)):
        for axis, shares in enumerate(get(name, (3, 2))):
            mixed[axis, [other for other in range(3) if other != axis]] += shares * follows
    bias = own.bias + get("bias_drift", 3) * since + get("bias_temperature", 3) * warm
    return mixed @ triad, bias + get("bias_temperature_square", 3) * warm**2


def output(own: Instrument, f: np.ndarray, since: np.ndarray | float, degc: np.ndarray | float) -> np.ndarray:
    """Settled readings of forces in the triad's frame: linear part and nonlinear response, without what the history adds."""
    since, degc = np.broadcast_to(since, len(f)), np.broadcast_to(degc, len(f))
    out = np.empty_like(f)
    for row, (time, warm) in enumerate(zip(since, degc, strict=True)):
        matrix, bias = linear(own, time, warm)
        out[row] = matrix @ f[row] + bias
    u = _inputs(own, f)
    get = lambda name, size: own.effects.get(name, np.zeros(size))  # noqa: E731
    out += get("second_order", 3) * u**2 + get("third_order", 3) * u**3 + get("fifth_order", 3) * u**5
    out += get("scale_asymmetry", 3) * np.abs(u) + get("bias_asymmetry", 3) * np.sign(u)
    pairs = np.stack([u[:, 0] * u[:, 1], u[:, 0] * u[:, 2], u[:, 1] * u[:, 2]], axis=1)
    out += pairs @ get("cross_coupling", (3, 3)).T
    for axis, shares in enumerate(get("cross_axis_square", (3, 2))):
        out[:, axis] += u[:, [other for other in range(3) if other != axis]] ** 2 @ shares
    return out


def _inputs(own: Instrument, f: np.ndarray) -> np.ndarray:
    g21, g31, g32 = own.gamma
    return f @ np.array([[1, 0, 0], [g21, 1, 0], [g31, g32, 1]]).T


def _of_procedure(own: Instrument, plan: Schedule, f: np.ndarray, since: np.ndarray) -> np.ndarray:
    """What the order of the measurement and the setting add to the readings."""
    get = lambda name, size: own.effects.get(name, np.zeros(size))  # noqa: E731
    u, count = _inputs(own, f), len(f)
    before = np.maximum(np.arange(count) - 1, 0)
    before = np.where(plan.mounting[before] == plan.mounting, before, np.arange(count))
    step = u - u[before]
    added = -get("memory", 3) * step + get("hysteresis", 3) * np.clip(step / 0.1, -1, 1)
    rate = np.append(0.0, np.diff(plan.temperature_degc) / np.diff(plan.time_s)) * 60
    added += rate[:, None] * get("temperature_rate", 3)
    added += np.exp(-since / 900.0)[:, None] * get("warm_up", 3)
    changed = np.append(True, (np.diff(plan.pitch) != 0) | (np.diff(plan.mounting) != 0))
    began = plan.time_s[np.maximum.accumulate(np.where(changed, np.arange(count), 0))]
    added += np.exp(-(plan.time_s - began) / 120.0)[:, None] * get("settling", 3)
    later = plan.pitch > 0
    for name, factor in (("bias_by_pitch", np.ones_like(u)), ("scale_by_pitch", u)):
        table = get(name, (plan.pitch.max(), 3))
        added[later] += table[plan.pitch[later] - 1] * factor[later]
    return added


def shown_share(own: Instrument, plan: Schedule, sigma: float) -> tuple[float, np.ndarray]:
    """The signal of the effects that the nominal parameters cannot absorb, in sigma: its norm, and itself."""
    bare = replace(own, effects={})
    signal = (readings(own, plan) - readings(bare, plan)).ravel() / sigma
    basis, _ = np.linalg.qr(_nominal_columns(bare, plan))
    remaining = signal - basis @ (basis.T @ signal)
    return float(np.linalg.norm(remaining)), remaining


def _nominal_columns(own: Instrument, plan: Schedule) -> np.ndarray:
    """Derivatives of the readings by the nominal parameters, central differences."""
    columns, step = [], 1e-6
    for name in ("scale", "bias", "gamma", "mounts", "pitch_errors"):
        values = getattr(own, name)
        for place in np.ndindex(values.shape):
            moved = []
            for sign in (1, -1):
                changed = values.copy()
                changed[place] += sign * step
                moved.append(readings(replace(own, **{name: changed}), plan).ravel())
            columns.append((moved[0] - moved[1]) / (2 * step))
    return np.stack(columns, axis=1)
