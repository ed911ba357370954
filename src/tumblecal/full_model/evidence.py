"""Evidence of sets of causes.

Each effect's part of the residual is projected on the space that it adds; of rank r, it explains R (in units of the
noise variance). Its coefficients are given a Gaussian prior that is isotropic in that space (Zellner's g-prior) whose
scale is unknown: log-uniform from 3 to 10000 noise standard deviations. `gain` is the logarithm of the resulting
Bayes factor, `log integral dlog(s) (1 + s^2)^(-r/2) exp(R/2 s^2/(1 + s^2)) / log range`. An unknown noise variance is
integrated out under the prior 1/sigma by Laplace's method in log sigma.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int


SMALLEST, LARGEST = 3.0, 1e4
_MOST_RANK = 12
# An unknown noise needs so many degrees of freedom of its own: what leaves fewer explains anything.
LEAST_FREE = 3
_TABLE_END, _NODES = 2000.0, 4000
# A share of the total that is no more than rounding.
ROUNDING = 1e-13


@lru_cache
def _table() -> tuple[float, np.ndarray, np.ndarray]:
    """Step in sqrt(R), the Bayes factors over it (columns) for ranks 0 to 12 (rows), and their rise to the next column."""
    root = np.linspace(0.0, np.sqrt(_TABLE_END), _NODES)
    log_scale = np.linspace(np.log(SMALLEST), np.log(LARGEST), 400)
    squared = np.exp(2 * log_scale)
    shares = np.full(len(squared), 1.0 / (len(squared) - 1))
    shares[[0, -1]] /= 2
    # Every exponent is largest at the largest scale.
    seen = squared / (1 + squared)
    heights = np.exp(-0.5 * np.outer(np.log1p(squared), np.arange(_MOST_RANK + 1))) * shares[:, None]
    # In parts: whole, it is the largest array of a diagnosis.
    means = [np.exp(0.5 * part[:, None] ** 2 * (seen - seen[-1])) @ heights for part in np.array_split(root, 20)]
    table = (np.log(np.concatenate(means)) + 0.5 * root[:, None] ** 2 * seen[-1]).T.copy()
    return float(root[1]), table, np.diff(table, axis=1, append=table[:, -1:])


def gain(
    explained: Float[np.ndarray, " *shape"], rank: int | Int[np.ndarray, " *shape"]
) -> Float[np.ndarray, " *shape"]:
    """Log Bayes factor of an effect of a rank that explains `explained` (noise variance one); 0 for rank 0."""
    step, table, rise = _table()
    rank = np.minimum(rank, _MOST_RANK)
    explained = np.maximum(explained, 0.0)
    column = np.sqrt(explained) / step
    beyond = column.size > 0 and float(column.max()) > _NODES - 1
    if beyond:
        column = np.minimum(column, _NODES - 1.0)
    low = column.astype(np.int64)
    entry = low + rank * _NODES
    inside = table.take(entry) + (column - low) * rise.take(entry)
    if not beyond:
        return inside
    # Beyond the table the integral is R/2 - (r/2) log R + constant.
    further = np.maximum(explained - _TABLE_END, 0.0)
    return inside + 0.5 * further - 0.5 * rank * np.log1p(further / _TABLE_END)


def log_evidence_of_noise(total: Float[np.ndarray, " *shape"], dof: int, known: bool) -> Float[np.ndarray, " *shape"]:
    """Log evidence of noise alone that leaves `total`, the sum of squares in `dof` dimensions."""
    if known:
        return -0.5 * total
    alone = 0.5 * (np.log(np.pi / dof) + dof * (np.log(dof) - 1.0))
    return alone - 0.5 * dof * np.log(np.maximum(total, 1e-300))


def log_evidence(
    total: Float[np.ndarray, " *shape"],
    parts: Sequence[tuple[Float[np.ndarray, " *shape"], int | Int[np.ndarray, " *shape"]]],
    dof: int,
    known: bool,
) -> Float[np.ndarray, " *shape"]:
    """Log evidence of sets of effects, up to a constant common to all sets.

    **Arguments:**

    - `total`: sum of squares before any effect.
    - `parts`: for each effect in turn the sum of squares that it explains, and its rank (0: not there).
    - `dof`: dimension of the residual space.
    - `known`: whether the noise variance is one; otherwise it is integrated out, and sets that leave too few degrees of
      freedom to estimate it have none: -inf.
    """
    if not parts:
        return log_evidence_of_noise(total, dof, known)
    if known:
        score = -0.5 * total
        for part, rank in parts:
            score = score + gain(part, rank)
        return score
    left, left_free = total, dof
    for part, rank in parts:
        left, left_free = left - part, left_free - rank
    left = np.maximum(left, ROUNDING * total + 1e-300)
    free = np.maximum(left_free, 1)
    variance = left / free
    score = -0.5 * total / variance - 0.5 * dof * np.log(variance) + 0.5 * np.log(np.pi / free)
    for part, rank in parts:
        score = score + gain(part / variance, rank)
    few = left_free < LEAST_FREE
    return np.where(few, -np.inf, score) if np.any(few) else score
