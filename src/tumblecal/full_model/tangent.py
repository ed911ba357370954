"""A problem linearised at a point of the full model: its residual in the space that the nominal model does not reach."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dposv  # type: ignore[attr-defined]

from tumblecal.chain import followings_of
from tumblecal.estimation.chain_programs import Evaluation
from tumblecal.estimation.contradicted import column_space
from tumblecal.estimation.identifiability import RANK_TOLERANCE, surely_full_rank
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.priors import LARGE
from tumblecal.ground.showing import brief


_MOST_ROBUST_STEPS = 15
# Share of the largest entry of a Cholesky triangle's diagonal above which the least is no rounding.
_SURELY_DETERMINED = 1e-5
# Steps that leave so many times what the best left have run away.
_RUN_AWAY = 10.0


@dataclass(frozen=True)
class Tangent:
    """A linearisation of a problem at a full vector.

    `residual` (rows): white measured minus predicted, priors' rows last, plus the contribution of the effects in the vector.
    `of_effects`: that contribution. `jacobian`: white, by the scaled full vector.
    """

    __repr__ = brief

    problem: Problem
    model: FullModel
    vector: Float[np.ndarray, " full"]
    evaluation: Evaluation
    residual: Float[np.ndarray, " rows"]
    of_effects: Float[np.ndarray, " rows"]
    jacobian: Float[np.ndarray, "rows full"]

    @cached_property
    def _spaces(self) -> tuple[Float[np.ndarray, "rows nu"], Float[np.ndarray, "rows rank"]]:
        return unreachable(self.jacobian[:, : self.model.nominal])

    @property
    def basis(self) -> Float[np.ndarray, "rows nu"]:
        """Orthonormal basis of the residual space of the nominal model."""
        return self._spaces[0]

    @property
    def reached(self) -> Float[np.ndarray, "rows rank"]:
        """Orthonormal basis of its column space."""
        return self._spaces[1]

    @property
    def dof(self) -> int:
        """Dimension of the space that the nominal model cannot reach."""
        return self.basis.shape[1]

    @cached_property
    def z(self) -> Float[np.ndarray, " nu"]:
        """The residual's part in that space."""
        return self.basis.T @ self.residual

    @cached_property
    def responses(self) -> Float[np.ndarray, "nu positions 3"]:
        """Response of the residual space to a unit change (g) of every single reading."""
        rows, whitening = self.basis[: self.problem.readings.size], np.asarray(self.problem.whitening)
        each = rows * whitening[:, None] if whitening.ndim == 1 else self.problem.whitening_matrix.T @ rows
        return each.T.reshape(self.dof, -1, 3)

    @cached_property
    def whole_responses(self) -> Float[np.ndarray, "positions 3"]:
        """White size of a unit change (g) of every single reading."""
        if not self.problem.correlated:
            return np.asarray(self.problem.whitening).reshape(-1, 3)
        return np.linalg.norm(self.problem.whitening_matrix, axis=0).reshape(-1, 3)

    @cached_property
    def varying(self) -> Float[np.ndarray, "rows full"]:
        """The Jacobian without the contribution of a constant temperature to effects of temperature, if the nominal model
        absorbs it completely. The origin of the temperature scale is a convention, and its contribution is bias and scale
        factor."""
        temperature = self.problem.where.temperature_degc
        columns = self.model.layout.thermal
        if temperature is None or not columns:
            return self.jacobian
        # Parameters that follow temperature are given at their reference.
        followings = followings_of(self.model.nominal_chain)
        constant_degc = float(followings[0].reference_degc) if followings else np.mean(temperature)
        steady = replace(self.problem.where, temperature_degc=np.full_like(temperature, constant_degc))
        constant = white_rows(self.model, self.problem, self.vector, self.model.evaluate(steady, self.vector))[1]
        constant = constant[:, columns]
        nominal = column_space(self.jacobian[:, : self.model.nominal])
        left = np.linalg.norm(constant - nominal @ (nominal.T @ constant), axis=0)
        reached = left <= RANK_TOLERANCE * np.linalg.norm(constant, axis=0)
        varying, whole = self.jacobian.copy(), self.jacobian[:, columns]
        varied = np.linalg.norm(whole - constant, axis=0) > RANK_TOLERANCE * np.linalg.norm(whole, axis=0)
        varying[:, columns] -= constant * (reached & varied)
        return varying

    @cached_property
    def rough_level(self) -> float:
        """Standard deviation of the white rows: 1 for known noise, otherwise from the median size of the residuals, without
        the effects in the vector or with them."""
        if self.problem.known:
            return 1.0
        left = [self.z]
        if np.any(self.of_effects):
            left.append(self.z - self.basis.T @ self.of_effects)
        return min(float(1.4826 * np.median(np.abs(self.basis @ rest))) for rest in left) or 1e-12

    def much_more_than(self, sigma: float) -> bool:
        """Whether the residual is much larger than noise of this standard deviation. The median estimates the noise if an
        unknown effect is present."""
        return bool(self.z @ self.z > LARGE**2 * min(sigma, self.rough_level) ** 2)


