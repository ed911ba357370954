"""The data seen from a fitted nominal model: what is left in the space that the nominal model cannot reach."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis.model import Evaluation, Model


# A nominal direction whose singular value is below this share of the largest counts as not determined.
RANK_TOLERANCE = 1e-9
_MOST_ROBUST_STEPS = 15


@dataclass(frozen=True)
class Weighting:
    """How residuals are counted.

    `weights` (positions, 3): 1/sd, or a common unit where the noise is not known. `whiten`, where given, is applied
    to the stacked weighted rows instead (correlated noise). `known`: whether the weighted noise has variance one.
    `prior_weights`, `prior_mean`: Gaussian prior on the nominal parameters (0: none).
    """

    weights: Float[np.ndarray, "positions 3"]
    known: bool
    prior_mean: Float[np.ndarray, " nominal"]
    prior_weights: Float[np.ndarray, " nominal"]
    whiten: Float[np.ndarray, "rows rows"] | None = None

    def rows(self, values: Float[np.ndarray, "positions 3 *more"]) -> np.ndarray:
        """Weighted rows of values given for every reading."""
        weighted = values * self.weights.reshape(*self.weights.shape, *([1] * (values.ndim - 2)))
        stacked = weighted.reshape(weighted.shape[0] * 3, *values.shape[2:])
        return stacked if self.whiten is None else self.whiten @ stacked


@dataclass(frozen=True)
class Linear:
    """A linearisation at a full vector.

    `residual` (rows): weighted measured minus predicted, priors' rows last. `jacobian`: weighted, by the scaled full
    vector. `basis` (rows, nu): orthonormal, spans what the nominal
    model cannot reach; `reached` (rows, rank): the same for what it can.
    """

    vector: Float[np.ndarray, " full"]
    evaluation: Evaluation
    residual: Float[np.ndarray, " rows"]
    jacobian: Float[np.ndarray, "rows full"]
    basis: Float[np.ndarray, "rows nu"]
    reached: Float[np.ndarray, "rows rank"]

    @property
    def dof(self) -> int:
        """Dimension of the space that the nominal model cannot reach."""
        return self.basis.shape[1]

    @property
    def z(self) -> Float[np.ndarray, " nu"]:
        """The residual's part in that space."""
        return self.basis.T @ self.residual


def linearise(
    model: Model, where: Where, readings: Float[np.ndarray, "positions 3"], how: Weighting, vector: np.ndarray
) -> Linear:
    """Residual, Jacobian and unreachable space at a full vector (physical units); effects in it may be non-zero."""
    evaluation = model.evaluate(where, vector)
    residual, jacobian = weighted(model, evaluation, readings, how, vector)
    # Effects already in the vector are put back: the residual is what the nominal model alone leaves.
    amplitudes = model.amplitudes
    residual = residual + jacobian[:, amplitudes] @ (vector[amplitudes] / model.scales[amplitudes])
    basis, reached = unreachable(jacobian[:, : model.nominal])
    return Linear(vector, evaluation, residual, jacobian, basis, reached)


def unreachable(
    jacobian: Float[np.ndarray, "rows columns"],
) -> tuple[Float[np.ndarray, "rows nu"], Float[np.ndarray, "rows rank"]]:
    """Orthonormal bases of what the columns do not span, and of what they span."""
    q, r = np.linalg.qr(jacobian, mode="complete")
    count = min(jacobian.shape)
    left, singular, _ = np.linalg.svd(r[:count])
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
    turned = q[:, :count] @ left
    return np.hstack([turned[:, rank:], q[:, count:]]), turned[:, :rank]


def weighted(
    model: Model, evaluation: Evaluation, readings: np.ndarray, how: Weighting, vector: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted residual and Jacobian rows, priors' rows last."""
    residual = weighted_residual(model, evaluation.predicted, readings, how, vector)
    jacobian = how.rows(evaluation.jacobian)
    stated = np.flatnonzero(how.prior_weights)
    if len(stated):
        prior = np.zeros((len(stated), jacobian.shape[1]))
        prior[np.arange(len(stated)), stated] = how.prior_weights[stated] * model.scales[stated]
        jacobian = np.vstack([jacobian, prior])
    return residual, jacobian


def weighted_residual(
    model: Model, predicted: np.ndarray, readings: np.ndarray, how: Weighting, vector: np.ndarray
) -> np.ndarray:
    """Weighted measured minus predicted, priors' rows last."""
    stated = np.flatnonzero(how.prior_weights)
    off = how.prior_weights[stated] * (how.prior_mean[stated] - vector[stated])
    return np.concatenate([how.rows(readings - predicted), off])


def robust_start(
    model: Model,
    where: Where,
    readings: Float[np.ndarray, "positions 3"],
    weights: Float[np.ndarray, "positions 3"],
    at_start: Evaluation,
) -> Float[np.ndarray, " full"]:
    """Nominal parameters that a few grossly wrong positions do not spoil.

    Iteratively reweighted least squares with the redescending weight of Geman and McClure (1987) on each position's
    residual norm, its scale following three times the median. The Jacobian stays that of the start, `at_start`: over
    small angles it hardly changes, and what is left is put right by the exact fits.
    """
    vector, predicted = model.start, at_start.predicted
    nominal = slice(0, model.nominal)
    jacobian = (at_start.jacobian[:, :, nominal] * weights[:, :, None]).reshape(-1, model.nominal)
    for step_number in range(_MOST_ROBUST_STEPS):
        residual = (readings - predicted) * weights
        size = np.linalg.norm(residual, axis=1)
        scale = 3.0 * np.median(size) + 1e-12 * np.max(size, initial=1.0)
        rows = np.repeat(1.0 / (1.0 + (size / scale) ** 2), 3)
        trusted = jacobian * rows[:, None]
        # Rough steps: normal equations will do.
        step, *_ = np.linalg.lstsq(trusted.T @ trusted, trusted.T @ (residual.ravel() * rows), rcond=1e-14)
        vector = vector.copy()
        vector[nominal] += model.scales[nominal] * step
        if step_number > 3 and np.linalg.norm(jacobian @ step) < 1e-3 * np.median(size) * np.sqrt(len(rows)):
            break
        predicted = model.predict(where, vector)
    return vector
