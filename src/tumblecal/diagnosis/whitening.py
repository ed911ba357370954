"""Weights that follow a wrong noise model, so that every test after it is right again."""

from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

from tumblecal.diagnosis.linear import Linear, Weighting
from tumblecal.diagnosis.noise import NoiseAlternative, log_noise_evidence


_STEPS = 8


def corrected(how: Weighting, linear: Linear, listed: list[NoiseAlternative], label: str) -> tuple[Weighting, str]:
    """The weighting under the best noise alternative of a label, and the alternative in words.

    The level of the noise counts as unknown from then on: it was estimated.
    """
    own = [one for one in listed if one.label == label]
    best = own[int(np.argmax(log_noise_evidence(own, linear.z[None], how.known)[0]))]
    if best.tail is not None:
        return _trusting(how, linear, best.tail), best.words
    if best.covariance.ndim == 1:
        ratio = _axis_sd(how, linear)
        words = ", ".join(f"{axis} {value:.2g}" for axis, value in zip("xyz", ratio / np.min(ratio), strict=True))
        return replace(how, weights=how.weights / ratio, known=False), f"sd of the axes as {words}"
    lower = np.linalg.cholesky(best.covariance)
    whiten = solve_triangular(lower, np.eye(len(lower)), lower=True)
    return replace(how, whiten=whiten, known=False), best.words


def _axis_sd(how: Weighting, linear: Linear) -> np.ndarray:
    """Each axis's sd in weighted units by restricted maximum likelihood (Patterson and Thompson 1971), by iteration."""
    count = how.weights.size
    axis = np.tile(np.arange(3), count // 3)
    variance = np.ones(3)
    nominal = _complement(linear)[:count]
    for _ in range(_STEPS):
        weights = 1.0 / np.sqrt(variance[axis])
        q, _ = np.linalg.qr(nominal * weights[:, None])
        rows = linear.residual[:count] * weights
        rows = rows - q @ (q.T @ rows)
        free = 1.0 - np.sum(q**2, axis=1)
        for k in range(3):
            variance[k] *= max(np.sum(rows[axis == k] ** 2) / np.sum(free[axis == k]), 1e-12)
    return np.sqrt(variance)


def _complement(linear: Linear) -> np.ndarray:
    """Orthonormal basis of what the nominal model can reach."""
    left, _, _ = np.linalg.svd(linear.basis, full_matrices=True)
    return left[:, linear.basis.shape[1] :]


def _trusting(how: Weighting, linear: Linear, tail: float) -> Weighting:
    """Weights of a Student's t fit: readings far out count less (Lange, Little and Taylor 1989)."""
    count = how.weights.size
    nominal = _complement(linear)[:count]
    trust, residual = np.ones(count), linear.residual[:count]
    for _ in range(4 * _STEPS):
        weights = np.sqrt(trust)
        q, _ = np.linalg.qr(nominal * weights[:, None])
        rows = residual * weights
        left = (rows - q @ (q.T @ rows)) / weights
        scale = np.sum(trust * left**2) / (count - q.shape[1])
        trust = (tail + 1) / (tail + left**2 / scale)
    return replace(how, weights=how.weights * np.sqrt(trust).reshape(how.weights.shape), known=False)
