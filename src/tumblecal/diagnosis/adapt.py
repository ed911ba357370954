"""The winning links inserted and fitted exactly, and the gain measured where nothing was tuned."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import stats

from tumblecal.chain import Where
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.linear import Weighting, weighted, weighted_residual
from tumblecal.diagnosis.model import Evaluation, Model, Slot
from tumblecal.diagnosis.repair import Repaired, repaired


MOST_STEPS = 40
SMALL_STEP = 1e-5
# Steps with an old Jacobian go on while each is at most this share of the one before.
SLOW = 0.2
# A Jacobian is still that of the solution when the prediction moved by less than this share since.
UNBENT = 3e-6
ROUNDING = 1e-14
RANK_TOLERANCE = 1e-12
# A time constant may end between these shares and multiples of its start.
_SHAPE_RANGE = (0.1, 10.0)


@dataclass(frozen=True)
class Fit:
    """A nominal or extended fit.

    `directions` (full, free): the moved directions of the full vector, scaled; `extra` coefficients of generic terms
    follow them in `jacobian` and `covariance`. `residual`, `jacobian`: weighted rows, zero for positions left out.
    `residuals` (positions, 3): measured minus predicted, g. `sigma`: residual sd in weighted units.
    """

    vector: Float[np.ndarray, " full"]
    extra: Float[np.ndarray, " generic"]
    directions: Float[np.ndarray, "full free"]
    residual: Float[np.ndarray, " rows"]
    jacobian: Float[np.ndarray, "rows parameters"]
    covariance: Float[np.ndarray, "parameters parameters"]
    residuals: Float[np.ndarray, "positions 3"]
    keep: Bool[np.ndarray, " positions"]
    chi2: float
    dof: int
    sigma: float
    converged: bool

    @property
    def parameters(self) -> int:
        """Number of fitted parameters."""
        return self.jacobian.shape[1]

    @property
    def rms(self) -> float:
        """Root mean square of the residuals of the positions that took part, g."""
        return float(np.sqrt(np.mean(self.residuals[self.keep] ** 2)))

    def vector_sd(self, model: Model) -> Float[np.ndarray, " full"]:
        """Standard deviations of the full vector's entries, physical units (0 where not fitted)."""
        free = self.directions.shape[1]
        inner = self.directions @ self.covariance[:free, :free] @ self.directions.T
        return np.sqrt(np.maximum(np.diag(inner), 0.0)) * model.scales


def fit_members(
    model: Model,
    where: Where,
    readings: Float[np.ndarray, "positions 3"],
    how: Weighting,
    start: Float[np.ndarray, " full"],
    members: list[Candidate],
    evaluation: Evaluation | None = None,
) -> Fit:
    """Exact fit of the nominal parameters together with those of some causes.

    **Arguments:**

    - `start`: full vector whose nominal part is started from, physical units.
    - `members`: the causes; faults are undone, outlying positions left out, effects and generic terms fitted.
    - `evaluation`: that at `start`, where there is one.

    **Returns:** the fit; `converged` is False when Gauss-Newton did not settle.
    """
    data = repaired(where, readings, members)
    # Only the nominal part of the start is taken: effects found earlier may not be among these causes.
    nominal = np.concatenate([start[: model.nominal], model.start[model.nominal :]])
    if evaluation is None or data.where is not where or not np.array_equal(start, nominal):
        evaluation = model.evaluate(data.where, nominal)
    effects = [one for one in members if one.slot is not None]
    terms = [one.rows for one in members if one.rows is not None]
    generic_rows = np.stack([np.zeros(readings.size), *terms], axis=1)[:, 1:]
    directions = _directions(model, effects)
    fit = _solve(model, data, how, nominal, evaluation, directions, generic_rows)
    for one in effects:
        if one.slot is not None and one.slot.shape:
            fit = _with_shape(model, data, how, fit, one.slot, directions, generic_rows) or fit
    return fit


def _directions(model: Model, effects: list[Candidate]) -> np.ndarray:
    columns = [np.eye(len(model.order))[:, : model.nominal]]
    for one in effects:
        assert one.slot is not None and one.directions is not None
        block = np.zeros((len(model.order), one.directions.shape[1]))
        block[list(one.slot.columns)] = one.directions
        columns.append(block)
    return np.hstack(columns)


def _with_shape(
    model: Model, data: Repaired, how: Weighting, fit: Fit, slot: Slot, directions: np.ndarray, generic_rows: np.ndarray
) -> Fit | None:
    """The same with the effect's shape parameter (a time constant) free; None when that does not settle in range."""
    columns = list(slot.shape)
    wider = np.hstack([directions, np.eye(len(model.order))[:, columns]])
    freed = _solve(model, data, how, fit.vector, model.evaluate(data.where, fit.vector), wider, generic_rows)
    ratio = freed.vector[columns] / model.start[columns]
    inside = np.all((ratio > _SHAPE_RANGE[0]) & (ratio < _SHAPE_RANGE[1]))
    return freed if freed.converged and inside else None


