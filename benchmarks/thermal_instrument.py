"""An accelerometer triad in a chamber, in numpy alone: polynomials of temperature, hysteresis, lag, noise. Not the chain.

`instrument` draws a unit, `means` gives its readings in temperature bins, `truth` its parameters.
"""

from dataclasses import dataclass, field

import numpy as np


AXES = "xyz"


@dataclass(frozen=True)
class Unit:
    """A unit: constants (9: dK xyz, bias xyz, g21, g31, g32) at 25 degC; changes (9, 5) by Legendre polynomials over the range,
    less their value at 25 degC; half width (3) of the hysteresis of the biases, g; quadratic coefficients (3), g/g^2."""

    constants: np.ndarray
    changes: np.ndarray
    hysteresis: np.ndarray
    low: float
    high: float
    square: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Programme:
    """Temperatures: a list of (target degC, rate K/min) legs from a start; soaks at the targets of `soak_min` minutes."""

    start: float
    legs: tuple[tuple[float, float], ...]
    soak_min: float = 0.0


def instrument(
    rng,
    *,
    bias_order=1,
    scale_order=1,
    cross_order=0,
    bias_mg=3.0,
    scale_mg=2.0,
    cross_mrad=0.3,
    hysteresis_mg=0.0,
    low=-10.0,
    high=60.0,
):
    """A unit with every order up to the stated ones; the sizes are those of the first order over the range."""
    constants = np.concatenate([rng.normal(0, 3e-3, 3), rng.normal(0, 5e-3, 3), rng.normal(0, 1e-3, 3)])
    changes = np.zeros((9, 5))
    for rows, order, size in (
        ((3, 4, 5), bias_order, bias_mg * 1e-3),
        ((0, 1, 2), scale_order, scale_mg * 1e-3),
        ((6, 7, 8), cross_order, cross_mrad * 1e-3),
    ):
        for row in rows:
            for power in range(order):
                changes[row, power] = rng.choice([-1, 1]) * size * rng.uniform(0.5, 1.5) / (1 + power)
    return Unit(constants, changes, rng.choice([-1, 1], 3) * hysteresis_mg * 1e-3 * rng.uniform(0.5, 1.5, 3), low, high)


def truth(unit, degc):
    """The nine parameters (temperatures, 9) on the mean of both branches."""

    def legendre(values):
        share = 2 * (np.asarray(values, float) - unit.low) / (unit.high - unit.low) - 1
        return np.stack([np.polynomial.legendre.legval(share, np.eye(6)[k]) for k in range(1, 6)], axis=-1)

    return unit.constants + (legendre(degc) - legendre(25.0)) @ unit.changes.T


def readings(unit, force, degc, memory=0.0):
    """Readings (rows, 3) of forces (rows, 3), g; `memory`: state of the hysteresis, -1 on the lower branch to 1."""
    p = truth(unit, degc)
    u = np.column_stack(
        [
            force[:, 0],
            force[:, 1] + p[:, 6] * force[:, 0],
            force[:, 2] + p[:, 7] * force[:, 0] + p[:, 8] * force[:, 1],
        ]
    )
    return (
        (1 + p[:, :3]) * u + p[:, 3:6] + unit.square * u**2 + np.outer(np.broadcast_to(memory, len(u)), unit.hysteresis)
    )


def memory_of(degc, width):
    """The state of the hysteresis over a history of temperatures, -1 to 1.

    With a width: a play operator (Prandtl), which moves by 2/width a degC and is held within -1 and 1; its mean over both
    branches is no polynomial. Width 0: a closed loop, an ellipse over the whole range.
    """
    if not width:
        share = 2 * (degc - degc.min()) / np.ptp(degc) - 1
        moves = np.sign(np.gradient(degc))
        known = np.flatnonzero(moves)
        before = np.clip(np.searchsorted(known, np.arange(len(degc)), side="right") - 1, 0, None)
        return moves[known[before]] * np.sqrt(np.maximum(1 - share**2, 0.0))
    state = np.empty(len(degc))
    now, before = 0.0, degc[0]
    for k, value in enumerate(degc):
        now = min(1.0, max(-1.0, now + 2 * (value - before) / width))
        state[k], before = now, value
    return state


