"""Three fields that follow one curve: one fault changes all outputs by the same curve, each by a different share.

A process of three fields has a separate curve for each, with the penalty of three. Here the fields' shares are a direction in
space, `sum_j b_j signals_j` with |b| = 1 (the intrinsic model of coregionalization, Goovaerts 1997). The best direction is
climbed to, curve and direction in turn, and integrated over by Laplace's method: its two angles cost half the logarithm of
their information each. It needs only the products of the signals with each other and with the residual.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.lack_of_fit.components import SIZES, BySize, mean_over_sizes


_CLIMBS = 2
# Directions of less than this share of the best one's squares have no part.
_LEAST_SQUARE = 1e-12


class Curve(NamedTuple):
    """The best curve of a process: log evidence, averaged over the sizes; the number of the best size, the curve's
    coefficients there, and the noise variance given the curve."""

    log_evidence: float
    size: int
    coefficients: Float[np.ndarray, " signals"]
    variance: float


class OneCurve(NamedTuple):
    """A process of one curve: the fields' shares as a unit vector, and the log evidence."""

    direction: Float[np.ndarray, " fields"]
    log_evidence: float


def best_curve(
    products: Float[np.ndarray, "signals signals"],
    inner: Float[np.ndarray, " signals"],
    z: Float[np.ndarray, " nu"],
    known: bool,
) -> Curve:
    """The best curve of a process, from its signals' products with each other and with the residual."""
    variances, turn = np.linalg.eigh(products)
    along, scales, total = inner @ turn, SIZES**2 / max(np.sum(variances), 1e-300), float(z @ z)
    scaled = scales[:, None] * np.maximum(variances, 0.0)
    shares = scales[:, None] / (1.0 + scaled)
    explained = shares @ along**2
    by_size = BySize(explained[None, :, None], 0.5 * np.log1p(scaled).sum(axis=1)[None])
    scores = by_size.log_evidence(z[None], known)
    best = int(scores.argmax())
    variance = max((total - float(explained[best])) / len(z), 1e-12 * total + 1e-300)
    evidence = float(mean_over_sizes(scores)[0, 0])
    return Curve(evidence, best, turn @ (shares[best] * along), 1.0 if known else variance)


def one_curve(
    products: Float[np.ndarray, "signals fields signals fields"],
    inner: Float[np.ndarray, "signals fields"],
    size: int,
    z: Float[np.ndarray, " nu"],
    known: bool,
) -> OneCurve:
    """A process with its fields in one direction, by its signals' products with each other and with the residual.

    `size`: the number of the best size with a separate curve for each field.
    """
    fields = inner.shape[1]
    whole = products.reshape(inner.size, inner.size)
    scale = SIZES[size] ** 2 / max(np.trace(whole), 1e-300)
    separate = np.linalg.solve(scale * whole + np.eye(inner.size), scale * inner.ravel()).reshape(inner.shape)
    # From the direction in which the curves of each field lie most.
    direction = np.linalg.eigh(separate.T @ separate)[1][:, -1]
    curve, moved = _in_direction(products, inner, direction, z, known)
    for _ in range(_CLIMBS):
        squares, turn = np.linalg.eigh(moved)
        kept = squares > _LEAST_SQUARE * squares[-1]
        shares = turn[:, kept] @ ((curve.coefficients @ inner @ turn)[kept] / squares[kept])
        norm = float(np.linalg.norm(shares))
        # If nothing is explained there is no direction.
        direction = shares / norm if norm > 0.0 else direction
        curve, moved = _in_direction(products, inner, direction, z, known)
    across = np.eye(fields) - np.outer(direction, direction)
    information = across @ moved @ across / curve.variance
    return OneCurve(direction, curve.log_evidence - 0.5 * float(np.linalg.slogdet(np.eye(fields) + information)[1]))


def _in_direction(
    products: Float[np.ndarray, "signals fields signals fields"],
    inner: Float[np.ndarray, "signals fields"],
    direction: Float[np.ndarray, " fields"],
    z: Float[np.ndarray, " nu"],
    known: bool,
) -> tuple[Curve, Float[np.ndarray, "fields fields"]]:
    """The best curve with the fields in one direction, and the products with each other of its signals in each field."""
    curve = best_curve((products @ direction).swapaxes(1, 2) @ direction, inner @ direction, z, known)
    half = products.swapaxes(2, 3) @ curve.coefficients
    return curve, (curve.coefficients @ half.reshape(len(half), -1)).reshape(half.shape[1:])
