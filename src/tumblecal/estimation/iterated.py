"""Iterated extended Kalman filter over the exact chain, a position a step.

Each update is a Gauss-Newton solution of its own small problem (Bell and Cathey 1993): prior state against the
readings of one position. What a live capture shows while positions come in.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain import Chain, Where
from tumblecal.estimation.exact import linearised
from tumblecal.estimation.fit import Code, Fit, History
from tumblecal.estimation.kalman import Prior
from tumblecal.estimation.problem import Problem


ITERATIONS = 4


def update(
    linearise: Callable[[Any], tuple[Any, Any]],
    mean: Float[Array | np.ndarray, " free"],
    covariance: Float[Array | np.ndarray, "free free"],
    z: Float[Array | np.ndarray, " m"],
    variance: Float[Array | np.ndarray, " m"],
    xp: Any = np,
) -> tuple[Any, Any, Any]:
    """One iterated update, in Joseph form.

    **Arguments:**

    - `linearise`: from a state vector to predicted readings (m,) and their Jacobian (m, free).
    - `mean`, `covariance`: the state before.
    - `z`, `variance`: measured readings and their variances.
    - `xp`: `numpy` for one run at a time, `jax.numpy` inside a compiled batch.

    **Returns:** mean and covariance after, and the normalised innovation squared.
    """
    predicted, design = linearise(mean)
    spread = design @ covariance @ design.T + xp.diag(variance)
    normalised = (z - predicted) @ xp.linalg.solve(spread, z - predicted)
    point, gain = mean, design.T
    for iteration in range(ITERATIONS):
        if iteration > 0:
            predicted, design = linearise(point)
            spread = design @ covariance @ design.T + xp.diag(variance)
        gain = xp.linalg.solve(spread, design @ covariance).T
        point = mean + gain @ (z - predicted - design @ (mean - point))
    keep = xp.eye(len(mean)) - gain @ design
    after = keep @ covariance @ keep.T + (gain * variance[None, :]) @ gain.T
    return point, (after + after.T) / 2, normalised


def filter_positions(
    chain: Chain,
    mean: Float[Array | np.ndarray, " free"],
    covariance: Float[Array | np.ndarray, "free free"],
    where: Where,
    measured: Float[Array | np.ndarray, "positions 3"],
    sd: Float[Array | np.ndarray, "positions 3"],
) -> tuple[Array, Array, Array, Array]:
    """All positions in order, one a step; pure JAX, for batches.

    **Returns:** means (positions, free), sd (positions, free), the last covariance, NIS (positions,).
    """

    def step(state, row):
        here, reading, deviation = row

        def linearise(vector):
            value, push = jax.linearize(lambda v: chain.at(v)(here).ravel(), vector)
            return value, jax.vmap(push, out_axes=-1)(jnp.eye(len(vector)))

        mean, covariance, normalised = update(
            linearise, state[0], state[1], reading.ravel(), deviation.ravel() ** 2, jnp
        )
        return (mean, covariance), (mean, jnp.sqrt(jnp.diag(covariance)), normalised)

    rows = jax.tree.map(lambda column: jnp.asarray(column)[:, None], (where, measured, sd))
    (_, last), (means, deviations, nis) = jax.lax.scan(step, (jnp.asarray(mean), jnp.asarray(covariance)), rows)
    return means, deviations, last, nis


class Filter:
    """The filter for one run as it is measured: `take` each position in any order; repeats are further readings.

    It linearises all positions of the plan at each step with the exact fit's own compiled program, so that a live
    estimate costs no compilation of its own.
    """

    def __init__(self, problem: Problem, prior: Prior | None = None):
        self.problem = problem
        self.mean = problem.chain.vector
        self.covariance = (prior or Prior()).covariance(len(self.mean))

    def take(self, position: int, reading: Float[np.ndarray, "3"], sd: Float[np.ndarray, "3"]) -> float:
        """Update by the reading of one position of the plan; returns the normalised innovation squared."""
        rows = slice(3 * position, 3 * position + 3)
        weight = 1.0 / self.problem.sd[position]
        planned = self.problem.readings[position]
        scales = self.problem.scales

        def linearise(vector):
            residual, jacobian = (np.asarray(part)[rows] for part in linearised(self.problem, vector))
            return residual / weight + planned, jacobian / weight[:, None] / scales

        self.mean, self.covariance, normalised = update(linearise, self.mean, self.covariance, reading, sd**2)
        return float(normalised)


def fit(problem: Problem, *, sigma: float, prior: Prior | None = None) -> Fit:
    """Filter a position set position by position, its noise taken as independent from position to position.

    **Arguments:**

    - `problem`: the model, settings and readings (its noise is taken where it is stated).
    - `sigma`: sd of a reading, g, where the problem's noise is not stated.
    - `prior`: of all parameters.
    """
    sd = problem.sd if problem.known else np.full(problem.readings.shape, sigma)
    running = Filter(problem, prior)
    means, deviations, nis = [], [], []
    for position, reading in enumerate(problem.readings):
        nis.append(running.take(position, reading, sd[position]))
        means.append(running.mean)
        deviations.append(np.sqrt(np.diag(running.covariance)))
    values = running.mean
    residuals = -problem.unwhitened(np.asarray(linearised(problem, values)[0])[: problem.readings.size])
    return Fit(
        method="iterated",
        problem=problem,
        names=problem.chain.names,
        units=problem.chain.units,
        values=values,
        covariance=running.covariance,
        residuals=residuals,
        chi2=float(np.sum((residuals / sd) ** 2)),
        dof=residuals.size - len(values),
        code=Code.CONVERGED if np.all(np.isfinite(values)) else Code.NON_FINITE,
        history=History(np.array(means), np.array(deviations), np.array(nis), 3),
    )
