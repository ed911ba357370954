"""Fits with a robust loss: a few gross errors have a bounded influence on the estimate.

An M-estimate minimises the sum of a loss `rho` of the white residuals (Huber and Ronchetti 2009, chapters 3 and 7). Written as
squares, `2 rho(r) = t(r)^2` with the sign of r, it is a least-squares problem for any solver. The covariance is the sandwich
`A^-1 B A^-1` with `A = J' diag(psi') J` and `B = J' diag(psi^2) J`, `psi = rho'`, times `rows / dof` for the parameters that
were fitted (White 1980; MacKinnon and White 1985, HC1). Priors are not made robust.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from tumblecal.estimation.exact import fitted
from tumblecal.estimation.fit import Code, Fit
from tumblecal.estimation.linearised import point_at
from tumblecal.estimation.problem import Problem


_TOLERANCE, _MOST_STEPS = 1e-10, 512
# The scale of unknown noise has settled when it changes by less than this share.
_SETTLED, _MOST_SCALES = 1e-4, 20
# Median of the absolute values of a standard normal variable.
_NORMAL_MEDIAN = 0.6745
# A fit has converged if one more Newton step moves no parameter by more than this share of its standard deviation.
_STEP_IN_SD = 1e-3
# White residuals nearer to zero are their own square root of twice the loss.
_NEAR_ZERO = 1e-6


@dataclass(frozen=True)
class Loss:
    """A loss of one white residual: `rho(r)`, even, 0 at 0, about r^2/2 near it; `words` for the method of the fit."""

    words: str
    rho: Callable[[Float[Array, ""]], Float[Array, ""]]


@cache
def huber(threshold: float = 1.345) -> Loss:
    """Huber's loss: r^2/2 up to the threshold (standard deviations), linear beyond; 1.345 has 95 % efficiency for normal noise.

    Examples:
        >>> from tumblecal.estimation.robust import huber
        >>> float(huber(1.0).rho(0.5)), float(huber(1.0).rho(3.0))
        (0.125, 2.5)
    """

    def rho(r):
        size = jnp.abs(r)
        return jnp.where(size <= threshold, 0.5 * r**2, threshold * (size - 0.5 * threshold))

    return Loss(f"Huber loss ({threshold:g})", rho)


@cache
def cauchy(scale: float = 2.385) -> Loss:
    """Cauchy's loss, `scale^2/2 log(1 + (r/scale)^2)`: the influence of a gross error decreases with its size; 2.385 has 95 %
    efficiency for normal noise.

    Examples:
        >>> from tumblecal.estimation.robust import cauchy
        >>> round(float(cauchy(1.0).rho(1.0)), 4)
        0.3466
    """
    return Loss(f"Cauchy loss ({scale:g})", lambda r: 0.5 * scale**2 * jnp.log1p((r / scale) ** 2))


def minimised(
    problem: Problem, solver: Any, start: Float[np.ndarray, " free"], loss: Loss | None = None, scale: float = 1.0
) -> tuple[Float[np.ndarray, " free"], int]:
    """The vector that minimises the sum of the losses of the white rows, and the number of steps.

    **Arguments:**

    - `solver`: a least-squares solver or minimiser of optimistix. `loss`: of the rows of the readings in units of `scale`; if
      omitted, half of their square.
    """
    if not isinstance(solver, optx.AbstractLeastSquaresSolver | optx.AbstractMinimiser):
        raise TypeError(f"solver {solver!r}: give a solver of optimistix, such as LevenbergMarquardt(1e-10, 1e-10)")
    vector, steps = _minimised(problem.bare, solver, jnp.asarray(start), loss, jnp.asarray(scale))
    return np.asarray(vector), int(steps)


@eqx.filter_jit
def _minimised(problem: Problem, solver: Any, start: Array, loss: Loss | None, scale: Array) -> tuple[Array, Array]:
    scales = jnp.asarray(problem.scales)

    def rows(scaled, here):
        whole = here.residual(scaled * scales)
        return whole if loss is None else _stretched(loss, whole, here.readings.size, scale)

    options = {"args": problem, "throw": False, "max_steps": _MOST_STEPS}
    if isinstance(solver, optx.AbstractLeastSquaresSolver):
        solution = optx.least_squares(rows, solver, start / scales, **options)
    else:
        solution = optx.minimise(lambda z, here: 0.5 * jnp.sum(rows(z, here) ** 2), solver, start / scales, **options)
    return solution.value * scales, solution.stats["num_steps"]


def _stretched(loss: Loss, rows: Float[Array, " rows"], readings: int, scale: Array) -> Float[Array, " rows"]:
    """Rows whose squares are twice the losses; those of the priors as they are."""
    data = rows[:readings] / scale
    near = jnp.abs(data) < _NEAR_ZERO
    # The square root has no derivative at zero, where it is the residual itself.
    root = jnp.sqrt(2.0 * jax.vmap(loss.rho)(jnp.where(near, 1.0, data)))
    return jnp.concatenate([jnp.where(near, data, jnp.sign(data) * root), rows[readings:]])


def fit_robust(problem: Problem, loss: Loss, start: Float[np.ndarray, " free"], solver: Any = None) -> Fit:
    """The M-estimate of a problem with a design of full rank; arguments as of `exact.fit`.

    Unknown noise: its scale is the median of the absolute residuals, divided by that of a standard normal variable and
    corrected for the fitted parameters; estimate and scale are computed in turn until both have settled.

    **Raises:** `TypeError` for a `loss` that is none.
    """
    if not isinstance(loss, Loss):
        raise TypeError(f"loss {loss!r}: give a Loss of estimation.robust, such as huber()")
    solver = optx.LevenbergMarquardt(rtol=_TOLERANCE, atol=_TOLERANCE) if solver is None else solver
    bare, vector, scale, steps = problem.bare, start, 1.0, 0
    count, used = problem.readings.size, np.repeat(problem.takes_part, 3)
    dof = int(used.sum()) + problem.priors - len(vector)
    for _ in range(1 if problem.known else _MOST_SCALES):
        vector, more = minimised(bare, solver, vector, loss, scale)
        steps, before = steps + more, scale
        if problem.known:
            break
        sizes = np.abs(np.asarray(problem.residual(jnp.asarray(vector))))[:count][used]
        scale = float(np.median(sizes)) / _NORMAL_MEDIAN * np.sqrt(used.sum() / max(dof, 1))
        if abs(scale - before) < _SETTLED * scale:
            break
    point = point_at(bare, vector, steps)
    of_data, prior = point.jacobian[:count], point.jacobian[count:]
    influence, slope = map(np.asarray, _derivatives(loss, jnp.asarray(point.rows[:count] / scale)))
    curvature = of_data.T @ (of_data * slope[:, None]) / scale**2 + prior.T @ prior
    scatter = of_data.T @ (of_data * (influence**2)[:, None]) / scale**2 * (used.sum() / max(dof, 1))
    inverse = np.linalg.pinv(curvature, hermitian=True)
    covariance = inverse @ (scatter + prior.T @ prior) @ inverse
    step = inverse @ (of_data.T @ influence / scale + prior.T @ point.rows[count:])
    finite = bool(np.all(np.isfinite(point.rows)) and np.all(np.isfinite(covariance)))
    small = finite and bool(np.all(np.abs(step) <= _STEP_IN_SD * np.sqrt(np.diag(covariance)) + _TOLERANCE))
    code = Code.CONVERGED if small else Code.NOT_CONVERGED if finite else Code.NON_FINITE
    statistics = {"steps": float(steps), "scale": scale}
    return fitted(problem, code, point, covariance, method=f"exact, {loss.words}", statistics=statistics)


@eqx.filter_jit
def _derivatives(loss: Loss, rows: Array) -> tuple[Array, Array]:
    """First and second derivative of the loss of each row."""
    return jax.vmap(jax.grad(loss.rho))(rows), jax.vmap(jax.grad(jax.grad(loss.rho)))(rows)
