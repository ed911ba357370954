"""Many exact fits of any chain and plan at once, with one Jacobian for all of them.

Gauss-Newton spends its time on Jacobians: one per trial and iteration. Here the residual and its exact gradient
`J(x)'r(x)` come from one forward and one reverse pass, and the Hessian H from an expansion of the residual to second
order about one reference point that all trials share, in coordinates z with J_0'J_0 = 1:

    H(z) ~ 1 + S + T z,    S_ij = sum_r r_0r d2r_r/dz_i dz_j,    T_ijl = sum over the places of one i, j, l in J_0' dJ/dz.

S is linear in a trial's readings. The same expansion gives the start. The iteration `z <- z - H^-1 J(z)'r(z)` stops only
where J(z)'r(z) = 0, so its fixed point is the exact least-squares estimate whatever the error of H; that error only sets
the rate (the square of the distance from the reference point: three digits and more a step for milliradians).

A pass steps a part of the trials, those farthest from convergence first, so that a few slow ones do not delay the others.
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
from tumblecal.simulation.evaluated_once import evaluated_once


# A lane has converged when its remaining error, judged by the last step and the rate so far, is below this share of
# the parameters' typical sizes (1e-3): 1e-13 rad or g.
REMAINING = 1e-10
MOST_STEPS = 30
# Plain Gauss-Newton stops at this step, in typical sizes; its error is smaller by the rate (residual times curvature).
LAST_STEP = 1e-9
# Terms of the series that solves with the expanded Hessian; each gains more than a digit, as much as its error allows.
SERIES = 3
# Parts of a batch on a CPU; other devices step all trials at once.
PARTS = 4


class ChainFits(NamedTuple):
    """Estimates of a batch, their weighted sums of squares, convergence."""

    values: Float[Array, "lanes free"]
    chi2: Float[Array, " lanes"]
    converged: Bool[Array, " lanes"]


class Expansion(eqx.Module):
    """Common to all trials: the expansion about the parameters of a problem, in coordinates z with J_0'J_0 = 1.

    `to_values` turns such coordinates into parameters. `gain` turns errors of the readings (g) into the gradient at the
    reference point, of which `prior` is the priors' part; `bend` turns them into S, and `skew` is T, which is symmetric.
    """

    centre: Float[Array, " free"]
    to_values: Float[Array, "free free"]
    predicted: Float[Array, "positions 3"]
    gain: Float[Array, "free readings"]
    prior: Float[Array, " free"]
    bend: Float[Array, "free*free readings"]
    skew: Float[Array, "free*free free"]


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
    centre, positions = problem.chain.vector, len(problem.readings)
    jacobian, to_values = design(problem)
    second = np.asarray(_second_derivative(problem.bare, centre, to_values))
    gain, free = (jacobian @ to_values).T, len(centre)
    half = np.einsum("ir,rjl->ijl", gain, second)
    skew = half + half.transpose(1, 0, 2) + half.transpose(1, 2, 0)
    # By the errors of the readings instead of white rows.
    unwhitened = jax.linear_transpose(problem.rows, jnp.zeros((positions, 3)))
    of_readings = jax.vmap(lambda row: unwhitened(row)[0].ravel())
    rows = 3 * positions
    prior = gain[:, rows:] @ np.asarray(problem.prior_rows(centre)) if problem.with_prior else np.zeros(free)
    return Expansion(
        *(jnp.asarray(part) for part in (centre, to_values, np.asarray(problem.predicted(jnp.asarray(centre))))),
        gain=of_readings(jnp.asarray(gain[:, :rows])),
        prior=jnp.asarray(prior),
        bend=of_readings(jnp.asarray(second[:rows].reshape(rows, -1).T)),
        skew=jnp.asarray(skew.reshape(free * free, free)),
    )


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

    lanes = readings.shape[0]
    part = lanes // PARTS if jax.default_backend() == "cpu" and lanes % PARTS == 0 else lanes
    gradient_of = evaluated_once(jax.vmap(jax.value_and_grad(cost)), part)
    to_sizes = (shared.to_values / problem.scales[:, None]).T
    start, hessian = _start(shared, readings)

    def unfinished(state):
        passes, _, _, left, *_ = state
        return (passes < MOST_STEPS * (lanes // part)) & (left > 0)

    def step(state):
        passes, order, begin, left, count, point, value, earlier, remaining = state
        lane = jax.lax.dynamic_slice_in_dim(order, begin, part)
        squares, gradient = gradient_of(point[lane], readings[lane])
        moved = _solve(hessian[lane], gradient)
        length = jnp.max(jnp.abs(moved @ to_sizes), axis=1)
        rate = jnp.minimum(length / earlier[lane], 0.99)
        # The first step has no rate yet: the start's error is unknown, so go on.
        error = jnp.where(count[lane] == 0, jnp.inf, length * rate / (1.0 - rate))
        # A finished lane that fills the part moves by rounding, which is no rate.
        error = jnp.where(remaining[lane] < REMAINING, remaining[lane], error)
        point = point.at[lane].add(-moved)
        # Half the sum of squares after the step.
        value = value.at[lane].set(squares - 0.5 * jnp.sum(gradient * moved, axis=1))
        earlier, remaining = earlier.at[lane].set(jnp.maximum(length, 1e-300)), remaining.at[lane].set(error)
        order, begin, left = _queue(order, begin + part, left, remaining)
        return passes + 1, order, begin, left, count.at[lane].add(1), point, value, earlier, remaining

    nothing = jnp.zeros(lanes)
    zero, numbers = jnp.zeros((), int), jnp.arange(lanes)
    state = (zero, numbers, zero, zero + lanes, 0 * numbers, start, nothing, nothing + 1.0, nothing + jnp.inf)
    *_, point, value, _, remaining = jax.lax.while_loop(unfinished, step, state)
    values = shared.centre[None] + point @ shared.to_values.T
    good = (remaining < REMAINING) & jnp.all(jnp.isfinite(values), axis=1) & jnp.isfinite(value)
    return _again(problem, shared.centre, readings, ChainFits(values, 2.0 * value, good))


def _queue(order: Array, begin: Array, left: Array, remaining: Array) -> tuple[Array, Array, Array]:
    """Order of the lanes, where in it the next part begins, and the number of lanes that this round has to step.

    A round that is not at its end goes on; the next one begins with the lanes that are not finished.
    """

    def next_round():
        finished = remaining < REMAINING
        return jnp.argsort(finished), jnp.zeros_like(begin), jnp.sum(~finished, dtype=left.dtype)

    return jax.lax.cond(begin < left, lambda: (order, begin, left), next_round)


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


def _start(shared: Expansion, readings: Array) -> tuple[Array, Array]:
    """The minimum of the expansion for each trial, and the departure of the Hessian from 1 at the linear estimate."""
    error = (shared.predicted[None] - readings).reshape(len(readings), -1)
    linear = -(error @ shared.gain.T + shared.prior[None])
    by_residual, by_place = error @ shared.bend.T, linear @ shared.skew.T
    shape = (*linear.shape, linear.shape[1])
    hessian = (by_residual + by_place).reshape(shape)
    gradient = _product((by_residual + 0.5 * by_place).reshape(shape), linear)
    return linear - _solve(hessian, gradient), hessian


def _solve(departure: Array, right: Array) -> Array:
    """`(1 + departure)^-1 right` by its series, for departures well below one."""
    solution = right
    for _ in range(SERIES):
        solution = right - _product(departure, solution)
    return solution


def _product(matrices: Array, vectors: Array) -> Array:
    return jnp.einsum("lij,lj->li", matrices, vectors)
