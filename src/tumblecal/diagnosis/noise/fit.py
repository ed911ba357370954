"""The noise fitted to the residuals by restricted maximum likelihood, so that all later tests are correct again."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.noise.models import NoiseModel
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.tangent import Tangent
from tumblecal.noise.covariance import Covariance


_STEPS = 8

# White rows of the readings (no priors) without the faults of the causes, and what spans the nominal model and the causes.
_Residuals = tuple[Float[np.ndarray, " readings"], Float[np.ndarray, "readings columns"]]


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
    residuals = (at.basis @ moved)[:count], np.hstack([at.reached, at.basis @ q])[:count]
    relative, words = best.covariance, best.words
    if best.tail is not None:
        relative = Covariance(1.0 / _tail_weights(residuals, best.tail), "rows")
    elif best.at_level is not None and best.described is not None:
        level, sigma = _refined(residuals, best)
        relative, words = best.at_level(level), best.described(level, sigma)
    elif best.groups is not None:
        sd = _group_sd(residuals, best.groups)
        relative, words = Covariance(sd[best.groups] ** 2, "rows"), _group_words(sd, best.names, problem)
    # What a reading shares with others leaves its own sd as it was.
    sd = problem.sd * relative.sd.reshape(-1, 3) if relative.form == "rows" else problem.sd
    return problem.with_noise(problem.noise.compounded(relative), known=False, sd=sd), words


def _group_words(sd: Float[np.ndarray, " groups"], names: tuple[str, ...], problem: Problem) -> str:
    """The standard deviations of all readings, of the axes, or of a part of the readings and the others."""
    if len(names) == 1:
        repeat = float(sd[0] * np.median(problem.sd)) * 1e3
        return f"every sd times {sd[0]:.2g}" + (f": the positions repeat to {repeat:.2g} mg" if problem.known else "")
    part = len(names) == 2

    def listed(numbers: Float[np.ndarray, " groups"]) -> str:
        pairs = zip(names, numbers.tolist(), strict=True)
        return ", ".join(f"{own:.2g} {name}" if part else f"{name} {own:.2g}" for name, own in pairs)

    if problem.known:
        return f"the dispersion between positions is the stated sd times {listed(sd)}"
    return (
        f"sd {names[0]} {sd[0] / sd[1]:.2g} times that {names[1]}"
        if part
        else (f"sd of the axes as {listed(sd / min(sd))}")
    )


def _fitted(
    residuals: _Residuals, covariance: Covariance
) -> tuple[Float[np.ndarray, " readings"], Float[np.ndarray, "readings columns"], float]:
    """White residual under a covariance, the orthonormal basis of the fit, and half the logarithm of the determinant."""
    rows, fitted = (covariance.whiten(own) for own in residuals)
    q, r = np.linalg.qr(fitted)
    log_det = covariance.half_log_det + float(np.sum(np.log(np.abs(np.diag(r)) + 1e-300)))
    return rows - q @ (q.T @ rows), q, log_det


def _refined(residuals: _Residuals, best: NoiseModel) -> tuple[float, float]:
    """The level of the highest restricted likelihood between the neighbours of the best one tried, and the sd there."""
    from scipy.optimize import minimize_scalar  # a third of a second, which data whose noise is right do without

    at_level, (level, *levels) = best.at_level, best.levels
    assert at_level is not None
    ends = [min(levels) / 3, *sorted(levels), 0.99 if level < 1 else 5 * level]
    number, free = ends.index(level), float(np.subtract(*residuals[1].shape))

    def cost(log_level: float) -> float:
        rest, _, log_det = _fitted(residuals, at_level(float(np.exp(log_level))))
        return log_det + free * float(np.log(np.linalg.norm(rest) + 1e-150))

    bounds = np.log(ends[number - 1]), np.log(ends[number + 1])
    least: Any = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.02})
    level = float(np.exp(least.x))
    return level, float(np.linalg.norm(_fitted(residuals, at_level(level))[0]) / np.sqrt(free))


def _group_sd(residuals: _Residuals, groups: Int[np.ndarray, " rows"]) -> Float[np.ndarray, " groups"]:
    """Each group's sd in white units by restricted maximum likelihood (Patterson and Thompson 1971), by iteration."""
    variance = np.ones(int(groups.max()) + 1)
    for _ in range(_STEPS):
        rows, q, _ = _fitted(residuals, Covariance(variance[groups], "rows"))
        residual_ss, free = (np.bincount(groups, own) for own in (rows**2, 1.0 - np.sum(q**2, axis=1)))
        variance *= np.maximum(residual_ss / np.maximum(free, 1e-12), 1e-12)
    return np.sqrt(variance)


def _tail_weights(residuals: _Residuals, tail: float) -> Float[np.ndarray, " readings"]:
    """Weights of a Student's t fit: readings far out count less (Lange, Little and Taylor 1989)."""
    weights = np.ones(len(residuals[0]))
    for _ in range(4 * _STEPS):
        rows, q, _ = _fitted(residuals, Covariance(1.0 / weights, "rows"))
        scale = np.sum(rows**2) / (len(weights) - q.shape[1])
        weights = (tail + 1) / (tail + rows**2 / weights / scale)
    return weights
