"""Many exact fits of any chain and plan at once, with one Jacobian for all of them.

Gauss-Newton spends its time on Jacobians: one per trial and iteration. Here the residual and its exact gradient
`J(x)'r(x)` come from one forward and one reverse pass, and the normal matrix from an expansion about one reference
point that all trials share,

    N(x) = J'J ~ N_0 + sum_l (x - x_0)_l (J_0' J_l + J_l' J_0),    J_l = dJ/dx_l.

The iteration `x <- x - N(x)^-1 J(x)'r(x)` stops only where J(x)'r(x) = 0, so its fixed point is the exact
least-squares estimate whatever the error of N; that error only sets the rate (the square of the distance from the
reference point: four digits and more a step for milliradians).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from tumblecal.estimation.linearised import linearised, require_full_rank
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.programs import cached_program


# A lane has converged when its remaining error, judged by the last step and the rate so far, is below this share of
# the parameters' typical sizes (1e-3): 1e-13 rad or g.
REMAINING = 1e-10
MOST_STEPS = 30
# Plain Gauss-Newton stops at this step, in typical sizes; its error is smaller by the rate (residual times curvature).
LAST_STEP = 1e-9
# Terms of the series that solves with the expanded normal matrix; each gains about two digits.
SERIES = 4


class ChainFits(NamedTuple):
    """Estimates of a batch, their weighted sums of squares, convergence."""

    values: Float[Array, "lanes free"]
    chi2: Float[Array, " lanes"]
    converged: Bool[Array, " lanes"]


class Expansion(eqx.Module):
    """Common to all trials: the expansion about the parameters of a problem, in coordinates with N_0 = 1.

    `to_values` turns such coordinates into parameters, `gain` (J_0 in them, transposed) a residual into a gradient;
    `slope[i, j, l]` is the change of N_ij with coordinate l.
    """

    centre: Float[Array, " free"]
    to_values: Float[Array, "free free"]
    predicted: Float[Array, "positions 3"]
    gain: Float[Array, "free rows"]
    slope: Float[Array, "free free free"]


def design(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian of the weighted residual at the chain's own parameters, and the matrix W with `(J W)'(J W) = 1`.

    **Raises:** `InputError` when the positions leave directions undetermined; they are named.
    """
    scales = problem.scales
    jacobian = np.asarray(linearised(problem, problem.chain.vector)[1])
    require_full_rank(problem, jacobian, "study")
    return jacobian / scales, np.linalg.inv(np.linalg.qr(jacobian, mode="r")) * scales[:, None]


def expansion(problem: Problem) -> Expansion:
    """The expansion about `problem.chain.vector`.

    **Raises:** `InputError` when the positions leave directions undetermined; they are named.
    """
    centre = problem.chain.vector
    jacobian, to_values = design(problem)
    second = _second_derivative(problem.bare, centre, to_values)
    gain = (jacobian @ to_values).T
    half = np.einsum("ir,rjl->ijl", gain, np.asarray(second))
    predicted = np.asarray(problem.predicted(jnp.asarray(centre)))
    slope = half + half.transpose(1, 0, 2)
    return Expansion(*(jnp.asarray(part) for part in (centre, to_values, predicted, gain, slope)))


@cached_program
def _second_derivative(problem: Problem, centre: Array, to_values: Array) -> Array:
    def residual(coordinates):
        return problem.residual(centre + to_values @ coordinates)

    return jax.jacfwd(jax.jacfwd(residual))(jnp.zeros(centre.shape))


