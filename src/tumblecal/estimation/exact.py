"""Exact fit: Gauss-Newton on scaled parameters, judged by the size of one more step."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from tumblecal.chain import Chain
from tumblecal.estimation import closed_form
from tumblecal.estimation.fit import Code, Fit
from tumblecal.estimation.identifiability import RANK_TOLERANCE
from tumblecal.estimation.linearised import (
    MOST_STEPS,
    TOLERANCE,
    Point,
    descended,
    identifiability_of,
    point_at,
    require_full_rank,
    scaled_residual,
)
from tumblecal.estimation.problem import Problem, require_problem
from tumblecal.estimation.programs import cached_program


if TYPE_CHECKING:
    from optimistix import AbstractLeastSquaresSolver, AbstractMinimiser

    from tumblecal.estimation.robust import Loss


# Converged if one more Gauss-Newton step would change no parameter by more than this share of its sd; the second is for the
# fallback, which stops when the sum of squares hardly changes.
STEP_IN_SD, FALLBACK_STEP_IN_SD = 1e-6, 1e-4
# Further starts of a fit, as multiples of each time constant: a warm-up starts at 0.07 of the duration of the measurement.
_FACTORS = (0.3, 3.0, 10.0, 30.0)


def solve(problem: Problem, start: Float[Array | np.ndarray, " free"]) -> tuple[Array, Array, Array]:
    """The least-squares estimate as a pure function; differentiable in all of `problem` (implicit differentiation).

    **Arguments:**

    - `problem`, `start`: the problem and the start vector.

    **Returns:** vector, whether the solver reports convergence, number of steps.
    """
    import optimistix as optx

    scales = jnp.asarray(problem.scales)
    solution = optx.least_squares(
        lambda scaled, here: scaled_residual(here, scaled),
        optx.GaussNewton(TOLERANCE, TOLERANCE),
        start / scales,
        args=problem.bare,
        throw=False,
        max_steps=MOST_STEPS,
    )
    return jnp.asarray(solution.value) * scales, solution.result == optx.RESULTS.successful, solution.stats["num_steps"]


def fit(
    problem: Problem,
    start: Float[np.ndarray, " free"] | None = None,
    *,
    solver: "AbstractLeastSquaresSolver[Any, Any, Any, Any] | AbstractMinimiser[Any, Any, Any] | None" = None,
    loss: "Loss | None" = None,
) -> Fit:
    """Fit the chain to the data.

    Tried in turn: Gauss-Newton from the start, Levenberg-Marquardt from the start, Gauss-Newton from the closed form. With time
    constants Gauss-Newton starts from several values; the fit with the smallest residuals is used.

    **Arguments:**

    - `problem`: from `problem_of(data, chain, ...)` or `Problem.from_arrays`.
    - `start`: parameter vector (base units) to start from; the values of the chain if omitted.
    - `solver`: a least-squares solver or a minimiser of optimistix instead of these; it works on scaled parameters.
    - `loss`: a robust loss instead of half of the square of each white row, such as `robust.huber()`; the covariance is then
      the sandwich estimator.

    **Returns:** the fit; its `code` states how it converged, or that it did not.

    **Raises:** `InputError` if the design leaves directions undetermined; they are named. `TypeError` for other kinds
    of arguments.

    Examples:
        >>> import optimistix as optx
        >>> import tumblecal
        >>> from tumblecal.estimation import problem_of
        >>> from tumblecal.estimation.robust import huber
        >>> problem = problem_of(tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1), noise_sd=0.15e-3)
        >>> plain = tumblecal.fit(problem)
        >>> other = tumblecal.fit(problem, solver=optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10))
        >>> bool(abs(other.values - plain.values).max() < 1e-9), tumblecal.fit(problem, loss=huber()).method
        (True, 'exact, Huber loss (1.345)')
    """
    require_problem(problem, "fit")
    if isinstance(problem.readings, Tracer):
        raise TypeError("fit checks numbers, so JAX cannot trace it: use exact.solve in a traced function, or fit_many")
    starts = _starts(problem.chain) if start is None else [np.asarray(start, float)]
    bare = problem.bare
    first = point_at(bare, starts[0])
    require_full_rank(problem, first.jacobian)
    if solver is not None or loss is not None:
        from tumblecal.estimation.robust import fit_robust, minimised

        if loss is not None:
            return fit_robust(problem, loss, starts[0], solver)
        code, point = _judged(point_at(bare, *minimised(bare, solver, starts[0])), first, Code.CONVERGED_BY_FALLBACK)
        return fitted(problem, Code.CONVERGED if code.good else code, point)
    code, point = _judged(descended(bare, first), first, Code.CONVERGED)
    begin = first
    for other in starts[1:]:
        here = point_at(bare, other)
        its_code, its_point = _judged(descended(bare, here), first, Code.CONVERGED)
        if (not its_code.good, _size(its_point)) < (not code.good, _size(point)):
            code, point, begin = its_code, its_point, here
    if not code.good:
        code, point = _judged(descended(bare, begin, damped=True), first, Code.CONVERGED_BY_FALLBACK)
    if not code.good and np.all(np.isfinite(first.rows)) and problem.data and closed_form.applies(problem.chain):
        here = point_at(bare, closed_form.estimate(problem.measured_data))
        code, point = _judged(descended(bare, here), first, Code.CONVERGED_FROM_CLOSED_FORM)
    # No estimate where residuals are not finite: report the start.
    return fitted(problem, code, first._replace(vector=begin.vector) if code is Code.NON_FINITE else point)


def _starts(chain: Chain) -> list[Float[np.ndarray, " free"]]:
    """The values of the chain, then these with each time constant at several multiples.

    An exponential is strongly nonlinear in its time constant. From a start that is too short, Gauss-Newton may end in another
    minimum or diverge to an infinite constant, although the data determine it.
    """
    first = chain.vector
    constants = [k for k, unit in enumerate(chain.units) if unit == "s" and first[k] > 0]
    return [
        first,
        *(np.where(np.arange(len(first)) == k, factor * first, first) for k in constants for factor in _FACTORS),
    ]


def _size(point: Point) -> float:
    """Norm of the weighted residuals; infinite if one is not finite."""
    with np.errstate(over="ignore"):
        size = float(np.linalg.norm(point.rows))
    return size if np.isfinite(size) else np.inf


def _judged(point: Point, start: Point, good: Code) -> tuple[Code, Point]:
    """Judge convergence by the size of one more step, not by the solver's report.

    A fit worse than its start, or at a point where the design has lost rank, has diverged: its step is small only because the
    standard deviations are huge.
    """
    if not point.finite:
        return Code.NON_FINITE, point
    rows, jacobian = point.rows, point.jacobian
    _, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    lost_rank = bool(np.any(singular <= RANK_TOLERANCE * np.max(singular, initial=0.0)))
    if lost_rank or np.linalg.norm(rows) > 2 * np.linalg.norm(start.rows) + TOLERANCE:
        return Code.NOT_CONVERGED, point
    step = np.linalg.lstsq(jacobian, rows, rcond=None)[0]
    spread = np.sqrt(np.sum((right.T / np.maximum(singular, 1e-300)) ** 2, axis=1))
    noise = np.sqrt(rows @ rows / max(len(rows) - len(step), 1))
    share = FALLBACK_STEP_IN_SD if good is Code.CONVERGED_BY_FALLBACK else STEP_IN_SD
    moves = np.max(np.abs(step) / (share * spread * noise + TOLERANCE), initial=0.0)
    return (good if moves <= 1.0 else Code.NOT_CONVERGED), point


def fitted(
    problem: Problem,
    code: Code,
    point: Point,
    covariance: Float[np.ndarray, "free free"] | None = None,
    **others: Any,
) -> Fit:
    """The fit at a point.

    **Arguments:**

    - `covariance`: of the scaled parameters; from the Jacobian itself if omitted, without damping or solver scaling.
    - `others`: of `Fit`, in place of those of an exact fit.
    """
    rows, jacobian, scales = point.rows, point.jacobian, problem.scales
    dof = 3 * int(np.sum(problem.takes_part)) + problem.priors - len(scales)
    with np.errstate(over="ignore", invalid="ignore"):
        chi2 = float(rows @ rows)
    if covariance is None:
        # `(J'J)^-1` by SVD of J: forming J'J would lose half of the digits.
        _, singular, right = np.linalg.svd(jacobian, full_matrices=False)
        covariance = (right.T / singular**2) @ right
        if not problem.known:
            covariance = covariance * (chi2 / dof if dof > 0 else np.nan)
    residuals = -problem.unwhitened(rows[: problem.readings.size])
    if problem.retained is not None:
        residuals = np.asarray(problem.readings - problem.predicted(jnp.asarray(point.vector)))
    of_exact = {"method": "exact", "statistics": {"steps": float(point.steps)}}
    return Fit(
        **of_exact | others,
        problem=problem,
        names=problem.chain.names,
        units=problem.chain.units,
        values=point.vector,
        covariance=covariance * np.outer(scales, scales),
        residuals=residuals,
        chi2=chi2,
        dof=dof,
        code=code,
        rows=-rows,
        jacobian=jacobian,
        vector=point.vector,
        identifiability=identifiability_of(problem, jacobian),
    )


def sensitivity(problem: Problem, vector: Float[np.ndarray, " free"]) -> Float[Array, "free positions 3"]:
    """Derivative of the estimate by every reading, at the estimate `vector` (implicit differentiation).

    Exact: it includes the curvature of the residuals, not only the pseudo-inverse of J. Compiled once for problems of a kind.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.estimation import exact, problem_of
        >>> problem = problem_of(tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1), noise_sd=0.15e-3)
        >>> exact.sensitivity(problem, tumblecal.fit(problem).values).shape
        (15, 24, 3)
    """
    return _sensitivity(problem.bare, jnp.asarray(vector))


@cached_program
def _sensitivity(problem: Problem, vector: Array) -> Array:
    def estimate(measured):
        return solve(replace(problem, readings=measured), vector)[0]

    return jax.jacrev(estimate)(jnp.asarray(problem.readings))
