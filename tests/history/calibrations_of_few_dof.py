"""Calibrations whose noise was estimated from few degrees of freedom, for the tests of `compare` and `check`.

Hand-held calibrations: 9 parameters and 2 tilts of each of 12, 15, 20, 30 attitudes, so 3, 6, 11 and 21 degrees of freedom,
in random attitudes with noise of 1. Nothing moved, or one bias by some of the sd stated of its change.
"""

import numpy as np
from scipy.special import gammaincc

from tumblecal.history.few_dof import no_change


ALL, BIASES = np.arange(9), np.arange(3, 6)
# Attitudes that a matrix of this condition comes from determine nothing.
_CONDITION = 1e6


def calibrated(
    rng: np.random.Generator, attitudes: int, sd: float = 1.0, *, known: bool = False
) -> tuple[np.ndarray, np.ndarray, float]:
    """Errors of a hand-held calibration, their covariance as estimated, and its degrees of freedom."""
    while True:
        force = rng.normal(size=(attitudes, 3))
        force /= np.linalg.norm(force, axis=1)[:, None]
        rows = np.zeros((attitudes, 3, 9 + 2 * attitudes))
        rows[:, range(3), range(3)] = force
        rows[:, :, 3:6] = np.eye(3)
        rows[:, 1, 6], rows[:, 2, 7], rows[:, 2, 8] = force[:, 0], force[:, 0], force[:, 1]
        for k, own in enumerate(force):
            rows[k, :, 9 + 2 * k : 11 + 2 * k] = np.linalg.svd(own[None])[2][1:].T
        design = rows.reshape(3 * attitudes, -1)
        covariance = np.linalg.inv(design.T @ design)[:9, :9]
        if np.linalg.cond(covariance) < _CONDITION:
            break
    dof = design.shape[0] - design.shape[1]
    error = sd * np.linalg.cholesky(covariance) @ rng.normal(size=9)
    return error, sd**2 * covariance * (1 if known else rng.chisquare(dof) / dof), np.inf if known else float(dof)


def told(
    count: int, chosen: np.ndarray, sets: tuple[int, ...], *, sds=None, known=False, shift=0.0, seed=7
) -> tuple[list[float], list[float]]:
    """p-values of `count` comparisons of calibrations of so many attitudes, and those of chi-square."""
    rng, tails, plain, grid = np.random.default_rng(seed), [], [], np.ix_(chosen, chosen)
    for _ in range(count):
        own = [calibrated(rng, n, sd, known=known) for n, sd in zip(sets, sds or [1.0] * len(sets), strict=True)]
        values, covariances, dofs = (list(part) for part in zip(*own, strict=True))
        if shift:
            scale = [np.sqrt(part[3, 3]) for part in covariances]
            values[-1][3] += shift * float(np.hypot(*scale[-2:]))
        values, covariances = np.array(values)[:, chosen], [part[grid] for part in covariances]
        t2, dof, tail = no_change(values[1] - values[0], covariances, dofs)
        tails.append(tail)
        plain.append(float(gammaincc(dof / 2, t2 / 2)))
    return tails, plain