def _solve(
    model: Model,
    data: Repaired,
    how: Weighting,
    vector: np.ndarray,
    evaluation: Evaluation,
    directions: np.ndarray,
    generic_rows: np.ndarray,
) -> Fit:
    """Gauss-Newton over the directions and the generic coefficients.

    Between two Jacobians the steps are made with the old one as long as they shrink quickly; the last Jacobian is that of
    the solution to within `UNBENT`.
    """
    free, count = directions.shape[1], data.readings.size
    mask = np.ones(count + int(np.count_nonzero(how.prior_weights)))
    mask[:count] = np.repeat(data.keep, 3)
    generic = np.zeros((len(mask), generic_rows.shape[1]))
    generic[: len(generic_rows)] = generic_rows
    curved, whole = bool(np.any(directions[model.shapes])), float(np.linalg.norm(how.rows(data.readings)))
    extra, rounds = np.zeros(generic.shape[1]), 0
    while True:
        rounds += 1
        residual, jacobian = weighted(model, evaluation, data.readings, how, vector)
        rows = np.hstack([jacobian @ directions, generic]) * mask[:, None]
        left, singular, right = np.linalg.svd(rows, full_matrices=False)
        seen = singular > RANK_TOLERANCE * singular[0]
        inverse = (right[seen].T / singular[seen]) @ left[:, seen].T
        residual, sizes = residual - generic @ extra, [np.inf]
        while True:
            step = inverse @ (residual * mask)
            size = float(np.linalg.norm(rows @ step))
            small = max(SMALL_STEP * float(np.linalg.norm(residual * mask - rows @ step)), ROUNDING * whole, 1e-14)
            vector = vector + model.scales * (directions @ step[:free])
            extra = extra + step[free:]
            predicted = model.predict(data.where, vector)
            residual = weighted_residual(model, predicted, data.readings, how, vector) - generic @ extra
            sizes.append(size)
            if size < small or not size < SLOW * sizes[-2] or len(sizes) > MOST_STEPS:
                break
        converged = size < small and (sizes[1] < small or (not curved and sizes[1] < UNBENT * whole))
        if converged or not np.isfinite(size) or rounds == MOST_STEPS:
            break
        evaluation = model.evaluate(data.where, vector)
    residual = residual * mask
    dof, chi2 = int(mask.sum()) - rows.shape[1], float(residual @ residual)
    sigma = float(np.sqrt(chi2 / dof)) if dof > 0 else float("nan")
    turned = right.T / np.maximum(singular, RANK_TOLERANCE * singular[0])
    signal = (generic @ extra)[:count]
    signal = signal if how.whiten is None or not len(extra) else np.linalg.solve(how.whiten, signal)
    explained = signal.reshape(-1, 3) / how.weights
    return Fit(
        vector=vector,
        extra=extra,
        directions=directions,
        residual=residual,
        jacobian=rows,
        covariance=turned @ turned.T * (1.0 if how.known else sigma**2),
        residuals=data.readings - predicted - explained,
        keep=data.keep,
        chi2=chi2,
        dof=dof,
        sigma=sigma,
        converged=converged and bool(np.all(np.isfinite(rows)) and np.isfinite(chi2)),
    )


@dataclass(frozen=True)
class Gain:
    """What the extended model gains over the nominal one.

    Cross-validated numbers are root mean squares of predictions of positions (or runs) that took no part in the fit,
    over the same positions for both, g; `cv_gain_sd_g` is the standard error of their difference. `cv_rms_after_g` is with
    the causes chosen anew without each fold where `cv_same_causes`, the share of folds that chose the same ones, is a
    number, else with the causes kept, as `cv_rms_kept_g` always is. The `fresh` ones are what a new measurement at the
    same positions would show.
    """

    rms_before_g: float
    rms_after_g: float
    cv_rms_before_g: float
    cv_rms_after_g: float
    cv_rms_kept_g: float
    cv_same_causes: float | None
    cv_gain_sd_g: float
    cv_kind: str
    fresh_rms_before_g: float
    fresh_rms_after_g: float
    fresh_gain_sd_g: float
    delta_bic: float
    f_statistic: float | None
    f_p_value: float | None


