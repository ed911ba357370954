"""Weights that follow a wrong noise model, so that every test after it is right again."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from tumblecal.diagnosis.linear import Linear, Weighting
from tumblecal.diagnosis.noise import Family, NoiseAlternative
from tumblecal.diagnosis.noise_covariance import half_log_det, root_of, whitened


_STEPS = 8


@dataclass(frozen=True)
class Leftover:
    """Weighted rows of the readings (no priors) with what is not noise in them: `fitted` spans the nominal model and the
    causes found beside the noise; `rows` is the residual without their faults."""

    rows: np.ndarray
    fitted: np.ndarray


def leftover(how: Weighting, linear: Linear, moved: np.ndarray, q: np.ndarray) -> Leftover:
    """What the noise is estimated from.

    **Arguments:**

    - `moved` (nu): the residual's part in the unreachable space after the faults of a set of causes are undone.
    - `q` (nu, rank): basis of what the set's effects can make.
    """
    count = how.weights.size
    return Leftover((linear.basis @ moved)[:count], np.hstack([linear.reached, linear.basis @ q])[:count])


def corrected(how: Weighting, left: Leftover, best: NoiseAlternative) -> tuple[Weighting, str]:
    """The weighting under a noise alternative, and the alternative in words.

    The level of the noise counts as unknown from then on: it was estimated.
    """
    count = how.weights.size
    if best.tail is not None:
        return _scaled_rows(how, np.sqrt(_trust(left, best.tail))), best.words
    if best.covariance.ndim == 1 and np.ptp(best.covariance) == 0:
        q, _ = np.linalg.qr(left.fitted)
        rest = left.rows - q @ (q.T @ left.rows)
        level = float(np.sqrt(rest @ rest / (count - q.shape[1])))
        return replace(how, weights=how.weights / level, known=False), f"every sd times {level:.2g}"
    if best.covariance.ndim == 1:
        ratio = _axis_sd(left)
        by_axis = ", ".join(f"{axis} {value:.2g}" for axis, value in zip("xyz", ratio, strict=True))
        relative = ", ".join(f"{axis} {value:.2g}" for axis, value in zip("xyz", ratio / min(ratio), strict=True))
        words = f"sd of the axes as {relative}"
        if how.known:
            words = f"the scatter between positions is that of the sd given, times {by_axis}"
        return replace(how, weights=how.weights / ratio, known=False), words
    covariance, words = best.covariance, best.words
    if best.family is not None:
        level, sigma = _refined(left, best.family, best.level)
        covariance, words = best.family.covariance(level), best.family.words(level, sigma)
    whiten = whitened(root_of(covariance), count, np.eye(count))
    return replace(how, whiten=whiten if how.whiten is None else whiten @ how.whiten, known=False), words


def _refined(left: Leftover, family: Family, level: float) -> tuple[float, float]:
    """The level of the highest restricted likelihood between the neighbours of the best one tried, and the sd there."""
    count, levels = len(left.rows), sorted(family.levels)
    place = levels.index(level)
    low = levels[place - 1] if place else levels[0] / 3
    high = levels[place + 1] if place + 1 < len(levels) else (0.99 if level < 1 else 5 * level)

    def fitted(log_level: float) -> tuple[float, float, int]:
        root = root_of(family.covariance(float(np.exp(log_level))))
        rows = whitened(root, count, left.rows[:, None])[:, 0]
        q, r = np.linalg.qr(whitened(root, count, left.fitted))
        rest = rows - q @ (q.T @ rows)
        free = len(rows) - q.shape[1]
        log_det = half_log_det(root, count) + float(np.sum(np.log(np.abs(np.diag(r)) + 1e-300)))
        return log_det, max(float(rest @ rest), 1e-300), free

    def cost(log_level: float) -> float:
        log_det, left_over, free = fitted(log_level)
        return log_det + 0.5 * free * float(np.log(left_over))

    found: Any = minimize_scalar(cost, bounds=(np.log(low), np.log(high)), method="bounded", options={"xatol": 0.02})
    _, left_over, free = fitted(found.x)
    return float(np.exp(found.x)), float(np.sqrt(left_over / free))


def _scaled_rows(how: Weighting, factor: np.ndarray) -> Weighting:
    if how.whiten is not None:
        return replace(how, whiten=factor[:, None] * how.whiten, known=False)
    return replace(how, weights=how.weights * factor.reshape(how.weights.shape), known=False)


def _axis_sd(left: Leftover) -> np.ndarray:
    """Each axis's sd in weighted units by restricted maximum likelihood (Patterson and Thompson 1971), by iteration."""
    axis = np.tile(np.arange(3), len(left.rows) // 3)
    variance = np.ones(3)
    for _ in range(_STEPS):
        weights = 1.0 / np.sqrt(variance[axis])
        q, _ = np.linalg.qr(left.fitted * weights[:, None])
        rows = left.rows * weights
        rows = rows - q @ (q.T @ rows)
        free = 1.0 - np.sum(q**2, axis=1)
        for k in range(3):
            variance[k] *= max(np.sum(rows[axis == k] ** 2) / max(np.sum(free[axis == k]), 1e-12), 1e-12)
    return np.sqrt(variance)


def _trust(left: Leftover, tail: float) -> np.ndarray:
    """Weights of a Student's t fit: readings far out count less (Lange, Little and Taylor 1989)."""
    count = len(left.rows)
    trust = np.ones(count)
    for _ in range(4 * _STEPS):
        weights = np.sqrt(trust)
        q, _ = np.linalg.qr(left.fitted * weights[:, None])
        rows = left.rows * weights
        rest = (rows - q @ (q.T @ rows)) / weights
        scale = np.sum(trust * rest**2) / (count - q.shape[1])
        trust = (tail + 1) / (tail + rest**2 / scale)
    return trust
