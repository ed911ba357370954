"""Causes inserted in the model and fitted exactly."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.tangent import Tangent, white_residual, white_rows
from tumblecal.estimation.chain_programs import Evaluation
from tumblecal.estimation.fit import Code, Fit
from tumblecal.estimation.problem import Problem


MOST_STEPS = 40
SMALL_STEP = 1e-5
# Steps with an old Jacobian go on while each is at most this share of the one before.
SLOW = 0.2
# A Jacobian is still that of the solution when the prediction moved by less than this share since.
UNBENT = 3e-6
ROUNDING = 1e-14
# Directions of a fit that the data see by less than this share of the best seen are left where they are.
_SEEN = 1e-12
# A time constant may end between these shares and multiples of its start.
_SHAPE_RANGE = (0.1, 10.0)


class _Insertion(NamedTuple):
    """A problem with its faults undone, and what is fitted to it.

    `at`: where it starts from. `directions` (full, free): the moved directions of the full vector, scaled; `terms`
    (rows, terms): white signals with coefficients of their own.
    """

    problem: Problem
    at: Tangent
    causes: Sequence[Cause]
    directions: Float[np.ndarray, "full free"]
    terms: Float[np.ndarray, "rows terms"]


def fit_with(at: Tangent, causes: Sequence[Cause]) -> Fit:
    """Exact fit of the nominal parameters together with those of some causes.

    **Arguments:**

    - `at`: where the nominal parameters start from.
    - `causes`: faults are undone, outlying positions left out, effects and generic terms fitted.

    **Returns:** the fit, with the effects' links in its chain; its `code` says when Gauss-Newton did not settle.
    """
    problem, model = at.problem, at.model
    for cause in causes:
        problem = cause.undone(problem)
    # Only the nominal part of the start is taken: effects met earlier may not be among these causes.
    vector = model.with_nominal(at.vector[: model.nominal])
    evaluation = at.evaluation
    if problem.where is not at.problem.where or not np.array_equal(at.vector, vector):
        evaluation = model.evaluate(problem.where, vector)
    terms = np.zeros((len(at.residual), sum(len(cause.terms) for cause in causes)))
    for column, signal in enumerate(signal for cause in causes for signal in cause.terms):
        terms[: len(signal), column] = signal
    insertion = _Insertion(problem, at, causes, _directions(at, causes), terms)
    fit = _solved(insertion, vector, evaluation)
    for cause in causes:
        if cause.slot.shape:
            fit = _with_shape(insertion, fit, cause) or fit
    return fit


def _directions(at: Tangent, causes: Sequence[Cause]) -> Float[np.ndarray, "full free"]:
    columns = [np.eye(len(at.vector))[:, : at.model.nominal]]
    for cause in causes:
        if cause.directions is not None:
            block = np.zeros((len(at.vector), cause.directions.shape[1]))
            block[list(cause.slot.columns)] = cause.directions
            columns.append(block)
    return np.hstack(columns)


def _with_shape(insertion: _Insertion, fit: Fit, cause: Cause) -> Fit | None:
    """The same with the effect's shape parameter (a time constant) free; None when that does not settle in range."""
    model, columns = insertion.at.model, list(cause.slot.shape)
    wider = np.hstack([insertion.directions, np.eye(len(model.start))[:, columns]])
    evaluation = model.evaluate(insertion.problem.where, fit.vector)
    freed = _solved(insertion._replace(directions=wider), fit.vector, evaluation)
    ratio = freed.vector[columns] / model.start[columns]
    inside = np.all((ratio > _SHAPE_RANGE[0]) & (ratio < _SHAPE_RANGE[1]))
    return freed if freed.code.good and inside else None


def _solved(insertion: _Insertion, vector: Float[np.ndarray, " full"], evaluation: Evaluation) -> Fit:
    """Gauss-Newton over the directions and the terms' coefficients.

    Between two Jacobians the steps are made with the old one as long as they shrink quickly; the last Jacobian is that of
    the solution to within `UNBENT`.
    """
    problem, at, _, directions, terms = insertion
    model = at.model
    free = directions.shape[1]
    mask = np.ones(len(terms))
    mask[: problem.readings.size] = np.repeat(problem.takes_part, 3)
    curved, whole = bool(np.any(directions[model.shapes])), float(np.linalg.norm(problem.rows(problem.readings)))
    extra, rounds = np.zeros(terms.shape[1]), 0
    while True:
        rounds += 1
        residual, jacobian = white_rows(model, problem, vector, evaluation)
        rows = np.hstack([jacobian @ directions, terms]) * mask[:, None]
        left, singular, right = np.linalg.svd(rows, full_matrices=False)
        seen = singular > _SEEN * singular[0]
        inverse = (right[seen].T / singular[seen]) @ left[:, seen].T
        residual, sizes = residual - terms @ extra, [np.inf]
        while True:
            step = inverse @ (residual * mask)
            size = float(np.linalg.norm(rows @ step))
            small = max(SMALL_STEP * float(np.linalg.norm(residual * mask - rows @ step)), ROUNDING * whole, 1e-14)
            vector = vector + model.scales * (directions @ step[:free])
            extra = extra + step[free:]
            residual = white_residual(problem, vector, model.predict(problem.where, vector)) - terms @ extra
            sizes.append(size)
            if size < small or not size < SLOW * sizes[-2] or len(sizes) > MOST_STEPS:
                break
        converged = size < small and (sizes[1] < small or (not curved and sizes[1] < UNBENT * whole))
        if converged or not np.isfinite(size) or rounds == MOST_STEPS:
            break
        evaluation = model.evaluate(problem.where, vector)
    turned = right.T / np.maximum(singular, _SEEN * singular[0])
    return _fit(insertion, vector, residual, rows, mask, turned @ turned.T, converged)


def _fit(
    insertion: _Insertion,
    vector: Float[np.ndarray, " full"],
    residual: Float[np.ndarray, " rows"],
    jacobian: Float[np.ndarray, "rows parameters"],
    mask: Float[np.ndarray, " rows"],
    inverse: Float[np.ndarray, "parameters parameters"],
    converged: bool,
) -> Fit:
    """The fit by names: nominal parameters, then the coefficients of the effects, in base units."""
    problem, at, causes, directions, _ = insertion
    model, slots = at.model, [cause.slot for cause in causes if cause.slot.columns]
    white, free = residual * mask, directions.shape[1]
    dof, chi2 = int(mask.sum()) - jacobian.shape[1], float(white @ white)
    columns = [*range(model.nominal), *(column for slot in slots for column in slot.all_columns)]
    spread = directions[columns] * model.scales[columns][:, None]
    covariance = spread @ inverse[:free, :free] @ spread.T
    if not problem.known:
        covariance = covariance * (chi2 / dof if dof > 0 else np.nan)
    names = (*model.names, *(name for slot in slots for name in slot.names))
    extended = problem.with_links(*(link for slot in slots for link in slot.links)) if slots else problem
    finite = bool(np.all(np.isfinite(jacobian)) and np.isfinite(chi2))
    return Fit(
        method="exact, extended by diagnosis" if slots else "exact",
        problem=extended,
        names=names,
        units=(*model.units, *(unit for slot in slots for unit in slot.units)),
        values=vector[columns],
        covariance=covariance,
        residuals=problem.unwhitened(residual[: problem.readings.size]),
        chi2=chi2,
        dof=dof,
        code=Code.CONVERGED if converged and finite else Code.NOT_CONVERGED,
        rows=white,
        jacobian=jacobian,
        vector=vector,
    )
