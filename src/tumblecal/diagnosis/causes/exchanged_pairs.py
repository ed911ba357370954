"""Candidates for two exchanged positions: every pair of few positions; for many positions, the pairs that explain most.

Undoing an exchange subtracts its contribution from the residual z of the nominal model: with the responses R of single readings
and the difference c of the two readings, the offset o = sum over the axes of c_a (R_ia - R_ja). The remaining sum of squares,
|z - o|^2 = |z|^2 - 2 z.o + |o|^2, needs only z.R and the products of responses, and so costs next to nothing for a pair.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.priors import MOST_PAIRS, PAIRS_OF_MANY
from tumblecal.full_model.tangent import Tangent


# So many positions are paired with all others at once.
_AT_ONCE = 16


class Pairs(NamedTuple):
    """Pairs of positions, labels of their exchanges, and the number of pairs from which they were selected."""

    first: Int[np.ndarray, " pairs"]
    second: Int[np.ndarray, " pairs"]
    labels: list[str]
    of: int


def exchanged_pairs(at: Tangent, least_square: float) -> Pairs:
    """The pairs that may have been exchanged.

    **Arguments:**

    - `least_square`: smallest squared norm of the offset of a pair, if not all pairs are candidates.
    """
    names = at.problem.names
    count = len(names) * (len(names) - 1) // 2
    if count <= MOST_PAIRS:
        return _all(names)
    first, second = _likeliest(at, least_square)
    return Pairs(first, second, _labels(names, first, second), count)


@lru_cache(maxsize=64)
def _all(names: tuple[str, ...]) -> Pairs:
    first, second = np.triu_indices(len(names), 1)
    return Pairs(first, second, _labels(names, first, second), len(first))


def _labels(names: tuple[str, ...], first: np.ndarray, second: np.ndarray) -> list[str]:
    pairs = zip(first.tolist(), second.tolist(), strict=True)
    return [f"swapped_positions:{names[i]}+{names[j]}" for i, j in pairs]


def _likeliest(at: Tangent, least_square: float) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """The pairs whose exchange, undone, leaves least, in the order of their positions."""
    count, readings = len(at.problem.names), np.asarray(at.problem.readings)
    responses = at.responses.transpose(1, 2, 0)
    along, found = responses @ at.z, list[tuple[np.ndarray, np.ndarray, np.ndarray]]()
    own = np.einsum("iax,ibx->iab", responses, responses)
    flat = responses.reshape(3 * count, -1)
    for begin in range(0, count, _AT_ONCE):
        rows, others = np.arange(begin, min(begin + _AT_ONCE, count)), np.arange(begin + 1, count)
        products = flat[3 * begin : 3 * (rows[-1] + 1)] @ flat[3 * (begin + 1) :].T
        products = products.reshape(len(rows), 3, len(others), 3)
        change = readings[rows, None] - readings[others]
        mixed = np.einsum("ija,iajb,ijb->ij", change, products, change, optimize=True)
        square = _squares(change, own[rows][:, None]) + _squares(change, own[others]) - 2 * mixed
        gained = 2 * np.vecdot(change, along[rows, None] - along[others]) - square
        i, j = np.nonzero((rows[:, None] < others) & (square > least_square))
        found.append((gained[i, j], rows[i], others[j]))
    gained, first, second = (np.concatenate(parts) for parts in zip(*found, strict=True))
    kept = np.sort(np.argsort(-gained, kind="stable")[:PAIRS_OF_MANY])
    return first[kept], second[kept]


def _squares(
    change: Float[np.ndarray, "rows others 3"], products: Float[np.ndarray, "*rows 3 3"]
) -> Float[np.ndarray, "rows others"]:
    return np.vecdot((change[:, :, None] @ products)[:, :, 0], change)
