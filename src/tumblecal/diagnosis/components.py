"""Principal components of processes in the residual space, and their evidence by their size."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.evidence import LARGEST, SMALLEST, log_evidence_of_noise


# Components of less than this share of the largest one's variance are left out.
_LEAST_VARIANCE = 1e-4
# The sizes tried.
SIZES = np.exp(np.linspace(np.log(SMALLEST), np.log(LARGEST), 16))


class Components(NamedTuple):
    """Principal components of processes that are sums of signals with independent coefficients of variance one.

    `variances` of the components of a process of size one, rising, 0 of those left out; `mixed`: the signals' shares in each.
    """

    variances: Float[np.ndarray, "processes components"]
    mixed: Float[np.ndarray, "processes signals components"]

    @property
    def precisions(self) -> Float[np.ndarray, "processes components"]:
        """One over the standard deviations, 0 of those left out."""
        kept = self.variances > 0
        return np.where(kept, 1.0 / np.sqrt(np.where(kept, self.variances, 1.0)), 0.0)

    def along(
        self, inner: Float[np.ndarray, "processes signals draws"]
    ) -> Float[np.ndarray, "processes components draws"]:
        """Coordinates along the components, orthonormal in the residual space, from products with the signals."""
        return self.precisions[:, :, None] * (np.swapaxes(self.mixed, 1, 2) @ inner)

    def only(self, kept: np.ndarray) -> "Components":
        """Those of some of the processes."""
        return Components(self.variances[kept], self.mixed[kept])


def components_of(signals: Float[np.ndarray, "processes nu signals"]) -> Components:
    """Those of processes with these signals in the residual space."""
    transposed = np.swapaxes(signals, 1, 2)
    if signals.shape[2] <= signals.shape[1]:
        return components_of_products(transposed @ signals)
    across = components_of_products(signals @ transposed)
    return Components(across.variances, across.precisions[:, None] * (transposed @ across.mixed))


def components_of_products(products: Float[np.ndarray, "processes signals signals"]) -> Components:
    """The same by the products of the signals with each other."""
    # Components this far above rounding need no singular values.
    variances, mixed = np.linalg.eigh(products)
    return Components(np.where(variances > _LEAST_VARIANCE * variances[:, -1:], variances, 0.0), mixed)


class Sizes(NamedTuple):
    """Processes with every size of a grid: `scaled` variances of the components, the `shares` of their squares that are
    explained, and half the logarithms of the determinants; a process of size s has the norm s over all readings."""

    scaled: Float[np.ndarray, "processes sizes components"]
    shares: Float[np.ndarray, "processes sizes components"]
    half_log_dets: Float[np.ndarray, "processes sizes 1"]


def sizes_of(variances: Float[np.ndarray, "processes components"]) -> Sizes:
    """The grid for the variances of the components at size one, 0 of those left out."""
    scaled = SIZES[:, None] ** 2 * (variances / np.sum(variances, axis=1, keepdims=True))[:, None]
    with_noise = 1.0 + scaled
    return Sizes(scaled, scaled / with_noise, 0.5 * np.sum(np.log(with_noise), axis=2, keepdims=True))


def log_evidence_by_size(
    explained: Float[np.ndarray, "processes sizes draws"],
    half_log_dets: Float[np.ndarray, "processes sizes 1"],
    z: Float[np.ndarray, "draws nu"],
    known: bool,
) -> Float[np.ndarray, "processes sizes draws"]:
    """Log evidence of each process and size, on the scale of `evidence.log_evidence`, from what it explains of each residual
    vector."""
    total = np.sum(z**2, axis=1)
    return log_evidence_of_noise(np.maximum(total - explained, 1e-12 * total), z.shape[1], known) - half_log_dets


def mean_over_sizes(scores: Float[np.ndarray, "processes sizes draws"]) -> Float[np.ndarray, "processes draws"]:
    """Log evidence averaged over the sizes."""
    highest = np.max(scores, axis=1)
    return highest + np.log(np.mean(np.exp(scores - highest[:, None]), axis=1))
