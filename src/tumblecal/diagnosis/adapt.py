"""The winning links inserted and fitted exactly."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

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
