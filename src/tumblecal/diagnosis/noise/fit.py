"""The noise fitted to the residuals by restricted maximum likelihood, so that all later tests are correct again."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.noise.models import Family, NoiseModel
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.tangent import Tangent
from tumblecal.noise.covariance import Covariance


_STEPS = 8


@dataclass(frozen=True)
class _Residuals:
    """White rows of the readings (no priors) and their systematic part: `fitted` spans the nominal model and the causes;
    `rows` is the residual without their faults."""

    rows: Float[np.ndarray, " readings"]
    fitted: Float[np.ndarray, "readings columns"]

    def weighted(
        self, white: Float[np.ndarray, " readings"]
    ) -> tuple[Float[np.ndarray, " readings"], Float[np.ndarray, "readings columns"]]:
        """Residual of the rows multiplied by `white`, and the orthonormal basis of the fit."""
        q, _ = np.linalg.qr(self.fitted * white[:, None])
        rows = self.rows * white
        return rows - q @ (q.T @ rows), q


def corrected(
    at: Tangent, moved: Float[np.ndarray, " nu"], q: Float[np.ndarray, "nu rank"], best: NoiseModel
) -> tuple[Problem, str]:
    """The problem under a noise alternative, and the alternative in words.

    The level of the noise counts as unknown from then on: it was estimated.

    **Arguments:**

    - `moved`: the residual in the residual space after the faults of a set of causes are undone.
    - `q`: basis of the signals of the set's effects.
    """
    problem, count = at.problem, at.problem.readings.size
    residuals = _Residuals((at.basis @ moved)[:count], np.hstack([at.reached, at.basis @ q])[:count])
    relative, words = _fitted(problem, residuals, best)
    # What a reading shares with others leaves its own sd as it was.
    sd = problem.sd * relative.sd.reshape(-1, 3) if relative.form == "rows" else problem.sd
    return problem.with_noise(problem.noise.compounded(relative), known=False, sd=sd), words


def _fitted(problem: Problem, residuals: _Residuals, best: NoiseModel) -> tuple[Covariance, str]:
    """Covariance of the white rows, and its description."""
    count = len(residuals.rows)
    if best.tail is not None:
        return Covariance(1.0 / _tail_weights(residuals, best.tail), "rows"), best.words
    if best.family is not None:
        level, sigma = _refined(residuals, best.family, best.level)
        return best.family.covariance(level), best.family.words(level, sigma)
    if best.groups is not None:
        ratio = _group_sd(residuals, best.groups.of_rows)
        words = f"sd {best.groups.compared(ratio / min(ratio))}"
        if problem.known:
            words = f"the dispersion between positions is the stated sd times {best.groups.listed(ratio)}"
        return Covariance(ratio[best.groups.of_rows] ** 2, "rows"), words
    if best.covariance.form == "rows" and np.ptp(best.covariance.values) == 0:
        rest, q = residuals.weighted(np.ones(count))
        level = float(np.sqrt(rest @ rest / (count - q.shape[1])))
        repeat = level * float(np.median(problem.sd)) * 1e3
        words = f"every sd times {level:.2g}" + (f": the positions repeat to {repeat:.2g} mg" if problem.known else "")
        return Covariance(np.full(count, level**2), "rows"), words
    return best.covariance, best.words


def _refined(residuals: _Residuals, family: Family, level: float) -> tuple[float, float]:
    """The level of the highest restricted likelihood between the neighbours of the best one tried, and the sd there."""
    from scipy.optimize import minimize_scalar  # a third of a second, which data whose noise is right do without

    levels = sorted(family.levels)
    number = levels.index(level)
    low = levels[number - 1] if number else levels[0] / 3
    high = levels[number + 1] if number + 1 < len(levels) else (0.99 if level < 1 else 5 * level)

    def fitted(log_level: float) -> tuple[float, float, int]:
        """Half the logarithm of the determinant, the residual sum of squares and its degrees of freedom."""
        covariance = family.covariance(float(np.exp(log_level)))
        rows = covariance.whiten(residuals.rows)
        q, r = np.linalg.qr(covariance.whiten(residuals.fitted))
        rest = rows - q @ (q.T @ rows)
        log_det = covariance.half_log_det + float(np.sum(np.log(np.abs(np.diag(r)) + 1e-300)))
        return log_det, max(float(rest @ rest), 1e-300), len(rows) - q.shape[1]

    def cost(log_level: float) -> float:
        log_det, residual_ss, free = fitted(log_level)
        return log_det + 0.5 * free * float(np.log(residual_ss))

    least: Any = minimize_scalar(cost, bounds=(np.log(low), np.log(high)), method="bounded", options={"xatol": 0.02})
    _, residual_ss, free = fitted(least.x)
    return float(np.exp(least.x)), float(np.sqrt(residual_ss / free))


def _group_sd(residuals: _Residuals, of_rows: Int[np.ndarray, " rows"]) -> Float[np.ndarray, " groups"]:
    """Each group's sd in white units by restricted maximum likelihood (Patterson and Thompson 1971), by iteration."""
    variance = np.ones(int(of_rows.max()) + 1)
    for _ in range(_STEPS):
        rows, q = residuals.weighted(1.0 / np.sqrt(variance[of_rows]))
        residual_ss, free = (np.bincount(of_rows, own) for own in (rows**2, 1.0 - np.sum(q**2, axis=1)))
        variance *= np.maximum(residual_ss / np.maximum(free, 1e-12), 1e-12)
    return np.sqrt(variance)


def _tail_weights(residuals: _Residuals, tail: float) -> Float[np.ndarray, " readings"]:
    """Weights of a Student's t fit: readings far out count less (Lange, Little and Taylor 1989)."""
    count = len(residuals.rows)
    weights = np.ones(count)
    for _ in range(4 * _STEPS):
        rest, q = residuals.weighted(np.sqrt(weights))
        rest = rest / np.sqrt(weights)
        scale = np.sum(weights * rest**2) / (count - q.shape[1])
        weights = (tail + 1) / (tail + rest**2 / scale)
    return weights
