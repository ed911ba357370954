"""Instruments with several errors at once, most of them too small to be found: sizes, plans and truth, in plain numpy.

The head, the fixture and the sensor are those of `blind_instrument`, which shares no code with the program; the populations are
defined here. A *mixed* instrument has one effect that shows and several that hardly do, a *typical* one has every effect of
the list with a coefficient from a normal distribution of the size that the catalogue calls usual.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import blind_instrument as blind
from blind_plans import remounted


EFFECTS = [name for name in (*blind.COEFFICIENTS, *blind.RARE) if name not in ("gravity_value", "settling", "warm_up")]
# Visible sizes (sigma) up to this one are rarely found. The largest coefficients, in usual sizes, of such an effect and of a
# larger one.
_HARDLY, _LARGEST = 3.0, (6.0, 30.0)
POPULATIONS = ("adequate", "single", "mixed", "faint", "typical")
PLANS = ("cube", "3x8", "4x6", "6x4", "4x12", "2 mountings")
# Usual sizes by the beginning of the name, in g, rad, s and degC.
_USUAL = {
    "base_": 1e-4, "axis_": 1e-4, "index_g": 5e-5, "index_b": 5e-5, "index_": 1e-4, "spindle": 1e-4, "fixture": 1e-4,
    "bias_drift": 2e-4 / 3600, "scale_drift": 2e-4 / 3600, "misalignment_drift": 2e-4 / 3600,
    "mount_drift": 2e-4 / 3600, "bias_temperature_square": 5e-5, "misalignment_temperature": 5e-5,
    "mount_temperature": 5e-5, "bias_temperature": 1e-4, "scale_temperature": 1e-4, "temperature_rate": 1e-4,
    "hysteresis": 1e-4, "": 2e-4,
}  # fmt: skip


@dataclass
class Instrument:
    """One instrument as it was measured: coefficients of its effects, readings without noise, and whether the errors of the
    pitch settings are known to be zero."""

    setup: blind.Setup
    effects: dict[str, np.ndarray]
    clean: np.ndarray
    pitch_known: bool


def plan(rng: np.random.Generator, name: str, ramp_degc: float = 0.0) -> blind.Setup:
    """The settings of a plan; `ramp_degc`: by so much the temperature rises from the first position to the last."""
    if name == "cube":
        setup = blind.random_setup(rng, 3, 4)
        # Four faces with the spindle level, one each with it up and down, all of them twice.
        alpha = np.radians([0, 90, 180, 270, 0, 0] * 2)
        pitch = np.array([1, 1, 1, 1, 0, 2] * 2)
        setup = replace(
            setup,
            alpha=alpha,
            beta=np.radians([-90.0, 0.0, 90.0])[pitch],
            pitch=pitch,
            names=[f"p{k}" for k in range(12)],
            nominal=setup.nominal | {"dbeta": np.zeros(3)},
        )
    elif name == "2 mountings":
        turns = ((0.0, 0.0, 0.0), (0.0, 0.0, 90.0)) if rng.uniform() < 0.5 else ((0.0, 0.0, 0.0), (0.0, 90.0, 0.0))
        setup = remounted(blind.random_setup(rng, 3, 6), turns, rng)
    else:
        setup = blind.random_setup(rng, *map(int, name.split("x")))
    share = (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
    return replace(setup, temperature_degc=setup.temperature_degc + ramp_degc * share)


def instrument(rng: np.random.Generator, population: str, name: str) -> Instrument:
    """An instrument of a population, measured by a plan."""
    ramp = rng.choice([0.0, 0.0, 6.0]) * rng.choice([-1.0, 1.0])
    setup = plan(rng, name, ramp)
    projector = unreachable(setup, pitch_known=name == "cube")
    if population == "typical":
        effects = {own: rng.normal(size=_count(setup, own)) * _usual(own) for own in EFFECTS}
    else:
        effects = {}
        for size in _sizes(rng, population):
            largest = _LARGEST[int(size > _HARDLY)]
            while True:
                own = EFFECTS[rng.integers(len(EFFECTS))]
                found = None if own in effects else blind.sized(setup, projector, own, size, rng)
                if found is not None and np.max(np.abs(found[0])) < largest * _usual(own):
                    break
            effects[own] = found[0]
    return Instrument(setup, effects, blind.readings(setup, setup.nominal, effects), name == "cube")


def unreachable(setup: blind.Setup, *, pitch_known: bool) -> np.ndarray:
    """Projector on readings that the nominal parameters cannot make, with or without the errors of the pitch settings."""
    q = np.linalg.qr(_columns(setup, pitch_known))[0]
    return np.eye(len(q)) - q @ q.T


def _columns(setup: blind.Setup, pitch_known: bool) -> np.ndarray:
    """Derivatives of the readings by the nominal parameters; those of the pitch settings are the last."""
    columns = blind.nominal_columns(setup)
    return columns[:, : columns.shape[1] - pitch_known * setup.nominal["dbeta"].size]


def _sizes(rng: np.random.Generator, population: str) -> Sequence[float]:
    """Sizes of the visible parts of the effects, in sigma."""
    many = rng.uniform(1.0, 3.0, rng.integers(4, 7))
    match population:
        case "adequate":
            return []
        case "single":
            return [rng.uniform(3.0, 20.0)]
        case "mixed":
            return [rng.uniform(8.0, 20.0), *many]
        case _:
            return many


def _count(setup: blind.Setup, name: str) -> int:
    count = (blind.COEFFICIENTS | blind.RARE)[name]
    return int(setup.pitch.max()) if count == blind.BY_SETTING else count


def _usual(name: str) -> float:
    return next(size for start, size in _USUAL.items() if name.startswith(start))


def truth_at_the_mean(own: Instrument, *, thermal: bool) -> dict[str, np.ndarray]:
    """The sensor's parameters at the mean time, run and setting, and at the mean temperature (25 degC where a calibration has
    terms of temperature): each effect by itself, as their shifts are far below one."""
    setup, nominal = own.setup, {key: values.copy() for key, values in own.setup.nominal.items()}
    plain = None
    for name, sizes in own.effects.items():
        kind, _, axis = name.partition(".")
        if kind.endswith("_by_pitch"):
            shares = np.bincount(setup.pitch, minlength=len(sizes) + 1)[1:] / len(setup.pitch)
            nominal[{"bias": "bias", "scale": "dK"}[kind.split("_")[0]]]["xyz".index(axis)] += shares @ sizes
        elif kind.endswith("_drift") or (kind.endswith("_temperature") and not thermal):
            steady = setup.temperature_degc * 0 + setup.temperature_degc.mean()
            time = setup.time_s.mean() + 1e-6 * np.arange(len(setup.time_s))
            time[0] = setup.time_s[0]
            there = replace(setup, temperature_degc=steady, time_s=time)
            signal = blind.readings(there, setup.nominal, {name: sizes}) - blind.readings(there, setup.nominal, {})
            # Without the first position, from which the time counts.
            plain = np.linalg.pinv(_columns(there, own.pitch_known)[3:]) if plain is None else plain
            shift = plain @ signal[1:].ravel()
            for key, values in nominal.items():
                if len(shift):
                    nominal[key], shift = values + shift[: values.size].reshape(values.shape), shift[values.size :]
    return nominal


def sensor_readings(own: Instrument, force: np.ndarray, temperature_degc: np.ndarray) -> np.ndarray:
    """Readings of a specific force in the sensor's own frame (rows, g), at rest and at the mean time of its calibration, with
    the effects that belong to the sensor."""
    setup, (g21, g31, g32) = own.setup, own.setup.nominal["gamma"]
    u = np.stack([force[:, 0], force[:, 1] + g21 * force[:, 0], force[:, 2] + force[:, :2] @ [g31, g32]], axis=1)
    out = (1 + setup.nominal["dK"]) * u + setup.nominal["bias"]
    late, warm = np.mean(setup.time_s) - setup.time_s[0], temperature_degc - 25
    square = (temperature_degc - np.mean(setup.temperature_degc)) ** 2
    for name, sizes in own.effects.items():
        kind, _, axis = name.partition(".")
        if not axis:
            continue
        i = "xyz".index(axis[0])
        v, j, k = u[:, i], *(u[:, other] for other in range(3) if other != i)
        shapes = {
            "second_order": [v**2], "third_order": [v**3], "fifth_order": [v**5], "scale_asymmetry": [np.abs(v)],
            "bias_asymmetry": [np.sign(v)], "cross_axis_square": [j**2, k**2], "bias_drift": [late + 0 * v],
            "scale_drift": [late * v], "misalignment_drift": [late * j, late * k], "bias_temperature": [warm],
            "scale_temperature": [warm * v], "misalignment_temperature": [warm * j, warm * k],
            "bias_temperature_square": [square],
        }  # fmt: skip
        if kind == "cross_coupling":
            first, second = ("xyz".index(letter) for letter in axis[2:])
            shapes[kind] = [u[:, first] * u[:, second]]
        if kind.endswith("_by_pitch"):
            share = np.bincount(setup.pitch, minlength=len(sizes) + 1)[1:] / len(setup.pitch)
            shapes[kind] = [share[number] * (v if kind[0] == "s" else 1 + 0 * v) for number in range(len(sizes))]
        for size, shape in zip(sizes, shapes.get(kind, ()), strict=False):
            out[:, i] += size * shape
    return out
