"""Processes in the residual space by their size: explained sum of squares, determinant, evidence; and three fields that follow
one curve.

Signals P of a process of size one with products G = P'P make the covariance `I + s^2 P P'`. For one residual vector z no
eigenvalues are needed: turned to a tridiagonal form with P'z along its last direction (Golub and Van Loan 2013, section
8.3.1), one factorisation serves all sizes. For many vectors the principal components are faster.

A process of three fields has a separate curve for each, with the penalty of three. If one fault changes all outputs by the same
curve, the fields' shares are a direction in space, `sum_j b_j signals_j` with |b| = 1 (the intrinsic model of
coregionalization, Goovaerts 1997). The best direction is climbed to, curve and direction in turn, and integrated over by
Laplace's method: its two angles cost half the logarithm of their information each. It needs only the products of the signals
with each other and with the residual.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dpttrf, dsytrd  # type: ignore[attr-defined]

from tumblecal.full_model.evidence import LARGEST, SMALLEST, log_evidence_of_noise


# The sizes tried: a process of size s has the norm s over all readings.
SIZES = np.exp(np.linspace(np.log(SMALLEST), np.log(LARGEST), 16))
_CLIMBS = 2
# Directions of less than this share of the best one's squares have no part.
_LEAST_SQUARE = 1e-12


def log_evidence_by_size(
    products: Sequence[Float[np.ndarray, "signals signals"]],
    inner: Sequence[Float[np.ndarray, "signals draws"]],
    z: Float[np.ndarray, "draws nu"],
    known: bool,
) -> Float[np.ndarray, "processes sizes draws"]:
    """Log evidence of each process and size, on the scale of `evidence.log_evidence`, by the products of the signals of each
    process with each other and with the residual vectors."""
    if not products:
        return np.zeros((0, len(SIZES), len(z)))
    explained, half_log_dets = (_of_one_vector if len(z) == 1 else _of_vectors)(products, inner)
    return _log_evidence(explained, half_log_dets[:, :, None], z, known)


def mean_over_sizes(scores: Float[np.ndarray, "processes sizes draws"]) -> Float[np.ndarray, "processes draws"]:
    """Log evidence averaged over the sizes."""
    highest = scores.max(axis=1)
    above = scores - highest[:, None]
    return highest + np.log(np.exp(above, out=above).sum(axis=1) / len(SIZES))


def _log_evidence(
    explained: Float[np.ndarray, " *shape"], half_log_dets: Float[np.ndarray, " *shape"], z: np.ndarray, known: bool
) -> Float[np.ndarray, " *shape"]:
    """Log evidence of processes that explain so much of vectors, the last axis of `explained`."""
    total = np.vecdot(z, z)
    residual_ss = np.maximum(total - explained, 1e-12 * total)
    return log_evidence_of_noise(residual_ss, z.shape[-1], known) - half_log_dets


def _of_vectors(
    products: Sequence[Float[np.ndarray, "signals signals"]], inner: Sequence[Float[np.ndarray, "signals draws"]]
) -> tuple[Float[np.ndarray, "processes sizes draws"], Float[np.ndarray, "processes sizes"]]:
    """Sums of squares that processes of every size explain of many vectors, and half the logarithms of the determinants."""
    explained, half_log_dets = [], []
    for own, of_own in zip(products, inner, strict=True):
        variances, turn = np.linalg.eigh(own)
        scaled, shares = by_size(variances)
        explained.append(shares @ (turn.T @ of_own) ** 2)
        half_log_dets.append(0.5 * np.sum(np.log1p(scaled), axis=1))
    return np.array(explained), np.array(half_log_dets)


def by_size(
    variances: Float[np.ndarray, " components"],
) -> tuple[Float[np.ndarray, "sizes components"], Float[np.ndarray, "sizes components"]]:
    """Variances of the components of a process of every size, and what it explains of a unit of the squared product of the
    signals with a vector."""
    scales = SIZES[:, None] ** 2 / max(np.sum(variances), 1e-300)
    scaled = scales * np.maximum(variances, 0.0)
    return scaled, scales / (1.0 + scaled)


def _of_one_vector(
    products: Sequence[Float[np.ndarray, "signals signals"]], inner: Sequence[Float[np.ndarray, "signals 1"]]
) -> tuple[Float[np.ndarray, "processes sizes 1"], Float[np.ndarray, "processes sizes"]]:
    """The same of one vector."""
    counts = np.array([len(own) for own in products])
    first, diagonal, off_diagonal = np.cumsum(counts) - counts, np.empty(np.sum(counts)), np.empty(np.sum(counts))
    for start, count, own, of_own in zip(first.tolist(), counts.tolist(), products, inner, strict=True):
        bordered, here = np.empty((count + 1, count + 1), order="F"), slice(start, start + count)
        bordered[:-1, :-1], bordered[:-1, -1:] = own, of_own
        bordered[-1, -1] = 0.0
        _, of_all, off_diagonal[here], _, _ = dsytrd(bordered, lower=0, overwrite_a=1)
        diagonal[here] = of_all[:-1]
    last = first + counts - 1
    squares, off_diagonal[last] = off_diagonal[last] ** 2, 0.0
    scales = SIZES**2 / np.maximum(np.add.reduceat(diagonal, first), 1e-300)[:, None]
    of_columns = np.repeat(scales.T, counts, axis=1)
    # The forms of all processes and sizes, one after the other: no element couples them.
    pivots = dpttrf((1.0 + of_columns * diagonal).ravel(), (of_columns * off_diagonal).ravel()[:-1])[0]
    pivots = pivots.reshape(of_columns.shape)
    explained = scales * squares[:, None] / pivots[:, last].T
    return explained[:, :, None], 0.5 * np.add.reduceat(np.log(pivots), first, axis=1).T


class Curve(NamedTuple):
    """The best curve of a process: log evidence, averaged over the sizes; the number of the best size, the curve's
    coefficients there, and the noise variance given the curve."""

    log_evidence: float
    size: int
    coefficients: Float[np.ndarray, " signals"]
    variance: float


def best_curve(
    products: Float[np.ndarray, "signals signals"],
    inner: Float[np.ndarray, " signals"],
    z: Float[np.ndarray, " nu"],
    known: bool,
) -> Curve:
    """The best curve of a process, from its signals' products with each other and with the residual."""
    variances, turn = np.linalg.eigh(products)
    along, (scaled, shares), total = inner @ turn, by_size(variances), float(z @ z)
    explained = shares @ along**2
    scores = _log_evidence(explained, 0.5 * np.log1p(scaled).sum(axis=1), z, known)
    best = int(scores.argmax())
    variance = max((total - float(explained[best])) / len(z), 1e-12 * total + 1e-300)
    evidence = float(mean_over_sizes(scores[None, :, None])[0, 0])
    return Curve(evidence, best, turn @ (shares[best] * along), 1.0 if known else variance)


