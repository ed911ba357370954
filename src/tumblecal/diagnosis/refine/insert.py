"""Causes inserted in the model and fitted exactly."""

import logging
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dtrtri  # type: ignore[attr-defined]

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.sign_variants import start_with_signs
from tumblecal.diagnosis.priors import HIDDEN
from tumblecal.diagnosis.refine.hidden import hidden_shifts
from tumblecal.estimation.chain_programs import Evaluation
from tumblecal.estimation.fit import Code, Fit
from tumblecal.estimation.identifiability import surely_full_rank
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.priors import LARGE
from tumblecal.full_model.tangent import Tangent, tangent, white_residual, white_rows


_log = logging.getLogger(__name__)
MOST_STEPS = 40
SMALL_STEP = 1e-5
# Steps with an old Jacobian go on while each is at most this share of the one before.
SLOW = 0.2
# A Jacobian is still that of the solution when the prediction moved by less than this share since.
UNBENT = 3e-6
ROUNDING = 1e-14
# A step that makes the residual longer by more than this is halved, at most so often: far from the solution (two positions
# exchanged, say) the linearisation promises too much.
_WORSE, _MOST_HALVINGS = 1.0 + 1e-6, 12
# Directions of a fit that the data see by less than this share of the best seen are left where they are.
_SEEN = 1e-12
# A time constant may end between these shares and multiples of its start.
_SHAPE_RANGE = (0.1, 10.0)


class _Unknowns(NamedTuple):
    """What is fitted. `directions` (full, moved): the moved directions of the full vector, scaled; `terms` (rows, terms):
    white signals with coefficients of their own."""

    directions: Float[np.ndarray, "full moved"]
    terms: Float[np.ndarray, "rows terms"]


class _Solution(NamedTuple):
    """Where Gauss-Newton ended: full vector, white residual, which rows take part (1, else 0), Jacobian by
    the unknowns and by the scaled full vector, inverse of the normal matrix, whether the steps became small."""

    vector: Float[np.ndarray, " full"]
    residual: Float[np.ndarray, " rows"]
    takes_part: Float[np.ndarray, " rows"]
    jacobian: Float[np.ndarray, "rows unknowns"]
    whole: Float[np.ndarray, "rows full"]
    inverse: Float[np.ndarray, "unknowns unknowns"]
    converged: bool

    @property
    def chi2(self) -> float:
        """Sum of squares of the rows that take part."""
        white = self.residual * self.takes_part
        return float(white @ white)

    @property
    def settled(self) -> bool:
        """Whether it is a solution."""
        return self.converged and bool(np.all(np.isfinite(self.jacobian)) and np.all(np.isfinite(self.residual)))


def fit_with(at: Tangent, causes: Sequence[Cause]) -> Fit:
    """Exact fit of the nominal parameters together with those of some causes.

    **Arguments:**

    - `at`: start values of the nominal parameters.
    - `causes`: faults are undone, outlier positions excluded, effects and generic terms fitted.

    **Returns:** the fit, with the effects' links in its chain; its `code` reports if Gauss-Newton did not converge.
    """
    problem, model = at.problem, at.model
    for cause in causes:
        problem = cause.undone(problem)
    # Of the start only the nominal part is taken and what shows of these causes' effects, as those met earlier may not be among
    # them: without it the first step would lose the signs of inputs with which an effect jumps.
    vector = model.with_nominal(at.vector[: model.nominal])
    for cause in causes:
        if cause.directions is not None:
            columns = list(cause.slot.columns)
            shown = cause.directions @ (cause.directions.T @ (at.vector[columns] / model.scales[columns]))
            vector[columns] = model.scales[columns] * shown
    if any(cause.signs is not None for cause in causes):
        undone = at if problem is at.problem else tangent(model, problem, at.vector)
        vector = start_with_signs(undone, causes, directions_of(undone, causes))
    evaluation = at.evaluation
    if problem.where is not at.problem.where or not np.array_equal(at.vector, vector):
        evaluation = model.evaluate(problem.where, vector)
    terms = np.zeros((len(at.residual), sum(len(cause.terms) for cause in causes)))
    for column, signal in enumerate(signal for cause in causes for signal in cause.terms):
        terms[: len(signal), column] = signal
    unknowns = _Unknowns(directions_of(at, causes), terms)
    solution = _solved(problem, model, unknowns, vector, evaluation)
    for cause in causes:
        if cause.slot.shape:
            unknowns, solution = _shape_freed(problem, model, list(cause.slot.shape), unknowns, solution)
    unknowns, solution = _hidden_freed(at, problem, causes, unknowns, solution)
    words = " + ".join(cause.label for cause in causes) or "the nominal model"
    _log.debug(
        "exact fit with %s: chi2 %.5g, %s", words, solution.chi2, "settled" if solution.settled else "not settled"
    )
    return _fit(problem, model, [cause for cause in causes if cause.slot.columns], unknowns, solution)