def gain(
    before: Fit,
    after: Fit,
    how: Weighting,
    groups: Int[np.ndarray, " positions"],
    kind: str,
    nested: tuple[Float[np.ndarray, "positions 3"], Bool[np.ndarray, " folds"]] | None = None,
) -> Gain:
    """Compare two fits of the same data.

    **Arguments:**

    - `before`, `after`: nominal and extended.
    - `groups`: the fold of each position; `kind` names the folds in words.
    - `nested`: errors with the causes chosen anew in every fold, and where they were the same (`nested_left_out`).
    """
    both = before.keep & after.keep
    judged = both & (groups >= 0)
    errors_before = left_out(before, how, groups)[judged]
    errors_kept = left_out(after, how, groups)[judged]
    errors_after = errors_kept if nested is None else nested[0][judged]
    cv_before, cv_after, cv_kept = (
        float(np.sqrt(np.mean(errors**2))) for errors in (errors_before, errors_after, errors_kept)
    )
    difference = np.mean(errors_before**2 - errors_after**2, axis=1)
    spread = float(np.std(difference) / np.sqrt(len(difference)))
    fresh_before, fresh_after, fresh_spread = _fresh(before, after, how, both)
    more = after.parameters - before.parameters + 3 * int(np.sum(before.keep & ~after.keep))
    count = before.residuals.size
    if how.known:
        delta = after.chi2 - before.chi2 + more * np.log(count)
    else:
        delta = count * np.log(max(after.chi2, 1e-300) / before.chi2) + more * np.log(count)
    statistic = p_value = None
    if more > 0 and after.dof > 0:
        statistic = (before.chi2 - after.chi2) / more / (1.0 if how.known else after.chi2 / after.dof)
        p_value = float(stats.chi2.sf(statistic * more, more) if how.known else stats.f.sf(statistic, more, after.dof))
    return Gain(
        rms_before_g=before.rms,
        rms_after_g=after.rms,
        cv_rms_before_g=cv_before,
        cv_rms_after_g=cv_after,
        cv_rms_kept_g=cv_kept,
        cv_same_causes=None if nested is None else float(np.mean(nested[1])),
        cv_gain_sd_g=spread / max(cv_before + cv_after, 1e-300),
        cv_kind=kind,
        fresh_rms_before_g=fresh_before,
        fresh_rms_after_g=fresh_after,
        fresh_gain_sd_g=fresh_spread,
        delta_bic=float(delta),
        f_statistic=None if statistic is None else float(statistic),
        f_p_value=p_value,
    )


def _fresh(before: Fit, after: Fit, how: Weighting, both: np.ndarray) -> tuple[float, float, float]:
    """What new readings at the same positions would show of the two fits, and the standard error of the gain, g.

    The residuals' mean square plus twice the noise variance times the leverage (Mallows 1973); the noise is that which
    the extended model leaves.
    """
    squares = []
    for fit in (before, after):
        q, _ = np.linalg.qr(fit.jacobian)
        leverage = np.sum(q[: how.weights.size] ** 2, axis=1).reshape(-1, 3)
        noise = (1.0 if how.known else after.sigma) / how.weights
        squares.append(np.mean(fit.residuals**2 + 2 * leverage * noise**2, axis=1)[both])
    first, second = (float(np.sqrt(np.mean(one))) for one in squares)
    spread = float(np.std(squares[0] - squares[1]) / np.sqrt(len(squares[0])))
    return first, second, spread / max(first + second, 1e-300)


def left_out(fit: Fit, how: Weighting, groups: Int[np.ndarray, " positions"]) -> Float[np.ndarray, "positions 3"]:
    """Prediction errors of every fold from a fit to the others, g. Positions of the group -1 are in every fit: 0."""
    q, _ = np.linalg.qr(fit.jacobian)
    errors = np.zeros(how.weights.size)
    rows_of = np.repeat(groups, 3)
    folds = [np.flatnonzero(rows_of == fold) for fold in np.unique(groups[groups >= 0])]
    for size in {len(rows) for rows in folds}:
        rows = np.array([one for one in folds if len(one) == size])
        errors[rows] = fold_errors(q[rows], fit.residual[rows])
    # With correlated noise the error stands in whitened units; its scale is that of one reading.
    return errors.reshape(-1, 3) / how.weights


def fold_errors(
    q: Float[np.ndarray, "*folds rows parameters"], residual: Float[np.ndarray, "*folds rows"]
) -> Float[np.ndarray, "*folds rows"]:
    """What a linear fit to all other rows leaves of a fold's rows, from the fit to all: residual by (1 - leverage).

    Parameters that only the fold itself determines (the pitch error of a left-out run) are fitted to it first; the
    error is then that of the rest, scaled for the directions so lost.

    **Arguments:**

    - `q`: the fold's rows of an orthonormal basis of the whole design; `residual`: of the fit to all.
    """
    size = q.shape[-2]
    values, vectors = np.linalg.eigh(np.eye(size) - q @ np.swapaxes(q, -1, -2))
    free = values > 1e-8
    along = np.einsum("...ij,...i->...j", vectors, residual)
    along = np.divide(along, values, out=np.zeros_like(along), where=free)
    scale = np.sqrt(size / np.maximum(np.sum(free, axis=-1, keepdims=True), 1))
    return np.einsum("...ij,...j->...i", vectors, along) * scale
