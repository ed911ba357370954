"""Tests of estimates with estimated noise: each covariance has an unknown factor, chi-square over its degrees of freedom.

With infinitely many degrees of freedom they are chi-square tests with a known covariance.

For two estimates: the Behrens-Fisher distribution, the result of propagating the Student distributions of JCGM 101, 6.4.9. For
several parameters together: the generalized p-value of Gamage, Mathew and Weerahandi 2004 (J. Multivariate Anal. 88, 177), with
a factor in place of a Wishart matrix. It equals the F test of Hotelling's T^2 if one estimate has no noise. A
Welch-Satterthwaite F test flags 1 % of unchanged units at p < 1e-4 if they have 3 and 21 degrees of freedom.

For more than two estimates: the larger of this p-value and that of the parametric bootstrap (Krishnamoorthy and Lu 2010, J.
Stat. Comput. Simul. 80, 873). The first alone has too many false alarms for many estimates, the second if one estimate has few
degrees of freedom and others have many. `benchmarks/few_dof.py` measures false alarms.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import fdtrc, gammaincc

from tumblecal.data.sensor_parameters import SensorParameters


# With more degrees of freedom a variance is treated as known.
_MANY = 1e6
# Points of the integral over the ratio of two variances, draws of the variances of several estimates (fixed seed: the same
# data give the same p), and numbers drawn in one block.
_POINTS, _DRAWS, _AT_A_TIME = 400, 4000, 200_000
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
    part, rest, weight = _beta(first / 2, second / 2)
    spread = share * first / part[:, None] + (1 - share) * second / rest[:, None]
    tails = fdtrc(count, first + second, (first + second) / count * np.sum(size / spread, axis=1))
    return t2, count, float(weight @ tails)


def _beta(a: float, b: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, 1 minus these, and weights of an integral over the beta distribution: the trapezoidal rule in the logit, which is
    exact except for rounding."""
    centre, width = np.log(a / b), np.sqrt(1 / a + 1 / b)
    logit = np.linspace(centre - 45 / a - 10 * width, centre + 45 / b + 10 * width, _POINTS)
    density = a * (logit - centre) - (a + b) * (np.logaddexp(0, logit) - np.logaddexp(0, centre))
    weight = np.exp(density)
    return 1 / (1 + np.exp(-logit)), 1 / (1 + np.exp(logit)), weight / np.sum(weight)


def no_difference(
    values: Float[np.ndarray, "entries k"], covariances: Sequence[Float[np.ndarray, "k k"]], dofs: Sequence[float]
) -> tuple[float, int, float]:
    """Test whether several independent estimates have the same true values.

    **Arguments:**

    - `covariances`, `dofs`: of each estimate, as estimated; no variance is zero.

    **Returns:** chi-square of the estimates about their weighted mean, its degrees of freedom, and its p-value.
    """
    if len(values) == 2:
        t2, count, tail = no_change(values[1] - values[0], covariances, dofs)
        return t2, count, 1.0 if tail is None else tail
    halves = np.stack([_root(covariance) for covariance in covariances])
    weights = np.swapaxes(halves, 1, 2) @ halves
    mean = np.linalg.solve(weights.sum(axis=0), np.einsum("eij,ej->i", weights, values))
    along = np.einsum("eij,ej->ei", halves, values - mean)
    chi2, dof = float(np.sum(along**2)), int(np.any(halves, axis=2).sum()) - values.shape[1]
    if not np.any(np.isfinite(dofs)):
        return chi2, dof, float(gammaincc(dof / 2, chi2 / 2))
    return chi2, dof, max(_drawn(along, halves, np.minimum(dofs, _MANY)))


def _root(covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """The whitening, with rows of zeros for directions that the covariance does not span."""
    white = spanned(covariance)
    return np.concatenate([white, np.zeros((len(covariance) - len(white), len(covariance)))])


def _drawn(
    along: Float[np.ndarray, "entries k"], halves: Float[np.ndarray, "entries k k"], dofs: Float[np.ndarray, " entries"]
) -> tuple[float, float]:
    """The generalized p-value and that of the bootstrap, as means over draws of the ratios of the variances; the integrals over
    the common factor and the size of the simulated errors are F tails."""
    rng, (entries, count), total = np.random.default_rng(0), along.shape, float(np.sum(dofs))
    white, there = halves / np.sqrt(np.mean(halves**2)), np.any(halves, axis=2)
    chi2, errors, tails = float(np.sum(along**2)), int(there.sum()), []
    for first in range(0, _DRAWS, block := max(_AT_A_TIME // errors, 1)):
        draws = min(block, _DRAWS - first)
        ratio = rng.chisquare(dofs, (draws, entries))
        ratio /= np.sum(ratio, axis=1, keepdims=True) / total * dofs
        given = _about_mean(np.broadcast_to(along, (draws, entries, count)), white, ratio)
        error = rng.normal(size=(draws, entries, count)) * there
        error /= np.sqrt(np.sum(error**2, axis=(1, 2), keepdims=True))
        simulated = _about_mean(error, white, 1 / ratio)
        tails.append(
            (fdtrc(errors - count, total, given / (errors - count)), fdtrc(errors, total, chi2 / errors / simulated))
        )
    generalized, bootstrap = (float(np.mean(np.concatenate(part))) for part in zip(*tails, strict=True))
    return generalized, bootstrap


def _about_mean(
    along: Float[np.ndarray, "draws entries k"],
    halves: Float[np.ndarray, "entries k k"],
    factor: Float[np.ndarray, "draws entries"],
) -> Float[np.ndarray, " draws"]:
    """Chi-square about the weighted mean, with the weight of each entry multiplied by a factor."""
    weights = np.tensordot(factor, np.swapaxes(halves, 1, 2) @ halves, 1)
    pulled = np.einsum("ae,eji,aej->ai", factor, halves, along)
    explained = np.sum(pulled * np.linalg.solve(weights, pulled[..., None])[..., 0], axis=1)
    return np.einsum("ae,aej,aej->a", factor, along, along) - explained
