"""Principal components of a process in the residual space, and its evidence by its size."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.evidence import LARGEST, SMALLEST, log_evidence_of_noise


# Components of less than this share of the largest one's variance are left out, and these many sizes tried.
_LEAST_VARIANCE, _SIZES = 1e-4, 16


class Components(NamedTuple):
    """Orthonormal `directions` and the `variances` along them of a process of size one, the largest first; `mixed`: the
    signals' shares in each direction."""

    directions: Float[np.ndarray, "nu components"]
    variances: Float[np.ndarray, " components"]
    mixed: Float[np.ndarray, "signals components"]


def components_of(signals: Float[np.ndarray, "nu signals"]) -> Components:
    """Those of a process that is a sum of signals with independent coefficients of variance one."""
    # Components this far above rounding need no singular values.
    if signals.shape[1] > signals.shape[0]:
        variances, directions = np.linalg.eigh(signals @ signals.T)
        kept = np.flatnonzero(variances > _LEAST_VARIANCE * variances[-1])[::-1]
        variances, directions = variances[kept], directions[:, kept]
        return Components(directions, variances, signals.T @ directions / np.sqrt(variances))
    variances, mixed = np.linalg.eigh(signals.T @ signals)
    kept = np.flatnonzero(variances > _LEAST_VARIANCE * variances[-1])[::-1]
    variances, mixed = variances[kept], mixed[:, kept]
    return Components(signals @ mixed / np.sqrt(variances), variances, mixed)


class Sizes(NamedTuple):
    """Processes with every size of a grid: `scaled` variances of the components, the `shares` of their squares that are
    explained, and half the logarithms of the determinants; a process of size s has the norm s over all readings."""

    scaled: Float[np.ndarray, "processes sizes most"]
    shares: Float[np.ndarray, "processes sizes most"]
    half_log_dets: Float[np.ndarray, "processes sizes 1"]

    def log_evidence(
        self,
        squares: Float[np.ndarray, "processes most draws"],
        total: Float[np.ndarray, " draws"],
        dof: int,
        known: bool,
    ) -> Float[np.ndarray, "processes sizes draws"]:
        """Log evidence of each process and size, on the scale of `evidence.log_evidence`; `squares` along the components."""
        left = np.maximum(total - self.shares @ squares, 1e-12 * total)
        return log_evidence_of_noise(left, dof, known) - self.half_log_dets


def sizes_of(variances: Float[np.ndarray, "processes most"]) -> Sizes:
    """The grid for the variances of the components at size one, 0 where a process has fewer."""
    sizes = np.exp(np.linspace(np.log(SMALLEST), np.log(LARGEST), _SIZES))
    scaled = sizes[:, None] ** 2 * (variances / np.sum(variances, axis=1, keepdims=True))[:, None]
    return Sizes(scaled, scaled / (1.0 + scaled), 0.5 * np.sum(np.log1p(scaled), axis=2, keepdims=True))


def mean_over_sizes(scores: Float[np.ndarray, "processes sizes draws"]) -> Float[np.ndarray, "processes draws"]:
    """Log evidence averaged over the sizes."""
    highest = np.max(scores, axis=1)
    return highest + np.log(np.mean(np.exp(scores - highest[:, None]), axis=1))
