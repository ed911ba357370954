"""Three fields that follow one curve: one fault changes all outputs by the same curve, each by a different share.

A process of three fields has a separate curve for each, with the penalty of three. Here the fields' shares are a direction in
space, `sum_j b_j signals_j` with |b| = 1 (the intrinsic model of coregionalization, Goovaerts 1997). The best direction is
climbed to, curve and direction in turn, and integrated over by Laplace's method: its two angles cost half the logarithm of
their information each. It needs only the products of the signals with each other and with the residual.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.lack_of_fit.components import BySize, mean_over_sizes, scales_of


_CLIMBS = 2
# Directions of less than this share of the best one's squares have no part.
_LEAST_SQUARE = 1e-12


class OneCurve(NamedTuple):
    """Processes of one curve each: the fields' shares as a unit vector, and the log evidence."""

    direction: Float[np.ndarray, "processes fields"]
    log_evidence: Float[np.ndarray, " processes"]


class Curve(NamedTuple):
    """The best curves of processes: log evidence of every size, the number of the best, the curve's coefficients there, and
    the noise variance given the curve."""

    scores: Float[np.ndarray, "processes sizes 1"]
    size: Int[np.ndarray, " processes"]
    coefficients: Float[np.ndarray, "processes signals"]
    variance: Float[np.ndarray, " processes"]

    @property
    def log_evidence(self) -> Float[np.ndarray, " processes"]:
        """Log evidence, the size averaged over."""
        return mean_over_sizes(self.scores)[:, 0]


def one_curve(
    products: Float[np.ndarray, "processes fields signals fields signals"],
    inner: Float[np.ndarray, "processes fields signals"],
    size: Int[np.ndarray, " processes"],
    z: Float[np.ndarray, " nu"],
    known: bool,
) -> OneCurve:
    """Processes with their fields in one direction, by their signals' products with each other and with the residual.

    `size`: the number of the best size with a separate curve for each field.
    """
    flat = inner.reshape(len(inner), -1)
    apart = fitted(products.reshape(len(flat), *flat.shape[1:] * 2), flat, size).reshape(inner.shape)
    # From the direction in which the curves of each field lie most.
    direction = np.linalg.eigh(apart @ apart.mT)[1][:, :, -1]
    for _ in range(_CLIMBS):
        own = best_curve(*_in_direction(products, inner, direction), z, known)
        squares, turn = np.linalg.eigh(_moved(products, own.coefficients))
        moved = turn.mT @ (inner @ own.coefficients[:, :, None])
        kept = squares > _LEAST_SQUARE * squares[:, -1:]
        shares = turn @ np.where(kept[:, :, None], moved / np.where(kept, squares, 1.0)[:, :, None], 0.0)
        size = np.sqrt((shares**2).sum(axis=1))
        # Where nothing is left there is no direction.
        direction = np.where(size > 0.0, shares[:, :, 0] / np.where(size > 0.0, size, 1.0), direction)
    own = best_curve(*_in_direction(products, inner, direction), z, known)
    beside = np.eye(inner.shape[1]) - direction[:, :, None] * direction[:, None]
    information = beside @ _moved(products, own.coefficients) @ beside / own.variance[:, None, None]
    cost = 0.5 * np.linalg.slogdet(np.eye(inner.shape[1]) + information)[1]
    return OneCurve(direction, own.log_evidence - cost)


def best_curve(
    products: Float[np.ndarray, "processes signals signals"],
    inner: Float[np.ndarray, "processes signals"],
    z: Float[np.ndarray, " nu"],
    known: bool,
) -> Curve:
    """The curves of processes, from their signals' products with each other and with the residual."""
    variances, turn = np.linalg.eigh(products)
    along, scales = (inner[:, None] @ turn)[:, 0], scales_of(products)[:, :, None]
    scaled = scales * np.maximum(variances, 0.0)[:, None]
    shares, each, total = scales / (1.0 + scaled), np.arange(len(inner)), float(z @ z)
    by_size = BySize(shares @ along[:, :, None] ** 2, 0.5 * np.log1p(scaled).sum(axis=2))
    scores = by_size.log_evidence(z[None], known)
    best = scores[:, :, 0].argmax(axis=1)
    left = np.maximum((total - by_size.explained[each, best, 0]) / len(z), 1e-12 * total + 1e-300)
    coefficients = (turn @ (shares[each, best] * along)[:, :, None])[:, :, 0]
    return Curve(scores, best, coefficients, np.ones(len(inner)) if known else left)


def fitted(
    products: Float[np.ndarray, "processes signals signals"],
    inner: Float[np.ndarray, "processes signals"],
    size: Int[np.ndarray, " processes"],
) -> Float[np.ndarray, "processes signals"]:
    """The most probable coefficients of processes of these sizes, by number."""
    scales = scales_of(products)[np.arange(len(size)), size]
    weighed = scales[:, None, None] * products + np.eye(inner.shape[1])
    return np.linalg.solve(weighed, scales[:, None, None] * inner[:, :, None])[:, :, 0]


def _in_direction(
    products: Float[np.ndarray, "processes fields signals fields signals"],
    inner: Float[np.ndarray, "processes fields signals"],
    direction: Float[np.ndarray, "processes fields"],
) -> tuple[Float[np.ndarray, "processes signals signals"], Float[np.ndarray, "processes signals"]]:
    """Products and inner products of curves with the fields in one direction."""
    count, fields, signals = inner.shape
    along = direction[:, None]
    half = (along @ products.reshape(count, fields, -1)).reshape(count, signals, fields, signals)
    return (along[:, None] @ half)[:, :, 0], (along @ inner)[:, 0]


def _moved(
    products: Float[np.ndarray, "processes fields signals fields signals"],
    coefficients: Float[np.ndarray, "processes signals"],
) -> Float[np.ndarray, "processes fields fields"]:
    """Products with each other of what one curve does by each field."""
    count, fields, signals = products.shape[:3]
    half = products.reshape(count, -1, signals) @ coefficients[:, :, None]
    return (coefficients[:, None, None] @ half.reshape(count, fields, signals, fields))[:, :, 0]