def _shape_freed(
    problem: Problem, model: FullModel, columns: list[int], unknowns: _Unknowns, solution: _Solution
) -> tuple[_Unknowns, _Solution]:
    """With an effect's shape parameter (a time constant) free as well, where that settles in range; else at the end of the
    range that it ran to, where that explains more: a long warm-up is a drift."""
    wider = unknowns._replace(directions=np.hstack([unknowns.directions, np.eye(len(model.start))[:, columns]]))
    freed = _solved(problem, model, wider, solution.vector, model.evaluate(problem.where, solution.vector))
    ratio = freed.vector[columns] / model.start[columns]
    if freed.settled and np.all((ratio > _SHAPE_RANGE[0]) & (ratio < _SHAPE_RANGE[1])):
        return wider, freed
    # Past an endless time constant the next is a negative one.
    end = _SHAPE_RANGE[0] if np.all((ratio > 0) & (ratio <= _SHAPE_RANGE[0])) else _SHAPE_RANGE[1]
    at_end = solution.vector.copy()
    at_end[columns] = end * model.start[columns]
    held = _solved(problem, model, unknowns, at_end, model.evaluate(problem.where, at_end))
    return unknowns, held if held.settled and held.chi2 < solution.chi2 else solution


def _hidden_freed(
    at: Tangent, problem: Problem, causes: Sequence[Cause], unknowns: _Unknowns, solution: _Solution
) -> tuple[_Unknowns, _Solution]:
    """With the directions of the coefficients that the nominal model absorbs free as well, where that explains more: of a
    large effect they show in the second order."""
    ranks = [0 if cause.directions is None else cause.directions.shape[1] for cause in causes]
    hidden = [cause.slot.columns for cause, rank in zip(causes, ranks, strict=True) if rank < len(cause.slot.columns)]
    left = solution.chi2
    if not hidden or not at.z @ at.z - left > LARGE**2 * left / at.dof:
        return unknowns, solution
    moved = [np.eye(len(solution.vector))[:, list(columns)] for columns in hidden]
    wider = unknowns._replace(directions=np.hstack([unknowns.directions, *moved]))
    evaluation = at.model.evaluate(problem.where, solution.vector)
    freed = _solved(problem, at.model, wider, solution.vector, evaluation)
    if freed.settled and left - freed.chi2 > HIDDEN * freed.chi2 / at.dof:
        return wider, freed
    return unknowns, solution


def directions_of(at: Tangent, causes: Sequence[Cause]) -> Float[np.ndarray, "full free"]:
    """The directions of the full vector (scaled) that are free: the nominal parameters, then the visible part of each
    effect."""
    columns = [np.eye(len(at.vector))[:, : at.model.nominal]]
    for cause in causes:
        if cause.directions is not None:
            block = np.zeros((len(at.vector), cause.directions.shape[1]))
            block[list(cause.slot.columns)] = cause.directions
            columns.append(block)
    return np.hstack(columns)


