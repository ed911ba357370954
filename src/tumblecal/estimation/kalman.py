"""The paper's Kalman filter (its equation 11): constant state, one data set of harmonics a step, Joseph form."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.estimation import harmonic
from tumblecal.estimation.fit import Fit, History
from tumblecal.estimation.problem import Problem


# Smallest sd of a reading, in sds of the prior. At this value the filter agrees with least squares within a tenth of an sd; at
# a third of it the difference is three sds.
_LEAST_SD = 1e-6


@dataclass(frozen=True)
class Prior:
    """Prior before the first data set: zero mean, one sd for all parameters (base units)."""

    sd: float = 0.01

    def covariance(self, size: int) -> Float[np.ndarray, "free free"]:
        """The prior's covariance matrix."""
        return np.eye(size) * self.sd**2

    def is_resolved(self, sd: float) -> bool:
        """Whether float64 has enough digits to update this prior by readings with that sd (base units)."""
        return sd >= _LEAST_SD * self.sd


# Much larger than any error of an instrument, and still within the digits of float64 (variance 1 against 1e-9).
DIFFUSE = Prior(sd=1.0)


def update(
    mean: Float[np.ndarray, " free"],
    covariance: Float[np.ndarray, "free free"],
    z: Float[np.ndarray, " m"],
    design: Float[np.ndarray, "m free"],
    noise: Float[np.ndarray, "m m"],
) -> tuple[np.ndarray, np.ndarray, float]:
    """One measurement update.

    **Arguments:**

    - `mean`, `covariance`: the state before.
    - `z`, `design`, `noise`: measurement, H, R.

    **Returns:** mean and covariance after, and the normalised innovation squared.
    """
    innovation = z - design @ mean
    spread = design @ covariance @ design.T + noise
    gain = np.linalg.solve(spread, design @ covariance).T
    keep = np.eye(len(mean)) - gain @ design
    after = keep @ covariance @ keep.T + gain @ noise @ gain.T  # Joseph form: stays symmetric and positive
    return mean + gain @ innovation, (after + after.T) / 2, float(innovation @ np.linalg.solve(spread, innovation))


def run(
    z: Float[np.ndarray, "steps m"],
    design: Float[np.ndarray, "m free"],
    noise: Float[np.ndarray, "m m"],
    prior: Prior | None = None,
) -> tuple[History, Float[np.ndarray, "free free"]]:
    """Filter a sequence of data sets with the same H and R.

    **Returns:** the history of estimates, and the last covariance.
    """
    return _filtered(((measurement, design, noise) for measurement in z), design.shape[1], prior)


def _filtered(
    steps: Iterable[tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m free"], Float[np.ndarray, "m m"]]],
    size: int,
    prior: Prior | None,
) -> tuple[History, Float[np.ndarray, "free free"]]:
    """Filter steps, each with a measurement, its H and its R."""
    mean, covariance = np.zeros(size), (prior or Prior()).covariance(size)
    values, deviations, nis, z = [], [], [], np.zeros(0)
    for z, design, noise in steps:
        mean, covariance, normalised = update(mean, covariance, z, design, noise)
        values.append(mean)
        deviations.append(np.sqrt(np.diag(covariance)))
        nis.append(normalised)
    return History(np.array(values), np.array(deviations), np.array(nis), len(z)), covariance


def fit(problem: Problem, *, sigma: float, prior: Prior | None = None) -> Fit:
    """Filter a position set, one run a step.

    **Arguments:**

    - `problem`: positions of one mounting; each run is one step.
    - `sigma`: sd of a reading, g, for R where the problem's noise is not stated.
    - `prior`: of all parameters; 10 mrad, 10 mg, 1 % if omitted.

    **Raises:** `InputError` for data that the linear equations do not fit.
    """
    harmonics = harmonic.analyse(problem)
    noise = harmonics.covariance * (1.0 if problem.known else sigma**2)
    runs = [np.array([owner == label for owner in harmonics.run]) for label in problem.measured_data.runs]
    steps = ((harmonics.z[rows], harmonics.design[rows], noise[np.ix_(rows, rows)]) for rows in runs)
    history, covariance = _filtered(steps, len(harmonics.names), prior)
    unit = covariance if problem.known else covariance / sigma**2
    return harmonic.fit_of("kalman", problem, harmonics, history.values[-1], unit, history=history)
