"""`check` on units of which half changed: false alarms, power as predicted, names, and coverage of updates.

    python benchmarks/check_units.py --units 500 --seed 1
    python benchmarks/check_units.py --units 500 --seed 1 --drift

Triad, calibration and recordings are in plain numpy. A calibration is a least-squares fit of 30 positions on a head, with
the noise stated or estimated. A recording has 3 to 12 orientations by hand or on a head (mounted again, with pitch errors),
or is one long still log. The changed parameter, its size, and the noise are drawn. With --drift all parameters of every
unit change, with the process noise that the update states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from command_line import asked
from tumblecal import enable_float64
from tumblecal.check.drift import NONE, ProcessNoise
from tumblecal.check.result import Model, check
from tumblecal.check.update import updated
from tumblecal.data.calibration import Calibration
from tumblecal.data.coverage_factor import coverage_factors
from tumblecal.data.positions import PositionSet, attitudes_of
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, correction_slope
from tumblecal.ground.errors import InputError


USUAL = np.array([5e-4] * 3 + [1.5e-3] * 3 + [2e-3] * 3)
PITCH_ERROR = 3e-4  # rad
# Kinds of recordings and of changed parameters, with their probabilities; the size over the usual one is 10 to this power.
KINDS = {"hand": 0.5, "head": 0.4, "log": 0.1}
SHARES = {"bias": 0.6, "dK": 0.25, "gamma": 0.15}
RANGE = (-1.0, 1.0)
MOVED = 0.5  # share of the units with a change
POWERS = (0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.01)


def triad(p: np.ndarray) -> np.ndarray:
    """diag(1 + dK) T."""
    return np.diag(1 + p[:3]) @ np.array([[1, 0, 0], [p[6], 1, 0], [p[7], p[8], 1.0]])


def parameters(flat: np.ndarray) -> np.ndarray:
    """The nine parameters of M = diag(1 + dK) T Q and a bias, given as rows of M and bias."""
    matrix, bias = flat.reshape(3, 4)[:, :3], flat.reshape(3, 4)[:, 3]
    r = np.linalg.qr(matrix.T)[1]
    lower = r.T * np.sign(np.diag(r))
    unit = lower / np.diag(lower)[:, None]
    return np.concatenate([np.diag(lower) - 1, bias, [unit[1, 0], unit[2, 0], unit[2, 1]]])


def rotation(rng: np.random.Generator, degrees: float) -> np.ndarray:
    """A small random rotation."""
    a = np.radians(degrees) * rng.normal(size=3)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    q = np.linalg.qr(np.eye(3) + k + k @ k / 2)[0]
    return q * np.sign(np.diag(q))


def unit_vectors(rng: np.random.Generator, count: int) -> np.ndarray:
    """Random directions."""
    u = rng.normal(size=(count, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def calibrated(rng: np.random.Generator, truth: np.ndarray, noise: float):
    """Estimate, its covariance by unit variance, residual sd and degrees of freedom of a calibration at 30 known directions."""
    u = unit_vectors(rng, 30)
    readings = u @ (triad(truth) @ rotation(rng, 1.0)).T + truth[3:6] + noise * rng.normal(size=u.shape)
    design = np.column_stack([u, np.ones(len(u))])
    solution = np.linalg.lstsq(design, readings, rcond=None)[0]
    dof, flat = readings.size - 12, solution.T.ravel()
    sigma = np.sqrt(np.sum((readings - design @ solution) ** 2) / dof)
    slope = np.stack([(parameters(flat + s) - parameters(flat - s)) / 2e-6 for s in 1e-6 * np.eye(12)], axis=1)
    covariance = slope @ np.kron(np.eye(3), np.linalg.inv(design.T @ design)) @ slope.T
    return parameters(flat), covariance, sigma, dof


def recorded(rng: np.random.Generator, kind: str, truth: np.ndarray, noise: float) -> PositionSet:
    """The position set of a recording."""
    alpha = beta = None
    count = 1 if kind == "log" else int(rng.integers(3, 13))
    if kind == "log":
        up = unit_vectors(rng, 1)
    elif kind == "hand":
        sides = np.array([own for own in product((-1, 0, 1), repeat=3) if any(own)], float)
        number = np.abs(sides).sum(axis=1)
        order = [rng.permutation(np.flatnonzero(own)) for own in (number == 1, number > 1)]
        chosen = sides[np.concatenate(order)[:count]]
        up = chosen / np.linalg.norm(chosen, axis=1, keepdims=True) + np.radians(4) * rng.normal(size=(count, 3))
        up /= np.linalg.norm(up, axis=1, keepdims=True)
    else:
        beta, alpha = rng.choice([0.0, 30.0, 60.0], count), rng.permutation(np.arange(0, 360, 30.0))[:count]
        settings, number = np.unique(beta, return_inverse=True)
        a, b = np.radians(alpha), np.radians(beta) + PITCH_ERROR * rng.normal(size=len(settings))[number]
        up = np.column_stack([-np.sin(b), np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)]) @ rotation(rng, 0.5).T
    readings = up @ triad(truth).T + truth[3:6] + noise * rng.normal(size=up.shape)
    comments = {} if kind == "head" else {"attitudes": "unknown"}
    if alpha is None or beta is None:
        alpha, beta = attitudes_of(readings)
    names = tuple(f"p{k + 1}" for k in range(count))
    return PositionSet(names, alpha, beta, readings, sd=np.full(readings.shape, noise), comments=comments)


def change_of(rng: np.random.Generator) -> tuple[np.ndarray, str]:
    """A change of one parameter, and its name."""
    leaf = rng.choice([*SHARES], p=[*SHARES.values()])
    which = int(rng.choice([k for k, name in enumerate(SENSOR) if name.startswith(leaf)]))
    change = np.zeros(9)
    change[which] = rng.choice([-1, 1]) * USUAL[which] * 10 ** rng.uniform(*RANGE)
    return change, SENSOR[which]


def drift_of_population() -> np.ndarray:
    """Variances of the changes of all units together, as a history of the population would give."""
    low, high = 10.0 ** (2 * RANGE[0]), 10.0 ** (2 * RANGE[1])
    mean_square = (high - low) / (2 * (RANGE[1] - RANGE[0]) * np.log(10))
    return MOVED * np.array([SHARES[name.partition("_")[0]] / 3 for name in SENSOR]) * USUAL**2 * mean_square


@dataclass
class Unit:
    """A checked unit: the changed parameter, predicted power, whether the change is detected, the named parameters, whether the
    correct one is among the possible ones, and for each process noise whether the updated parameters are within U."""

    kind: str
    changed: str
    power: float
    rejected: bool
    named: str
    listed: bool
    inside: dict[str, np.ndarray]


def checked(rng: np.random.Generator, drift: np.ndarray, of_all: bool) -> Unit:
    """Draw a unit, calibrate, change, record, check and update it."""
    truth = np.concatenate([rng.normal(0, sd, 3) for sd in (3e-3, 5e-3, 1e-3)])
    noise = 10 ** rng.uniform(-4.3, -3.5)
    estimate, per_variance, sigma, dof = calibrated(rng, truth, noise)
    estimated = bool(rng.integers(2))
    covariance, slope = per_variance * (sigma if estimated else noise) ** 2, correction_slope(estimate)
    calibration = Calibration(
        np.linalg.inv(triad(estimate)),
        estimate[3:6],
        slope @ covariance @ slope.T,
        parameters=SensorParameters(SENSOR, estimate, covariance),
        provenance={"dof": dof if estimated else None, "sigma_g": sigma},
    )
    kind = str(rng.choice([*KINDS], p=[*KINDS.values()]))
    change, changed = np.zeros(9), ""
    if of_all:
        change, changed = np.sqrt(drift) * rng.normal(size=9), "all"
    elif rng.uniform() < MOVED:
        change, changed = change_of(rng)
    # With an estimated noise, the positions have the dispersion of the calibration.
    data = recorded(rng, kind, truth + change, noise if estimated else 10 ** rng.uniform(-4.5, -3.5))
    model = Model(priors={"dbeta": (0.0, PITCH_ERROR)} if kind == "head" else {})
    result, inside = check(calibration, Path("nowhere/calibration.json"), data, model=model), {}
    best = result.moved.named if result.moved is not None else None
    for label, process in {"none": NONE, "drift": ProcessNoise(np.zeros(9), drift, None, "population")}.items():
        try:
            after = updated(result.test, process, best.parameters if best else (), {}).calibration.sensor
        except InputError:
            continue
        factor = coverage_factors(np.full(9, after.dof), 0.95) if np.isfinite(after.dof) else 1.96
        inside[label] = np.abs(after.values - truth - change) <= factor * after.sd
    return Unit(
        kind,
        changed,
        result.test.power(change) if changed else np.nan,
        result.test.rejected,
        "" if best is None else ", ".join(best.parameters) or best.kind,
        result.moved is not None and any(changed in each.parameters for each in result.moved.possible),
        inside,
    )


def share(units: Sequence[Unit], of: Callable[[Unit], float] = lambda unit: unit.rejected) -> str:
    """A mean with its number of units."""
    return f"{np.mean([of(unit) for unit in units]):.3f} of {len(units)}" if units else "none"


def main() -> None:
    """Run, and print the figures."""
    given = asked(__doc__, units=500, seed=1, drift=False)
    enable_float64()
    rng, drift = np.random.default_rng(given.seed), drift_of_population()
    units = [checked(rng, drift, given.drift) for _ in range(given.units)]
    still, changed = [unit for unit in units if not unit.changed], [unit for unit in units if unit.changed]
    print(f"false alarms: {share(still)}")
    parts = {"all": changed, **{kind: [unit for unit in changed if unit.kind == kind] for kind in KINDS}}
    for low, high in pairwise(POWERS):
        parts[f"{low:.2f} to {min(high, 1):.2f}"] = [unit for unit in changed if low <= unit.power < high]
    for label, own in parts.items():
        print(f"power, {label}: predicted {share(own, lambda unit: unit.power)}, observed {share(own)}")
    found = [unit for unit in changed if unit.rejected]
    print(f"named: correct {share(found, lambda unit: unit.named == unit.changed)}, "
          f"wrong {share(found, lambda unit: unit.named not in ('', unit.changed))}, "
          f"named or listed {share(found, lambda unit: unit.listed)}")  # fmt: skip
    for process, (label, part) in product(
        ("none", "drift"), {"unchanged": still, "changed": changed, "all": units}.items()
    ):
        made = [unit.inside[process] for unit in part if process in unit.inside]
        print(f"coverage of updates, process noise {process}, {label}: {np.mean(made) if made else np.nan:.4f} "
              f"({len(made)} of {len(part)} units)")  # fmt: skip


if __name__ == "__main__":
    main()
