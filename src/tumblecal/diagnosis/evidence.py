"""How well a set of effects explains the data, with what its freedom costs.

Each effect's part of the residual is projected on the space that it adds; of rank r, it explains R (in units of the
noise variance). Its coefficients are given a Gaussian prior that is isotropic in that space (Zellner's g-prior) whose
scale is unknown: log-uniform from 3 to 10000 noise standard deviations. `Occam.gain` is the logarithm of the resulting
Bayes factor, `log integral dlog(s) (1 + s^2)^(-r/2) exp(R/2 s^2/(1 + s^2)) / log range`. An unknown noise variance is
integrated out under the prior 1/sigma by Laplace's method in log sigma.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float


SMALLEST, LARGEST = 3.0, 1e4
_MOST_RANK = 12
_TABLE_END = 2000.0


@lru_cache
def _table() -> tuple[np.ndarray, np.ndarray]:
    """Bayes factors by sqrt(R) (columns) for ranks 0 to 12 (rows)."""
    root = np.linspace(0.0, np.sqrt(_TABLE_END), 2000)
    log_scale = np.linspace(np.log(SMALLEST), np.log(LARGEST), 400)
    squared = np.exp(2 * log_scale)
    exponent = 0.5 * root[:, None] ** 2 * (squared / (1 + squared))
    shift = np.max(exponent, axis=1, keepdims=True)
    rows = []
    for rank in range(_MOST_RANK + 1):
        values = exponent - shift - 0.5 * rank * np.log1p(squared)
        rows.append(np.log(np.mean(np.exp(values), axis=1)) + shift[:, 0])
    return root, np.array(rows)


def gain(explained: Float[np.ndarray, " *shape"], rank: int) -> Float[np.ndarray, " *shape"]:
    """Log Bayes factor of an effect of a rank that explains `explained` (noise variance one)."""
    root_grid, table = _table()
    row = table[min(rank, _MOST_RANK)]
    explained = np.maximum(explained, 0.0)
    root = np.sqrt(explained)
    inside = np.interp(root, root_grid, row)
    # Beyond the table the integral is R/2 - (r/2) log R + constant.
    end = row[-1] + 0.5 * (explained - _TABLE_END) - 0.5 * rank * np.log(np.maximum(explained, 1.0) / _TABLE_END)
    return np.where(explained > _TABLE_END, end, inside)


def log_evidence(
    total: Float[np.ndarray, " *shape"],
    parts: list[tuple[Float[np.ndarray, " *shape"], int]],
    dof: int,
    known: bool,
) -> Float[np.ndarray, " *shape"]:
    """Log evidence of sets of effects, up to a constant common to all sets.

    **Arguments:**

    - `total`: sum of squares before any effect.
    - `parts`: for each effect in turn the sum of squares that it explains, and its rank.
    - `dof`: dimension of the residual space.
    - `known`: whether the noise variance is one; else it is integrated out.
    """
    rank = sum(rank for _, rank in parts)
    explained = sum((part for part, _ in parts), np.zeros_like(total))
    left = np.maximum(total - explained, 1e-9 * total + 1e-300)
    free = max(dof - rank, 1)
    variance = np.ones_like(total) if known else left / free
    score = -0.5 * total / variance
    for part, own in parts:
        score = score + gain(part / variance, own)
    if not known:
        score = score - 0.5 * dof * np.log(variance) + 0.5 * np.log(np.pi / free)
    return score
