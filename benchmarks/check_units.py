"""`check` on units of which half changed: false alarms, power as predicted, names, and coverage of updates.

Triad, calibration and recordings are in numpy alone (not the chain). A calibration is a least-squares fit of 30 positions on a
head, with the noise stated or estimated. A recording has 3 to 12 attitudes by hand or on a head (mounted again, with pitch
errors), or is one long still log. The changed parameter, its size, and the noise are drawn. With --drift all parameters of
every unit change, with the process noise that the update states.

    python benchmarks/check_units.py --units 500 --seed 1
    python benchmarks/check_units.py --units 500 --seed 1 --drift
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tumblecal import enable_float64


NAMES = ("dK_x", "dK_y", "dK_z", "bias_x", "bias_y", "bias_z", "gamma_21", "gamma_31", "gamma_32")
USUAL = np.array([5e-4] * 3 + [1.5e-3] * 3 + [2e-3] * 3)
PITCH_ERROR = 3e-4  # rad


def triad(p):
    """diag(1 + dK) T."""
    return np.diag(1 + p[:3]) @ np.array([[1, 0, 0], [p[6], 1, 0], [p[7], p[8], 1.0]])


def parameters(matrix, bias):
    """The nine parameters of M = diag(1 + dK) T Q."""
    r = np.linalg.qr(matrix.T)[1]
    lower = r.T * np.sign(np.diag(r))
    scale = np.diag(lower)
    unit = lower / scale[:, None]
    return np.concatenate([scale - 1, bias, [unit[1, 0], unit[2, 0], unit[2, 1]]])


def rotation(rng, degrees):
    """A small random rotation."""
    a = np.radians(degrees) * rng.normal(size=3)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.linalg.qr(np.eye(3) + k + k @ k / 2)[0] * 1.0


def calibrated(rng, truth, noise, positions=30):
    """Estimate, covariance and residual sd of a calibration at known random directions."""
    u = rng.normal(size=(positions, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    turned = rotation(rng, 1.0)
    turned *= np.sign(np.diag(turned))[None, :]
    readings = u @ (triad(truth) @ turned).T + truth[3:6] + noise * rng.normal(size=u.shape)
    design = np.column_stack([u, np.ones(positions)])
    solution, *_ = np.linalg.lstsq(design, readings, rcond=None)
    residual = readings - design @ solution
    dof = residual.size - 12
    sigma = np.sqrt(np.sum(residual**2) / dof)
    of_axis = np.linalg.inv(design.T @ design)

    def of_flat(flat):
        table = flat.reshape(3, 4)
        return parameters(table[:, :3], table[:, 3])

    flat = solution.T.ravel()
    steps = 1e-6 * np.eye(12)
    slope = np.stack([(of_flat(flat + s) - of_flat(flat - s)) / 2e-6 for s in steps], axis=1)
    return of_flat(flat), slope @ np.kron(np.eye(3), of_axis) @ slope.T, sigma, dof


@dataclass
class Drawn:
    """A drawn recording."""

    kind: str
    up: np.ndarray
    alpha: np.ndarray | None
    beta: np.ndarray | None
    noise: float


def recording(rng, kind):
    """Attitudes (unit vectors of the specific force in the frame of the fixture) and noise."""
    noise = 10 ** rng.uniform(-4.5, -3.5)
    if kind == "log":
        u = rng.normal(size=(1, 3))
        return Drawn(kind, u / np.linalg.norm(u), None, None, noise)
    count = int(rng.integers(3, 13))
    if kind == "hand":
        faces = np.array([[a, b, c] for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1) if a or b or c], float)
        order = np.concatenate(
            [
                rng.permutation(np.flatnonzero(np.abs(faces).sum(1) == 1)),
                rng.permutation(np.flatnonzero(np.abs(faces).sum(1) > 1)),
            ]
        )
        u = faces[order[:count]] / np.linalg.norm(faces[order[:count]], axis=1)[:, None]
        u = u + np.radians(4) * rng.normal(size=u.shape)
        return Drawn(kind, u / np.linalg.norm(u, axis=1)[:, None], None, None, noise)
    beta = rng.choice([0.0, 30.0, 60.0], count)
    alpha = rng.permutation(np.arange(0, 360, 30.0))[:count]
    return Drawn(kind, np.zeros((count, 3)), alpha, beta, noise)


def head(alpha, beta):
    """Specific force (rows, 3) in the frame of the spindle: Rx(alpha) Ry(beta) applied to z, as frames."""
    a, b = np.radians(alpha), np.radians(beta)
    return np.column_stack([-np.sin(b), np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)])


def measured(rng, drawn, truth):
    """Readings of a recording."""
    up = drawn.up
    if drawn.kind == "head":
        errors = {each: np.degrees(PITCH_ERROR) * rng.normal() for each in np.unique(drawn.beta)}
        up = head(drawn.alpha, drawn.beta + np.array([errors[each] for each in drawn.beta]))
        turned = rotation(rng, 0.5)
        up = up @ (turned * np.sign(np.diag(turned))[None, :]).T
    return up @ triad(truth).T + truth[3:6] + drawn.noise * rng.normal(size=up.shape)


SHARES = {"bias": 0.6, "dK": 0.25, "gamma": 0.15}
RANGE = (-1.0, 1.0)


def change_of(rng):
    """A change of one parameter, and its name."""
    leaf = rng.choice([*SHARES], p=[*SHARES.values()])
    which = int(rng.choice([k for k, name in enumerate(NAMES) if name.startswith(leaf)]))
    change = np.zeros(9)
    change[which] = rng.choice([-1, 1]) * USUAL[which] * 10 ** rng.uniform(*RANGE)
    return change, NAMES[which]


def drift_of_population(moved):
    """Variances of the changes of all units together, as a history of the population would give."""
    low, high = 10.0 ** (2 * RANGE[0]), 10.0 ** (2 * RANGE[1])
    mean_square = (high - low) / (2 * (RANGE[1] - RANGE[0]) * np.log(10))
    return moved * np.array([SHARES[name.partition("_")[0]] / 3 for name in NAMES]) * USUAL**2 * mean_square


@dataclass
class Unit:
    """A checked unit: kind of recording, change, its name, whether rejected, predicted power, explanations, update inside U."""

    kind: str
    name: str
    power: float
    rejected: bool
    named: str
    listed: bool
    inside: dict


def checked(rng, moved, drift, of_all):
    """Draw a unit, calibrate, change, record, check and update it."""
    from tumblecal.check.drift import NONE, ProcessNoise
    from tumblecal.check.result import Model, check
    from tumblecal.check.update import updated
    from tumblecal.data.calibration import Calibration
    from tumblecal.data.coverage_factor import coverage_factors
    from tumblecal.data.positions import PositionSet, attitudes_of
    from tumblecal.data.sensor_parameters import SensorParameters, correction_slope
    from tumblecal.ground.errors import InputError

    truth = np.concatenate([rng.normal(0, 3e-3, 3), rng.normal(0, 5e-3, 3), rng.normal(0, 1e-3, 3)])
    noise = 10 ** rng.uniform(-4.3, -3.5)
    estimate, per_variance, sigma, dof = calibrated(rng, truth, noise)
    estimated = bool(rng.integers(2))
    covariance = per_variance * (sigma if estimated else noise) ** 2
    slope = correction_slope(estimate)
    calibration = Calibration(
        np.linalg.inv(triad(estimate)),
        estimate[3:6],
        slope @ covariance @ slope.T,
        parameters=SensorParameters(NAMES, estimate, covariance),
        provenance={"dof": dof if estimated else None, "sigma_g": sigma},
    )
    kind = str(rng.choice(["hand", "head", "log"], p=[0.5, 0.4, 0.1]))
    drawn = recording(rng, kind)
    if estimated:  # the positions have the dispersion of the calibration
        drawn.noise = noise
    if of_all:
        change, name = np.sqrt(drift) * rng.normal(size=9), "all"
    else:
        change, name = change_of(rng) if rng.uniform() < moved else (np.zeros(9), "")
    now = truth + change
    readings = measured(rng, drawn, now)
    alpha, beta = (drawn.alpha, drawn.beta) if kind == "head" else attitudes_of(readings)
    data = PositionSet(
        tuple(f"p{k + 1}" for k in range(len(readings))),
        alpha,
        beta,
        readings,
        sd=np.full(readings.shape, drawn.noise),
        comments={} if kind == "head" else {"attitudes": "unknown"},
    )
    model = Model(priors={"dbeta": (0.0, PITCH_ERROR)} if kind == "head" else {})
    result = check(calibration, Path("nowhere/calibration.json"), data, model=model)
    best = result.moved.named if result.moved is not None else None
    inside = {}
    for label, process in (("none", NONE), ("drift", ProcessNoise(np.zeros(9), drift, None, "population"))):
        try:
            after = updated(result.test, process, best.parameters if best else (), {}).calibration.sensor
        except InputError:
            continue
        factor = coverage_factors(np.full(9, after.dof), 0.95) if np.isfinite(after.dof) else 1.96
        inside[label] = np.abs(after.values - now) <= factor * after.sd
    return Unit(
        kind,
        name,
        result.test.power(change) if name else np.nan,
        result.test.rejected,
        "" if best is None else ", ".join(best.parameters) or best.kind,
        result.moved is not None and any(name in each.parameters for each in result.moved.possible),
        inside,
    )


def share(units, of=lambda unit: unit.rejected):
    """A mean with its number of units."""
    return f"{np.mean([of(unit) for unit in units]):.3f} of {len(units)}" if units else "none"


def main():
    """Run, and print the figures."""
    options = argparse.ArgumentParser()
    options.add_argument("--units", type=int, default=500)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--moved", type=float, default=0.5)
    options.add_argument("--drift", action="store_true")
    given = options.parse_args()
    enable_float64()
    rng, drift = np.random.default_rng(given.seed), drift_of_population(given.moved)
    units = [checked(rng, given.moved, drift, given.drift) for _ in range(given.units)]
    still, shifted = [unit for unit in units if not unit.name], [unit for unit in units if unit.name]
    print(f"false alarms: {share(still)}")
    print(f"power: predicted {share(shifted, lambda unit: unit.power)}, observed {share(shifted)}")
    for low, high in ((0, 0.05), (0.05, 0.2), (0.2, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.01)):
        of = [unit for unit in shifted if low <= unit.power < high]
        print(
            f"  {low:.2f} to {min(high, 1):.2f}: predicted {share(of, lambda unit: unit.power)}, observed {share(of)}"
        )
    for kind in ("hand", "head", "log"):
        of, none = [[unit for unit in part if unit.kind == kind] for part in (shifted, still)]
        print(
            f"  {kind}: predicted {share(of, lambda unit: unit.power)}, observed {share(of)}; false alarms {share(none)}"
        )
    found = [unit for unit in shifted if unit.rejected]
    print(f"named: right {share(found, lambda unit: unit.named == unit.name)}")
    print(f"named: wrong {share(found, lambda unit: unit.named not in ('', unit.name))}")
    print(f"not named: {share(found, lambda unit: not unit.named)}")
    print(f"right one named or listed: {share(found, lambda unit: unit.listed)}")
    for process in ("none", "drift"):
        for label, part in (("unchanged", still), ("changed", shifted), ("all", units)):
            made = [unit.inside[process] for unit in part if process in unit.inside]
            print(
                f"coverage of updates, process noise {process}, {label}: {np.mean(made):.4f} ({len(made)} of {len(part)} units)"
            )


if __name__ == "__main__":
    main()
