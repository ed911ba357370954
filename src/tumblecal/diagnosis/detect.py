"""Evidence, and the test: is anything wrong at all?

Each effect's part of the residual is projected on the space that it adds; of rank r, it explains R (in units of the
noise variance). Its coefficients are given a Gaussian prior that is isotropic in that space (Zellner's g-prior) whose
scale is unknown: log-uniform from 3 to 10000 noise standard deviations. `gain` is the logarithm of the resulting
Bayes factor, `log integral dlog(s) (1 + s^2)^(-r/2) exp(R/2 s^2/(1 + s^2)) / log range`. An unknown noise variance is
integrated out under the prior 1/sigma by Laplace's method in log sigma.

The statistic is the Bayes factor of "one of the single causes on the list" against "nothing is wrong". Its null
distribution is drawn on the residual space: the projection is fixed, so thousands of draws cost a few matrix products.
The p-value therefore holds for the whole list together (family-wise), with known noise and with unknown. Beyond the
draws, Ville's inequality P(Bayes factor > c) <= 1/c bounds it. The draws are those of the plan; where they leave the
decision close, the data set's own are drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy import special

from tumblecal.diagnosis.noise_causes import NoiseAlternative, log_noise_evidence
from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.tangent import Tangent
from tumblecal.diagnosis.tuning import CLOSE, DRAWS, NOISE_SHARE, SIZE


SMALLEST, LARGEST = 3.0, 1e4
_MOST_RANK = 12
_TABLE_END, _NODES = 2000.0, 4000
# Noise comes this far (sigma) once in 10^17 draws.
FAR = 17.0
SEED = 20160319
_CHUNK = 500


@lru_cache
def _table() -> tuple[float, np.ndarray]:
    """Step in sqrt(R), and the Bayes factors over it (columns) for ranks 0 to 12 (rows)."""
    root = np.linspace(0.0, np.sqrt(_TABLE_END), _NODES)
    log_scale = np.linspace(np.log(SMALLEST), np.log(LARGEST), 400)
    squared = np.exp(2 * log_scale)
    exponent = 0.5 * root[:, None] ** 2 * (squared / (1 + squared))
    shift = np.max(exponent, axis=1, keepdims=True)
    shares = np.full(len(squared), 1.0 / (len(squared) - 1))
    shares[[0, -1]] /= 2
    grown = np.exp(exponent - shift) * shares
    means = grown @ np.exp(-0.5 * np.outer(np.log1p(squared), np.arange(_MOST_RANK + 1)))
    return float(root[1]), (np.log(means) + shift).T.copy()


def gain(
    explained: Float[np.ndarray, " *shape"], rank: int | Int[np.ndarray, " *shape"]
) -> Float[np.ndarray, " *shape"]:
    """Log Bayes factor of an effect of a rank that explains `explained` (noise variance one); 0 for rank 0."""
    step, table = _table()
    rank = np.minimum(rank, _MOST_RANK)
    explained = np.maximum(explained, 0.0)
    place = np.minimum(np.sqrt(explained) / step, _NODES - 1.0)
    low = np.minimum(place.astype(np.int64), _NODES - 2)
    part = place - low
    inside = table[rank, low] * (1 - part) + table[rank, low + 1] * part
    # Beyond the table the integral is R/2 - (r/2) log R + constant.
    beyond = np.maximum(explained - _TABLE_END, 0.0)
    return inside + 0.5 * beyond - 0.5 * rank * np.log1p(beyond / _TABLE_END)


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
    - `known`: whether the noise variance is one; else it is integrated out.
    """
    explained = sum((part for part, _ in parts), np.zeros_like(total))
    left = np.maximum(total - explained, 1e-9 * total + 1e-300)
    free = np.maximum(dof - sum((rank for _, rank in parts), 0), 1)
    variance = np.ones(()) if known else left / free
    score = -0.5 * total / variance
    for part, rank in parts:
        score = score + gain(part / variance, rank)
    if not known:
        score = score - 0.5 * dof * np.log(variance) + 0.5 * np.log(np.pi / free)
    return score


