"""Exact fit: Gauss-Newton through optimistix on scaled parameters, checked afterwards on the clean Jacobian."""

from collections.abc import Sequence
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
from tumblecal.estimation.linearised import identifiability_of, linearised, require_full_rank, scaled_residual
from tumblecal.estimation.problem import Problem, require_problem
from tumblecal.estimation.programs import cached_program
from tumblecal.estimation.robust import Loss, fit_robust, minimised


if TYPE_CHECKING:
    from optimistix import AbstractLeastSquaresSolver, AbstractMinimiser


TOLERANCE = 1e-10  # of the scaled parameters and of the sum of squares, relative and absolute
MOST_STEPS = 64
# Converged if one more Gauss-Newton step would change no parameter by more than this share of its sd; the second is for the
# fallback, which stops when the sum of squares hardly changes.
STEP_IN_SD, FALLBACK_STEP_IN_SD = 1e-6, 1e-4
# Further starts of a fit, as multiples of each time constant: a warm-up starts at 0.07 of the duration of the measurement.
_FACTORS = (0.3, 3.0, 10.0, 30.0)


def solve(
    problem: Problem, start: Float[Array | np.ndarray, " free"], *, damped: bool = False
) -> tuple[Array, Array, Array]:
    """The least-squares estimate as a pure function; differentiable in all of `problem` (implicit differentiation).

    **Arguments:**

    - `problem`, `start`: the problem and the start vector.
    - `damped`: Levenberg-Marquardt instead of Gauss-Newton.

    **Returns:** vector, whether the solver reports convergence, number of steps.
    """
    import optimistix as optx

    scales = jnp.asarray(problem.scales)
    solver = optx.LevenbergMarquardt if damped else optx.GaussNewton
    solution = optx.least_squares(
        lambda scaled, here: scaled_residual(here, scaled),
        solver(TOLERANCE, TOLERANCE),
        start / scales,
        args=problem.bare,
        throw=False,
        max_steps=MOST_STEPS * (8 if damped else 1),
    )
    return jnp.asarray(solution.value) * scales, solution.result == optx.RESULTS.successful, solution.stats["num_steps"]


@cached_program
def _gauss_newton(problem: Problem, start: Array):
    """The fit, and the linearisation at start and end, as one program."""
    vector, _, steps = solve(problem, start)
    return vector, steps, linearised(problem, vector), linearised(problem, start)


@cached_program
def _levenberg_marquardt(problem: Problem, start: Array):
    vector, _, steps = solve(problem, start, damped=True)
    return vector, steps, linearised(problem, vector)