def one_curve(
    products: Float[np.ndarray, "signals fields signals fields"],
    inner: Float[np.ndarray, "signals fields"],
    size: int,
    z: Float[np.ndarray, " nu"],
    known: bool,
) -> tuple[Float[np.ndarray, " fields"], float]:
    """A process with its fields in one direction, by its signals' products with each other and with the residual: the fields'
    shares as a unit vector, and the log evidence.

    `size`: the number of the best size with a separate curve for each field.
    """
    fields, whole = inner.shape[1], products.reshape(inner.size, inner.size)
    scale = SIZES[size] ** 2 / max(np.trace(whole), 1e-300)
    separate = np.linalg.solve(scale * whole + np.eye(inner.size), scale * inner.ravel()).reshape(inner.shape)
    # From the direction in which the curves of each field lie most.
    direction = np.linalg.eigh(separate.T @ separate)[1][:, -1]
    curve, moved = _in_direction(products, inner, direction, z, known)
    for _ in range(_CLIMBS):
        squares, turn = np.linalg.eigh(moved)
        kept = squares > _LEAST_SQUARE * squares[-1]
        shares = turn[:, kept] @ ((curve.coefficients @ inner @ turn)[kept] / squares[kept])
        # If nothing is explained there is no direction.
        if (norm := float(np.linalg.norm(shares))) > 0.0:
            direction = shares / norm
        curve, moved = _in_direction(products, inner, direction, z, known)
    across = np.eye(fields) - np.outer(direction, direction)
    information = np.eye(fields) + across @ moved @ across / curve.variance
    return direction, curve.log_evidence - 0.5 * float(np.linalg.slogdet(information)[1])


def _in_direction(
    products: Float[np.ndarray, "signals fields signals fields"],
    inner: Float[np.ndarray, "signals fields"],
    direction: Float[np.ndarray, " fields"],
    z: Float[np.ndarray, " nu"],
    known: bool,
) -> tuple[Curve, Float[np.ndarray, "fields fields"]]:
    """The best curve with the fields in one direction, and the products with each other of its signals in each field."""
    curve = best_curve((products @ direction).swapaxes(1, 2) @ direction, inner @ direction, z, known)
    return curve, np.tensordot(curve.coefficients, products.swapaxes(2, 3) @ curve.coefficients, 1)
