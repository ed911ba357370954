"""False alarms and power of the changes of a unit that `history` reports: units written in numpy, at the level of results.

`python benchmarks/history_changes.py [count] [seed]` draws stable units with 4 to 12 results, whose standard deviation
between dates is 0 to 10 times the noise, and whose mount is clamped for each date; then units with a step or a drift, whose
sizes are in standard deviations of a result. It prints the fraction of units with a change; for steps and drifts, the
fractions with a change of this parameter, with the right kind and date, and within two standard uncertainties of the true size.
"""

import sys

import numpy as np

from tumblecal.data.sensor_parameters import MOUNT, SENSOR, SensorParameters
from tumblecal.history.changes import DRIFT, STEP
from tumblecal.history.entry import Entry
from tumblecal.history.repeatability import PAPER_LIMITS, unit_history


NAMES = (*SENSOR, *MOUNT)
# Standard uncertainties by the noise: scale factors, biases, non-orthogonality; of the mount.
NOISE = np.repeat([3e-5, 2.5e-5, 4e-5, 3.5e-5], 3)
MOUNTED = 2e-3  # sd of the mount angles from clamping to clamping, rad


def unit(rng, count, *, ratio=3.0, changes=(), days=None, dof=np.inf, unequal=False):
    """Results of a unit on dates at random intervals of one to six months, or of `days`.

    - `ratio`: standard deviation between dates, in standard uncertainties by the noise (one for each kind, or for all).
      `unequal`: those of the parameters of a kind differ.
    - `changes`: pairs of a parameter and its size at each result, in standard deviations of a result.
    - `dof`: the standard uncertainties are estimates with so many degrees of freedom.
    """
    days = np.cumsum(np.r_[0.0, rng.uniform(30, 180, count - 1) if days is None else np.full(count - 1, days)])
    between = np.repeat(np.broadcast_to(ratio, 3), 3) * NOISE[:9]
    between = between * (np.exp(rng.normal(0, 0.3, 9)) if unequal else 1.0)
    values = rng.normal(0, 3e-3, 12) + rng.normal(size=(count, 12)) * NOISE
    values += rng.normal(size=(count, 12)) * np.r_[between, np.full(3, MOUNTED)]
    for name, sizes in changes:
        place = NAMES.index(name)
        values[:, place] += np.hypot(between[place], NOISE[place]) * np.asarray(sizes)
    scale = np.ones(count) if np.isinf(dof) else rng.chisquare(dof, count) / dof
    return entries_of(days, values, np.diag(NOISE**2) * scale[:, None, None], dof)


def entries_of(days, values, covariances, dof=np.inf):
    """Results of one unit: days since 2024, values of the parameters, and their covariance matrices."""
    entries = []
    for k, (day, row, covariance) in enumerate(zip(days, values, covariances, strict=True)):
        date = np.datetime_as_string(np.datetime64("2024-01-01T00:00:00") + np.timedelta64(int(day * 86400), "s"))
        result = SensorParameters(NAMES, row, covariance, dof=dof)
        stated = ("A-17", f"{date}Z", f"{k}.csv", f"{k:064d}", "converged", 1e-4, 0.5)
        entries.append(Entry("calibration", *stated, result, number=k + 1))
    return entries


def found(entries):
    """The changes of a unit by parameter."""
    history = unit_history(entries, PAPER_LIMITS)
    return {trend.name: list(trend.changes) for trend in history.trends if trend.changes}


def stable(rng, count, dates, *, ratios=(0.0, 0.5, 1.0, 3.0, 10.0), **options):
    """Fraction of stable units with a change; each kind of parameter has one of the ratios."""
    changes = [found(unit(rng, dates, ratio=rng.choice(ratios, 3), **options)) for _ in range(count)]
    return np.mean([bool(of_unit) for of_unit in changes])


def steps(rng, count, dates, size, names, *, last=False):
    """Fractions of units with a step whose bias_x has a change, a step on the right date, and its size within 2 u."""
    rows = []
    for _ in range(count):
        place = dates - 1 if last else int(rng.integers(2, max(dates - 1, 3)))
        step = size * (np.arange(dates) >= place)
        changes = found(unit(rng, dates, changes=[(name, step) for name in names])).get("bias_x", [])
        dated = [change for change in changes if change.kind == STEP and change.first < place <= change.last]
        true = size * NOISE[3] * np.sqrt(10)
        rows.append([bool(changes), bool(dated), bool(dated) and abs(dated[0].size - true) < 2 * dated[0].u])
    return np.mean(rows, axis=0)


def drifts(rng, count, dates, size):
    """Fractions of units with a drift (change over all dates) whose bias_z has a change, a drift, and its rate within 2 u."""
    rows, rate = [], size * NOISE[3] * np.sqrt(10) / ((dates - 1) * 90 / (365.25 / 12))
    for _ in range(count):
        ramp = size * np.linspace(0, 1, dates)
        changes = found(unit(rng, dates, changes=[("bias_z", ramp)], days=90)).get("bias_z", [])
        named = [change for change in changes if change.kind == DRIFT]
        rows.append([bool(changes), bool(named), bool(named) and abs(named[0].size - rate) < 2 * named[0].u])
    return np.mean(rows, axis=0)


def main(count: int = 200, seed: int = 1, *, of_dates: tuple[int, ...] = (4, 5, 6, 8, 12)) -> None:
    """Print the tables."""
    biases = ("bias_x", "bias_y", "bias_z")
    for dates in of_dates:
        rng = np.random.default_rng([seed, dates])
        alarms = [stable(rng, count, dates, **options) for options in ({}, {"unequal": True}, {"dof": 5.0})]
        print(
            f"{dates} results, stable (equal, unequal, 5 degrees of freedom):",
            *(f"{rate:.3f}" for rate in alarms),
            flush=True,
        )
        for size in (5, 10):
            for words, names, last in (
                ("one bias", biases[:1], False),
                ("last", biases[:1], True),
                ("all", biases, False),
            ):
                rates = steps(rng, count, dates, size, names, last=last)
                print(f"    step of {size} ({words}):", *(f"{rate:.2f}" for rate in rates), flush=True)
        for size in (6, 12):
            print(f"    drift of {size}:", *(f"{rate:.2f}" for rate in drifts(rng, count, dates, size)), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