def fit(
    problem: Problem,
    start: Float[np.ndarray, " free"] | None = None,
    *,
    solver: "AbstractLeastSquaresSolver[Any, Any, Any, Any] | AbstractMinimiser[Any, Any, Any] | None" = None,
    loss: Loss | None = None,
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
    if loss is not None and not isinstance(loss, Loss):
        raise TypeError(f"loss {loss!r}: give a Loss of estimation.robust, such as huber()")
    if isinstance(problem.readings, Tracer):
        raise TypeError("fit checks numbers, so JAX cannot trace it: use exact.solve in a traced function, or fit_many")
    if loss is not None:
        return fit_robust(problem, loss, start, solver)
    if solver is not None:
        return _fit_by(problem, solver, start)
    starts = _starts(problem.chain) if start is None else [np.asarray(start, float)]
    start = starts[0]
    *outcome, at_start = _gauss_newton(problem.bare, start)
    residual, design = (np.asarray(part) for part in at_start)
    require_full_rank(problem, design)
    code, checked = _judged(outcome, residual, Code.CONVERGED)
    for other in starts[1:]:
        *outcome, _ = _gauss_newton(problem.bare, other)
        its_code, its_checked = _judged(outcome, residual, Code.CONVERGED)
        if (not its_code.good, _size(its_checked)) < (not code.good, _size(checked)):
            code, checked, start = its_code, its_checked, other
    if not code.good:
        code, checked = _judged(_levenberg_marquardt(problem.bare, start), residual, Code.CONVERGED_BY_FALLBACK)
    if not code.good and np.all(np.isfinite(residual)) and problem.data and closed_form.applies(problem.chain):
        *outcome, _ = _gauss_newton(problem.bare, closed_form.estimate(problem.measured_data))
        code, checked = _judged(outcome, residual, Code.CONVERGED_FROM_CLOSED_FORM)
    if code is Code.NON_FINITE:  # no estimate there: report the start
        checked = (start, residual, design, 0)
    return _fitted(problem, code, *checked)


def _fit_by(problem: Problem, solver: Any, start: Float[np.ndarray, " free"] | None) -> Fit:
    """The fit by a given solver; `code` states whether one more Gauss-Newton step would move the estimate."""
    start = problem.chain.vector if start is None else np.asarray(start, float)
    residual, design = map(np.asarray, linearised(problem, start))
    require_full_rank(problem, design)
    vector, steps = minimised(problem.bare, solver, start)
    checked = np.asarray(vector), steps, linearised(problem, vector)
    code, judged = _judged(checked, residual, Code.CONVERGED_BY_FALLBACK)
    return _fitted(problem, Code.CONVERGED if code.good else code, *judged)


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


_Checked = tuple[np.ndarray, np.ndarray, np.ndarray, int]


def _size(checked: _Checked) -> float:
    """Norm of the weighted residuals; infinite if one is not finite."""
    with np.errstate(over="ignore"):
        size = float(np.linalg.norm(checked[1]))
    return size if np.isfinite(size) else np.inf


def _judged(outcome: Sequence, at_start: np.ndarray, good: Code) -> tuple[Code, _Checked]:
    """Judge convergence by the size of one more step, not by the solver's report.

    A fit worse than its start, or at a point where the design has lost rank, has diverged: its step is small only because the
    standard deviations are huge.
    """
    vector, residual, jacobian = (np.asarray(part) for part in (outcome[0], *outcome[2]))
    checked = (vector, residual, jacobian, int(outcome[1]))
    if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian)) and np.all(np.isfinite(vector))):
        return Code.NON_FINITE, checked
    _, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    lost_rank = bool(np.any(singular <= RANK_TOLERANCE * np.max(singular, initial=0.0)))
    if lost_rank or np.linalg.norm(residual) > 2 * np.linalg.norm(at_start) + TOLERANCE:
        return Code.NOT_CONVERGED, checked
    step = np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    spread = np.sqrt(np.sum((right.T / np.maximum(singular, 1e-300)) ** 2, axis=1))
    dof = max(len(residual) - len(step), 1)
    noise = np.sqrt(residual @ residual / dof)
    share = FALLBACK_STEP_IN_SD if good is Code.CONVERGED_BY_FALLBACK else STEP_IN_SD
    moves = np.max(np.abs(step) / (share * spread * noise + TOLERANCE), initial=0.0)
    return (good if moves <= 1.0 else Code.NOT_CONVERGED), checked


def _fitted(
    problem: Problem, code: Code, vector: np.ndarray, rows: np.ndarray, jacobian: np.ndarray, steps: int
) -> Fit:
    """The fit with the covariance from the Jacobian itself, without damping or solver scaling."""
    names, scales = problem.chain.names, problem.scales
    count = problem.readings.size
    dof = 3 * int(np.sum(problem.takes_part)) + problem.priors - len(names)
    with np.errstate(over="ignore", invalid="ignore"):
        chi2 = float(rows @ rows)
    # `(J'J)^-1` by SVD of J: forming J'J would lose half of the digits.
    _, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    inverse = (right.T / singular**2) @ right
    if not problem.known:
        inverse = inverse * (chi2 / dof if dof > 0 else np.nan)
    residuals = -problem.unwhitened(rows[:count])
    if problem.retained is not None:
        residuals = np.asarray(problem.readings - problem.predicted(jnp.asarray(vector)))
    return Fit(
        method="exact",
        problem=problem,
        names=names,
        units=problem.chain.units,
        values=vector,
        covariance=inverse * np.outer(scales, scales),
        residuals=residuals,
        chi2=chi2,
        dof=dof,
        code=code,
        rows=-rows,
        jacobian=jacobian,
        vector=vector,
        statistics={"steps": float(steps)},
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