@dataclass(frozen=True)
class Detection:
    """Outcome of the test.

    - `statistic`: log Bayes factor of "one cause of the list" against "adequate"; `p_value` of it, for the whole list.
    - `chi2`, `dof`, `chi2_p_value`: omnibus test, None where the noise is not known.
    - `threshold`: statistic above which the data are not adequate.
    """

    statistic: float
    p_value: float
    threshold: float
    dof: int
    chi2: float
    chi2_p_value: float | None

    @property
    def detected(self) -> bool:
        """Whether the data contradict the nominal model."""
        return self.statistic > self.threshold


def null_distribution(pool: Pool, noise: list[NoiseAlternative], known: bool) -> Float[np.ndarray, " draws"]:
    """Sorted statistics of data in which nothing is wrong."""
    rng, near = np.random.default_rng(SEED), _near(pool)
    chunks = [statistics(near, noise, rng.standard_normal((_CHUNK, pool.dof)), known) for _ in range(DRAWS // _CHUNK)]
    return np.sort(np.concatenate(chunks))


def _near(pool: Pool) -> Pool:
    """Without the faults so large that pure noise never looks like them."""
    kept = (cause for cause in pool.causes if cause.offset is None or np.linalg.norm(cause.offset) < FAR)
    return Pool(tuple(kept), pool.dof)


def statistics(
    pool: Pool, noise: list[NoiseAlternative], z: Float[np.ndarray, "draws nu"], known: bool
) -> Float[np.ndarray, " draws"]:
    """Log Bayes factor of "one cause of the list" against "adequate", for many residual vectors."""
    total = np.sum(z**2, axis=1)
    null = log_evidence(total, [], pool.dof, known)
    along = z @ pool.stacked
    scores = np.full((len(z), 1), -np.inf)[:, :0]
    for rank, (indices, columns) in pool.by_rank.items():
        explained = np.sum(along[:, columns] ** 2, axis=2)
        totals = np.broadcast_to(total[:, None], explained.shape)
        score = log_evidence(totals, [(explained, rank)], pool.dof, known) + pool.test_log_weights[indices]
        scores = np.hstack([scores, score])
    if len(pool.faults):
        totals = total[:, None] - 2 * z @ pool.offsets + pool.offset_squares
        scores = np.hstack([scores, log_evidence(totals, [], pool.dof, known) + pool.test_log_weights[pool.faults]])
    if noise:
        scores = np.hstack([scores, log_noise_evidence(noise, z, known) + np.log(NOISE_SHARE)])
    return special.logsumexp(scores, axis=1) - null


def detect(
    at: Tangent,
    pool: Pool,
    noise: list[NoiseAlternative],
    null: Float[np.ndarray, " draws"] | None,
    size: float = SIZE,
) -> Detection:
    """Test what a problem leaves.

    **Arguments:**

    - `at`, `pool`, `noise`: the linearised problem, its causes and its noise alternatives.
    - `null`: null distribution of the plan; None: the data set's own is drawn in any case.
    - `size`: false alarms allowed, all causes together.
    """
    z, known = at.z, at.problem.known
    statistic = float(statistics(pool, noise, z[None], known)[0])
    if null is None or size / CLOSE < _p_value(statistic, null) < size * CLOSE:
        null = null_distribution(pool.in_units_of(at.rough_level), noise, known)
    chi2 = float(z @ z)
    return Detection(
        statistic=statistic,
        p_value=_p_value(statistic, null),
        threshold=float(np.quantile(null, 1 - size)),
        dof=pool.dof,
        chi2=chi2,
        chi2_p_value=float(special.gammaincc(pool.dof / 2, chi2 / 2)) if known else None,
    )


def _p_value(statistic: float, null: Float[np.ndarray, " draws"]) -> float:
    above = len(null) - int(np.searchsorted(null, statistic))
    p_value = (above + 1) / (len(null) + 1)
    return min(p_value, float(np.exp(-statistic))) if above == 0 else p_value
