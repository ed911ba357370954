"""Whole instruments for `blind use`: a triad on a dividing head with every effect at once, in plain numpy.

Frames and effects are those of `blind_instrument.py`; nothing of the program under test is imported.
Angles in rad, specific force in g of the site, time in s, temperature in degC.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import blind_instrument as blind


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
REFERENCE_DEGC, WARM_UP_S, SETTLING_S = 25.0, 900.0, 120.0
# Names in the catalogue that differ.
IDS = {
    "levelling": "base_levelling",
    "perpendicularity": "axis_perpendicularity",
    "eccentricity": "index_eccentricity",
    "ellipticity": "index_ellipticity",
    "backlash": "index_backlash",
    "wobble_1": "spindle_wobble_1",
    "wobble_2": "spindle_wobble_2",
    "flexure": "fixture_flexure",
}
HEAD = {*IDS, "index_gain", "index_zero", "mount_drift", "mount_temperature"}
HISTORY = {"memory", "hysteresis", "temperature_rate", "warm_up", "settling", "bias_by_pitch", "scale_by_pitch"}
LINEAR = {f"{own}_{by}" for own in ("bias", "scale", "misalignment") for by in ("drift", "temperature")}
LINEAR |= {"bias_temperature_square"}


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
        turns = np.stack([np.eye(3), blind.turned("y", np.pi / 2, np.eye(3)).T])
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
    shapes = _SHAPES | {name: (plan.pitch.max(), *rest) for name, rest in _BY_PITCH.items()}
    return Instrument(
        scale=rng.normal(0, 3e-3, 3),
        bias=rng.normal(0, 3e-3, 3),
        gamma=rng.normal(0, 1e-3, 3),
        mounts=rng.normal(0, 3e-3, (mountings, 3)),
        turns=turns,
        pitch_errors=rng.normal(0, 1.5e-3, (mountings, plan.pitch.max() + 1)),
        effects={name: SIZES[name] * rng.normal(size=shapes.get(name, (3,))) for name in names},
    )


def _setup(own: Instrument, plan: Schedule) -> blind.Setup:
    """The instrument as `blind_instrument` has it."""
    nominal = {"dK": own.scale, "bias": own.bias, "gamma": own.gamma}
    nominal |= {"dtheta": own.mounts.ravel(), "dbeta": own.pitch_errors.ravel()}
    return blind.Setup(**vars(plan), nominal=nominal, turns=own.turns)


def _listed(effects: dict[str, np.ndarray], names: Collection[str]) -> dict[str, np.ndarray]:
    """The effects of some names by the names of `blind_instrument`, axis by axis."""
    found: dict[str, np.ndarray] = {}
    for name in names & effects.keys() - {"settling"}:
        values = effects[name]
        if name == "warm_up":
            found[name] = np.append(values, WARM_UP_S)
        elif name in HEAD:
            found[IDS.get(name, name)] = values
        elif name == "bias_temperature_square":
            found |= {
                f"temperature_polynomial.{a}": np.array([v, REFERENCE_DEGC]) for a, v in zip("xyz", values, strict=True)
            }
        elif name == "cross_coupling":
            pairs = ("xy", "xz", "yz")
            found |= {f"{name}.{a}.{pair}": values[k, [n]] for k, a in enumerate("xyz") for n, pair in enumerate(pairs)}
        else:
            rows = values.T if name in _BY_PITCH else values
            found |= {f"{name}.{a}": np.atleast_1d(row) for a, row in zip("xyz", rows, strict=True)}
    return found


def readings(own: Instrument, plan: Schedule) -> np.ndarray:
    """Noise-free readings of a plan, g, (positions, 3)."""
    setup = _setup(own, plan)
    out = blind.readings(setup, setup.nominal, _listed(own.effects, SIZES.keys()))
    if "settling" in own.effects:
        changed = np.append(True, (np.diff(plan.pitch) != 0) | (np.diff(plan.mounting) != 0))
        began = plan.time_s[np.maximum.accumulate(np.where(changed, np.arange(len(out)), 0))]
        out = out + np.exp(-(plan.time_s - began) / SETTLING_S)[:, None] * own.effects["settling"]
    return out


def output(
    own: Instrument, f: np.ndarray, since: float, degc: float, names: Collection[str] = SIZES.keys() - HISTORY
) -> np.ndarray:
    """Readings of forces in the triad's frame, a time after the start, by the effects of some names (without the history)."""
    # The first row is the start.
    rows, nil = len(f) + 1, np.zeros(len(f) + 1)
    number = np.zeros(rows, int)
    plan = Schedule(nil, nil, number, number, np.append(0.0, np.full(rows - 1, since)), np.full(rows, degc), nil)
    setup = _setup(own, plan)
    with np.errstate(divide="ignore", invalid="ignore"):
        return blind.sensed(setup, np.vstack([nil[:3], f]), setup.nominal, _listed(own.effects, names - HEAD))[1:]


def linear(own: Instrument, since: float, degc: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (force to readings) and bias (g) of the sensor's linear part at a time and a temperature."""
    bias, *columns = output(own, np.vstack([np.zeros(3), np.eye(3)]), since, degc, LINEAR)
    return (np.array(columns) - bias).T, bias


def shown_share(own: Instrument, plan: Schedule, sigma: float) -> tuple[float, np.ndarray]:
    """The signal of the effects that the nominal parameters cannot absorb, in sigma: its norm, and itself."""
    bare = replace(own, effects={})
    signal = (readings(own, plan) - readings(bare, plan)).ravel() / sigma
    basis = reachable(bare, plan, readings)
    remaining = signal - basis @ (basis.T @ signal)
    return float(np.linalg.norm(remaining)), remaining


def reachable(own: Any, plan: Schedule, readings: Callable[[Any, Schedule], np.ndarray]) -> np.ndarray:
    """Orthonormal basis of the readings that the nominal parameters can make near the truth, by central differences."""
    columns, step = [], 1e-6
    for name in ("scale", "bias", "gamma", "mounts", "pitch_errors"):
        values = getattr(own, name)
        for place in np.ndindex(values.shape):
            unit = np.zeros_like(values)
            unit[place] = step
            both = [readings(replace(own, **{name: values + sign * unit}), plan).ravel() for sign in (1, -1)]
            columns.append((both[0] - both[1]) / (2 * step))
    basis, size, _ = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    return basis[:, size > 1e-9 * size[0]]
