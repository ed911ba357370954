"""Tests of estimates with estimated noise: each covariance has an unknown factor, chi-square over its degrees of freedom.

With infinitely many degrees of freedom they are chi-square tests with a known covariance.

For two estimates: the Behrens-Fisher distribution, the result of propagating the Student distributions of JCGM 101, 6.4.9. For
several parameters together: the generalized p-value of Gamage, Mathew and Weerahandi 2004 (J. Multivariate Anal. 88, 177), with
a factor in place of a Wishart matrix. It equals the F test of Hotelling's T^2 if one estimate has no noise. A
Welch-Satterthwaite F test flags 1 % of unchanged units at p < 1e-4 if they have 3 and 21 degrees of freedom.
False alarms: docs/measured.md (measured by `benchmarks/few_dof.py` of commit 6ecf2b25).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import fdtrc, gammaincc

from tumblecal.data.sensor_parameters import SensorParameters


# With more degrees of freedom a variance is treated as known.
_MANY = 1e6
# Points of the integral over the ratio of two variances.
_POINTS = 400
# A smaller share of the variance is treated as zero.
_NO_SHARE = 1e-9


def spanned(covariance: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "rank n"]:
    """The whitening of the directions that a covariance spans; none for a covariance with zeros in its diagonal."""
    scale = np.sqrt(np.diag(covariance))
    if not np.all(scale > 0):
        return np.zeros((0, len(scale)))
    sizes, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    positive = sizes > 1e-10 * sizes[-1]
    return (axes[:, positive] / np.sqrt(sizes[positive])).T / scale


def joint_dof(estimate: SensorParameters, rows: Float[np.ndarray, "k n"]) -> float:
    """Degrees of freedom of a joint comparison of `rows` of the parameters: with inputs of a budget, those of Welch and
    Satterthwaite for the combination with the largest share of noise."""
    if estimate.noise is None or not np.isfinite(estimate.dof):
        return estimate.dof
    white = spanned(rows @ estimate.covariance @ rows.T) @ rows
    share = float(np.linalg.eigvalsh(white @ estimate.noise @ white.T)[-1]) if len(white) else 0.0
    return estimate.dof / share**2 if share > _NO_SHARE else float("inf")


def no_change(
    change: Float[np.ndarray, " k"], covariances: Sequence[Float[np.ndarray, "k k"]], dofs: Sequence[float]
) -> tuple[float, int, float | None]:
    """Test whether the difference of two independent estimates is zero.

    **Arguments:**

    - `covariances`, `dofs`: of each estimate, as estimated.

    **Returns:** `T^2 = change' (C_1 + C_2)^-1 change`, its number of directions, and its p-value; None if no covariance is
    stated.
    """
    white = spanned(covariances[0] + covariances[1])
    if not len(white):
        return 0.0, 0, None
    count, along = len(white), white @ change
    t2 = float(along @ along)
    if not np.any(np.isfinite(dofs)):
        return t2, count, float(gammaincc(count / 2, t2 / 2))
    share, axes = np.linalg.eigh(white @ covariances[0] @ white.T)
    share = np.clip(share, 0.0, 1.0)
    size = (axes.T @ along) ** 2
    for only, dof in ((share > 1 - _NO_SHARE, dofs[0]), (share < _NO_SHARE, dofs[1])):
        if np.all(only):
            return t2, count, float(fdtrc(count, min(dof, _MANY), t2 / count))
    first, second = (min(dof, _MANY) for dof in dofs)
    # Points, 1 minus these, and weights of an integral over the beta distribution: the trapezoidal rule in the logit, which is
    # exact except for rounding.
    a, b = first / 2, second / 2
    centre, width = np.log(a / b), np.sqrt(1 / a + 1 / b)
    logit = np.linspace(centre - 45 / a - 10 * width, centre + 45 / b + 10 * width, _POINTS)
    weight = np.exp(a * (logit - centre) - (a + b) * (np.logaddexp(0, logit) - np.logaddexp(0, centre)))
    part, rest, weight = 1 / (1 + np.exp(-logit)), 1 / (1 + np.exp(logit)), weight / np.sum(weight)
    spread = share * first / part[:, None] + (1 - share) * second / rest[:, None]
    tails = fdtrc(count, first + second, (first + second) / count * np.sum(size / spread, axis=1))
    return t2, count, float(weight @ tails)