# A trial step whose residual overflows (a time constant that ran to nothing) is longer than any, and halved.
@np.errstate(over="ignore", invalid="ignore")
def _solved(
    problem: Problem,
    model: FullModel,
    unknowns: _Unknowns,
    vector: Float[np.ndarray, " full"],
    evaluation: Evaluation,
) -> _Solution:
    """Gauss-Newton over the directions and the terms' coefficients, from a full vector and its evaluation.

    Between two Jacobians the steps are made with the old one as long as they shrink quickly; the last Jacobian is that of
    the solution to within `UNBENT`. Of an effect that jumps with an input's sign the solution may lie at a jump: where no part
    of a step makes the residual shorter.
    """
    directions, terms = unknowns
    moved = directions.shape[1]
    mask = np.ones(len(terms))
    mask[: problem.readings.size] = np.repeat(problem.takes_part, 3)
    jumps, stuck = bool(np.any(directions[model.layout.jumping])), False
    curved, whole = bool(np.any(directions[model.layout.shapes])), float(np.linalg.norm(problem.rows(problem.readings)))
    extra, rounds = np.zeros(terms.shape[1]), 0
    while True:
        rounds += 1
        residual, jacobian = white_rows(model, problem, vector, evaluation)
        rows = np.concatenate([jacobian @ directions, terms], axis=1) * mask[:, None]
        inverse, normal = _inverses(rows)
        residual, sizes = residual - terms @ extra, [np.inf]
        while True:
            step = inverse @ (residual * mask)
            size = float(np.linalg.norm(rows @ step))
            small = max(SMALL_STEP * float(np.linalg.norm(residual * mask - rows @ step)), ROUNDING * whole, 1e-14)
            before, largest = (vector, extra), _WORSE * float(np.linalg.norm(residual * mask)) + small
            for _ in range(_MOST_HALVINGS):
                vector = before[0] + model.scales * (directions @ step[:moved])
                extra = before[1] + step[moved:]
                residual = white_residual(problem, vector, model.predict(problem.where, vector)) - terms @ extra
                if np.linalg.norm(residual * mask) <= largest:
                    break
                step = 0.5 * step
            else:
                stuck = jumps
            sizes.append(size)
            # A large change needs a new Jacobian in any case; at a jump no Jacobian is valid beyond it.
            bent = not jumps and len(sizes) == 2 and size >= UNBENT * whole
            if stuck or bent or size < small or not size < SLOW * sizes[-2] or len(sizes) > MOST_STEPS:
                break
        converged = size < small and (sizes[1] < small or (not curved and sizes[1] < UNBENT * whole))
        if stuck:
            vector, extra, converged = *before, True
            residual = white_residual(problem, vector, model.predict(problem.where, vector)) - terms @ extra
        if converged or not np.isfinite(size) or rounds == MOST_STEPS:
            break
        evaluation = model.evaluate(problem.where, vector)
    return _Solution(vector, residual, mask, rows, jacobian, normal, converged)


def _inverses(
    rows: Float[np.ndarray, "rows unknowns"],
) -> tuple[Float[np.ndarray, "unknowns rows"], Float[np.ndarray, "unknowns unknowns"]]:
    """Pseudo-inverse of a Jacobian, directions that the data hardly see left out, and the inverse of the normal matrix."""
    if rows.shape[0] >= rows.shape[1]:
        q, r = np.linalg.qr(rows)
        if surely_full_rank(r):
            triangle = dtrtri(r)[0]
            return triangle @ q.T, triangle @ triangle.T
    left, singular, right = np.linalg.svd(rows, full_matrices=False)
    seen = singular > _SEEN * singular[0]
    turned = right.T / np.maximum(singular, _SEEN * singular[0])
    return (right[seen].T / singular[seen]) @ left[:, seen].T, turned @ turned.T


def _fit(problem: Problem, model: FullModel, causes: list[Cause], unknowns: _Unknowns, solution: _Solution) -> Fit:
    """The fit by names: nominal parameters, then the coefficients of the effects, in base units."""
    white, moved = solution.residual * solution.takes_part, unknowns.directions.shape[1]
    # A column without an entry is, for example, the pitch error of an excluded setting.
    dof, chi2 = int(solution.takes_part.sum() - np.any(solution.jacobian, axis=0).sum()), float(white @ white)
    slots = [cause.slot for cause in causes]
    columns = [*range(model.nominal), *(column for slot in slots for column in slot.all_columns)]
    inverse = solution.inverse[:moved, :moved]
    if not problem.known:
        inverse = inverse * (chi2 / dof if dof > 0 else np.nan)
    spread = unknowns.directions[columns] * model.scales[columns][:, None]
    estimator = (solution.inverse @ solution.jacobian.T)[:moved]
    hidden = hidden_shifts(
        causes, unknowns.directions, solution.vector / model.scales, inverse, solution.whole, estimator
    )
    shifts = hidden[columns] * model.scales[columns][:, None]
    names = (*model.names, *(name for slot in slots for name in slot.names))
    extended = problem.with_links(*(link for slot in slots for link in slot.links)) if slots else problem
    return Fit(
        method="exact, extended by diagnosis" if slots else "exact",
        problem=extended,
        names=names,
        units=(*model.units, *(unit for slot in slots for unit in slot.units)),
        values=solution.vector[columns],
        covariance=spread @ inverse @ spread.T + shifts @ shifts.T,
        residuals=problem.unwhitened(solution.residual[: problem.readings.size]),
        chi2=chi2,
        dof=dof,
        code=Code.CONVERGED if solution.settled else Code.NOT_CONVERGED,
        rows=white,
        jacobian=solution.jacobian,
        vector=solution.vector,
        unidentifiable=shifts,
    )