def attitudes(rng, count, tilt_deg=3.0):
    """Directions of gravity: one face, six faces or an icosahedron-like set, each tilted at random."""
    if count <= 6:
        base = np.concatenate([np.eye(3)[::-1], -np.eye(3)[::-1]])[:count]
    else:
        k = np.arange(count) + 0.5
        z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
        base = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    tilted = base + np.radians(tilt_deg) * rng.normal(size=base.shape)
    return tilted / np.linalg.norm(tilted, axis=1)[:, None]


def history(programme, step_s=10.0):
    """Times (s), temperatures (degC) and rates (degC/s) of a programme."""
    soak = int(programme.soak_min * 60 / step_s)
    degc, rates = [programme.start] * (1 + soak), [0.0] * (1 + soak)
    for target, per_min in programme.legs:
        count = max(2, int(abs(target - degc[-1]) / (per_min / 60) / step_s))
        leg = np.linspace(degc[-1], target, count + 1)[1:]
        rates += [(target - degc[-1]) / (count * step_s)] * count
        degc += leg.tolist() + [target] * soak
        rates += [0.0] * soak
    return np.arange(len(degc)) * step_s, np.array(degc), np.array(rates)


def means(
    rng, unit, forces, programme, noise_mg=0.03, bins=40, width=20.0, lag_s=0.0, rate_effect=0.0, drift_mg_per_h=0.0
):
    """Means in bins of temperature at each attitude, as columns: one row for each attitude, bin and branch, or soak.

    `lag_s`: delay of the sensor after the thermometer. `rate_effect`: bias of all axes, g for each degC/s.
    """
    columns: dict[str, list] = {name: [] for name in _COLUMNS}
    for number, force in enumerate(forces):
        times, degc, rates = history(programme)
        memory = memory_of(degc, width) if np.any(unit.hysteresis) else np.zeros(len(degc))
        of_sensor = degc - lag_s * rates
        values = readings(unit, np.repeat(force[None], len(degc), 0), of_sensor, memory)
        values = values + rate_effect * rates[:, None] + 1e-3 * drift_mg_per_h * times[:, None] / 3600
        still = rates == 0
        stretch = np.cumsum(np.diff(np.sign(rates), prepend=0) != 0)
        cell = np.floor((degc - unit.low) / ((unit.high - unit.low) / bins)).astype(int)
        reached = 0
        for part in dict.fromkeys(stretch.tolist()):
            inside = stretch == part
            sign = int(np.sign(rates[inside][0]))
            reached = sign or reached
            if sign and programme.soak_min:
                continue  # between soaks
            for k in dict.fromkeys(cell[inside].tolist()) if sign else [None]:
                rows = inside if k is None else inside & (cell == k)
                columns["attitude"].append(f"a{number}")
                columns["readings"].append(values[rows].mean(0) + 1e-3 * noise_mg * rng.normal(size=3))
                columns["temperature_degc"].append(degc[rows].mean())
                columns["time_s"].append(times[rows].mean())
                columns["rate_degc_per_s"].append(0.0 if still[rows].all() else rates[rows].mean())
                columns["direction"].append(sign)
                columns["reached_by"].append(reached)
                columns["branch"].append(f"{number} {reached}")
                columns["clock"].append(f"{number}")
    return {name: np.array(values) if name in _NUMBERS else values for name, values in columns.items()} | {
        "sd": 1e-3 * noise_mg
    }


def soak_means(rng, unit, forces, soaks, noise_mg=0.3, tilt_deg=2.0, scatter_degc=0.3):
    """Means of files of one face at one soak each, as columns: the faces are set by hand for every soak."""
    faces = [(force, degc) for degc in soaks for force in forces]
    turned = np.array([force for force, _ in faces]) + np.radians(tilt_deg) * rng.normal(size=(len(faces), 3))
    turned /= np.linalg.norm(turned, axis=1)[:, None]
    degc = np.array([level for _, level in faces]) + scatter_degc * rng.uniform(-1, 1, len(faces))
    # All faces of a soak have the same history.
    state = np.repeat(rng.uniform(-1, 1, len(soaks)), len(forces))
    names = [f"f{k}" for k in range(len(faces))]
    return {
        "attitude": names,
        "readings": readings(unit, turned, degc, state) + 1e-3 * noise_mg * rng.normal(size=turned.shape),
        "temperature_degc": degc,
        "clock": names,
        "branch": names,
        "sd": 1e-3 * noise_mg,
    }


_NUMBERS = ("readings", "temperature_degc", "time_s", "rate_degc_per_s", "direction", "reached_by")
_COLUMNS = ("attitude", *_NUMBERS, "branch", "clock")