def tangent(model: FullModel, problem: Problem, vector: Float[np.ndarray, " full"]) -> Tangent:
    """The problem linearised at a full vector (physical units); effects in it may be non-zero."""
    evaluation = model.evaluate(problem.where, vector)
    residual, jacobian = white_rows(model, problem, vector, evaluation)
    # Effects already in the vector are put back: the residual is what the nominal model alone leaves.
    amplitudes = model.layout.amplitudes
    of_effects = jacobian[:, amplitudes] @ (vector[amplitudes] / model.scales[amplitudes])
    return Tangent(problem, model, vector, evaluation, residual + of_effects, of_effects, jacobian)


def unreachable(
    jacobian: Float[np.ndarray, "rows columns"],
) -> tuple[Float[np.ndarray, "rows nu"], Float[np.ndarray, "rows rank"]]:
    """Orthonormal bases of the residual space and of the column space."""
    q, r = np.linalg.qr(jacobian, mode="complete")
    count = min(jacobian.shape)
    if len(r) > jacobian.shape[1] and surely_full_rank(r[:count]):
        return q[:, count:], q[:, :count]
    left, singular, _ = np.linalg.svd(r[:count])
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
    turned = q[:, :count] @ left
    return np.hstack([turned[:, rank:], q[:, count:]]), turned[:, :rank]


def white_rows(
    model: FullModel, problem: Problem, vector: Float[np.ndarray, " full"], evaluation: Evaluation
) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows full"]]:
    """White residual (measured minus predicted) and Jacobian by the scaled full vector, priors' rows last."""
    jacobian = problem.rows(evaluation.jacobian)
    if problem.with_prior:
        root = problem.prior_root
        prior = np.zeros((len(root), jacobian.shape[1]))
        prior[:, : model.nominal] = root * model.scales[: model.nominal]
        jacobian = np.vstack([jacobian, prior])
    return white_residual(problem, vector, evaluation.predicted), jacobian


def white_residual(
    problem: Problem, vector: Float[np.ndarray, " full"], predicted: Float[np.ndarray, "positions 3"]
) -> Float[np.ndarray, " rows"]:
    """White measured minus predicted, priors' rows last."""
    off = problem.prior_root @ (problem.prior_mean - vector[: len(problem.prior_mean)])
    return np.concatenate([problem.rows(problem.readings - predicted), off])


@np.errstate(over="ignore", invalid="ignore")
def robust_start(model: FullModel, problem: Problem) -> Float[np.ndarray, " full"]:
    """Robust nominal parameters, for data with a few gross errors.

    Iteratively reweighted least squares with the redescending weight of Geman and McClure (1987) on each position's residual
    norm, its scale following three times the median. The Jacobian stays that of `FullModel.at_start`: over small angles it
    hardly changes, and the exact fits correct the remainder. Parameters of one position each are eliminated: for any weight of
    the position, they absorb the same directions of its residual. If the steps diverge (unknown attitudes, with an effect as
    large as the inputs), the best of them is used.
    """
    at_start = model.at_start(problem.where)
    vector, predicted, weights = model.start, at_start.predicted, 1.0 / problem.sd
    nominal = slice(0, model.nominal)
    jacobian = (at_start.jacobian * weights[:, :, None]).reshape(-1, model.nominal)
    known = problem.prior_root
    stated = known * model.scales[nominal]
    own = model.layout.of_positions & ~np.any(stated, axis=0)
    common, stated, step = jacobian[:, ~own], stated[:, ~own], np.zeros(model.nominal)
    inverse, best, least = None, vector, np.inf
    if np.any(own):
        taken_up, triangle = np.linalg.qr(jacobian[:, own])
        common, inverse = common - taken_up @ (taken_up.T @ common), np.linalg.solve(triangle, taken_up.T)
    for step_number in range(_MOST_ROBUST_STEPS):
        residual = (problem.readings - predicted) * weights
        size = np.sqrt(np.vecdot(residual, residual))
        ordered = np.sort(size)
        middle = 0.5 * float(ordered[(len(size) - 1) // 2] + ordered[len(size) // 2])
        if not middle < _RUN_AWAY * least:
            return best
        if middle < least:
            best, least = vector, middle
        scale = 3.0 * middle + 1e-12 * max(1.0, float(ordered[-1]))
        rows = np.repeat(1.0 / (1.0 + (size / scale) ** 2), 3)
        trusted = common * rows[:, None]
        # Rough steps: normal equations will do.
        towards = trusted.T @ (residual.ravel() * rows) + stated.T @ (known @ (problem.prior_mean - vector[nominal]))
        step[~own] = _solved(trusted.T @ trusted + stated.T @ stated, towards)
        if inverse is not None:
            step[own] = inverse @ (residual.ravel() - jacobian[:, ~own] @ step[~own])
        vector = vector.copy()
        vector[nominal] += model.scales[nominal] * step
        if step_number > 3 and np.linalg.norm(jacobian @ step) < 1e-3 * middle * np.sqrt(len(rows)):
            break
        predicted = model.predict(problem.where, vector)
    return vector


def _solved(normal: Float[np.ndarray, "free free"], towards: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
    """The step of normal equations: the shortest where they do not determine it."""
    triangle, step, failed = dposv(normal, towards)
    roots = np.diag(triangle)
    if failed or not np.min(roots) > _SURELY_DETERMINED * np.max(roots):
        return np.linalg.lstsq(normal, towards, rcond=1e-14)[0]
    return step
