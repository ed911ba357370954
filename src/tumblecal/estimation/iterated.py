"""Iterated extended Kalman filter over the exact chain, a position a step.

Each update is a Gauss-Newton solution of its own small problem (Bell and Cathey 1993): prior state against the three
readings of one position. What a live capture shows while positions come in.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tumblecal.chain import Chain, Where
from tumblecal.data import PositionSet
from tumblecal.estimation.kalman import Prior
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.result import Code, History, Result


ITERATIONS = 4


def update(
    chain: Chain,
    mean: Float[Array, " free"],
    covariance: Float[Array, "free free"],
    where: Where,
    measured: Float[Array, "positions 3"],
    sd: Float[Array, "positions 3"],
) -> tuple[Array, Array, Array]:
    """Update a state by the readings of one or a few positions.

    **Arguments:**

    - `chain`: the model; its free leaves are the state.
    - `mean`, `covariance`: the state before, base units.
    - `where`, `measured`, `sd`: the positions, their readings and sd (g).

    **Returns:** mean and covariance after, and the normalised innovation squared.
    """

    def predict(vector):
        value = chain.at(vector)(where).ravel()
        return value, value

    z, variance = measured.ravel(), sd.ravel() ** 2
    point = mean
    normalised = jnp.zeros(())
    for iteration in range(ITERATIONS):
        design, predicted = jax.jacfwd(predict, has_aux=True)(point)
        spread = design @ covariance @ design.T + jnp.diag(variance)
        innovation = z - predicted - design @ (mean - point)
        if iteration == 0:
            normalised = innovation @ jnp.linalg.solve(spread, innovation)
        gain = jnp.linalg.solve(spread, design @ covariance).T
        point = mean + gain @ innovation
    keep = jnp.eye(len(mean)) - gain @ design
    after = keep @ covariance @ keep.T + (gain * variance) @ gain.T
    return point, (after + after.T) / 2, normalised


def filter_positions(
    chain: Chain,
    mean: Float[Array, " free"],
    covariance: Float[Array, "free free"],
    where: Where,
    measured: Float[Array, "positions 3"],
    sd: Float[Array, "positions 3"],
) -> tuple[Array, Array, Array, Array]:
    """All positions in order, one a step.

    **Returns:** means (positions, free), sd (positions, free), the last covariance, NIS (positions,).
    """

    def step(state, row):
        here, reading, deviation = row
        mean, covariance, normalised = update(chain, *state, here, reading, deviation)
        return (mean, covariance), (mean, jnp.sqrt(jnp.diag(covariance)), normalised)

    rows = jax.tree.map(lambda column: jnp.asarray(column)[:, None], (where, measured, sd))
    (_, last), (means, deviations, nis) = jax.lax.scan(step, (jnp.asarray(mean), jnp.asarray(covariance)), rows)
    return means, deviations, last, nis


_filter = eqx.filter_jit(filter_positions)


def fit(problem: Problem, data: PositionSet, *, sigma: float, prior: Prior | None = None) -> Result:
    """Filter a position set position by position.

    **Arguments:**

    - `problem`: the model and settings (its weights are the stated noise, if any).
    - `data`: the position set.
    - `sigma`: sd of a reading, g, where the problem's noise is not stated.
    - `prior`: of all parameters.
    """
    size = len(problem.chain.names)
    sd = 1.0 / np.asarray(problem.weights) if problem.noise == "stated" else np.full(data.readings.shape, sigma)
    start = problem.chain.vector
    means, deviations, last, nis = _filter(
        problem.chain, start, (prior or Prior()).covariance(size), problem.where, data.readings, sd
    )
    values = np.asarray(means)[-1]
    residuals = data.readings - np.asarray(problem.predicted(values))
    dof = data.readings.size - size
    return Result(
        method="iterated",
        names=problem.chain.names,
        units=problem.chain.units,
        values=values,
        covariance=np.asarray(last),
        residuals=residuals,
        sigma=float(np.sqrt(np.sum(residuals**2) / dof)) if dof > 0 else float("nan"),
        dof=dof,
        chi2=float(np.sum((residuals / sd) ** 2)),
        noise="stated" if problem.noise == "stated" else "estimated",
        code=Code.CONVERGED if np.all(np.isfinite(values)) else Code.NON_FINITE,
        data=data,
        chain=problem.chain.at(values),
        history=History(np.asarray(means), np.asarray(deviations), np.asarray(nis), 3),
    )