def fit_chain(problem: Problem, shared: Expansion, readings: Float[Array, "lanes positions 3"]) -> ChainFits:
    """Least-squares estimates for a batch of readings (g) at the problem's positions, expanded about its parameters."""

    def cost(coordinates, measured):
        at = eqx.tree_at(lambda p: p.readings, problem, measured)
        rows = at.residual(shared.centre + shared.to_values @ coordinates)
        return 0.5 * jnp.sum(rows * rows)

    gradient_of = jax.vmap(jax.value_and_grad(cost))
    start, slope = _first_step(problem, shared, readings)

    def unfinished(state):
        count, _, _, _, remaining = state
        return (count < MOST_STEPS) & jnp.any(~(remaining < REMAINING))

    def step(state):
        count, point, _, earlier, _ = state
        value, gradient = gradient_of(point, readings)
        moved = _solve(slope, gradient)
        length = jnp.max(jnp.abs(moved @ (shared.to_values / problem.scales[:, None]).T), axis=1)
        rate = jnp.minimum(length / earlier, 0.99)
        # The first step has no rate yet: the start's error is unknown, so go on.
        remaining = jnp.where(count == 0, jnp.inf, length * rate / (1.0 - rate))
        return count + 1, point - moved, value, jnp.maximum(length, 1e-300), remaining

    lanes = readings.shape[0]
    nothing = jnp.zeros(lanes)
    state = (jnp.zeros((), int), start, nothing, nothing + 1.0, nothing + jnp.inf)
    _, point, value, _, remaining = jax.lax.while_loop(unfinished, step, state)
    values = shared.centre[None] + point @ shared.to_values.T
    # The value belongs to the point before the last step, which moved it by less than rounding once converged.
    good = (remaining < REMAINING) & jnp.all(jnp.isfinite(values), axis=1) & jnp.isfinite(value)
    return _again(problem, shared.centre, readings, ChainFits(values, 2.0 * value, good))


def _again(problem: Problem, centre: Array, readings: Array, found: ChainFits) -> ChainFits:
    """Plain Gauss-Newton, with a Jacobian for each trial and step, for lanes that did not converge with the shared one.

    Runs only for batches that have such lanes; the others' values stay as they are.
    """
    scales = jnp.asarray(problem.scales)

    def of_lane(vector, measured):
        return linearised(eqx.tree_at(lambda p: p.readings, problem, measured), vector)

    def unfinished(state):
        count, _, _, good = state
        return (count < MOST_STEPS) & ~jnp.all(good)

    def step(state):
        count, values, chi2, good = state
        rows, jacobian = jax.vmap(of_lane)(values, readings)
        normal = jnp.swapaxes(jacobian, 1, 2) @ jacobian
        moved = jnp.linalg.solve(normal, jnp.einsum("lri,lr->li", jacobian, rows)[..., None])[..., 0]
        after = jnp.where(good[:, None], values, values - moved * scales[None])
        squares = jnp.where(good, chi2, jnp.sum(rows * rows, axis=1))
        small = jnp.max(jnp.abs(moved), axis=1) < LAST_STEP
        return count + 1, after, squares, good | (small & jnp.isfinite(squares))

    start = jnp.where(found.converged[:, None], found.values, centre[None])
    state = (jnp.zeros((), int), start, found.chi2, found.converged)
    _, values, chi2, good = jax.lax.while_loop(unfinished, step, state)
    return ChainFits(values, chi2, good)


def _first_step(problem: Problem, shared: Expansion, readings: Array) -> tuple[Array, Array]:
    """The linear estimate from the reference point, and the normal matrices' departures from 1 there."""
    flat = jax.vmap(problem.rows)(shared.predicted[None] - readings)
    gradient = flat @ shared.gain[:, : flat.shape[1]].T
    if problem.with_prior:
        prior = problem.prior_rows(shared.centre)
        gradient = gradient + (shared.gain[:, flat.shape[1] :] @ prior)[None]
    start = -gradient
    free = start.shape[1]
    slope = start @ shared.slope.reshape(free * free, free).T
    return start, slope.reshape(-1, free, free)


def _solve(slope: Array, right: Array) -> Array:
    """`(1 + slope)^-1 right` by its series, for slopes well below one."""
    solution = right
    for _ in range(SERIES):
        solution = right - jnp.sum(slope * solution[:, None, :], axis=2)
    return solution
