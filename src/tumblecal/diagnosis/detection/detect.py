"""The global test of the nominal model.

The statistic is the Bayes factor of "one of the single causes on the list" against "no error". Its null distribution is drawn
on the residual space: the projection is fixed, so thousands of draws cost a few matrix products. The p-value is therefore
valid for the whole list together (family-wise), with known noise and with unknown. Beyond the draws, Ville's inequality
P(Bayes factor > c) <= 1/c bounds it. The draws are those of the plan, of white noise, which come close to those of any other
(up to p = 0.1 within a tenth); if the decision is close, those of the data set are drawn, unless it differs from the plan by
small angles alone.
"""

import hashlib
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from pydantic import computed_field
from scipy import special

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.detection.alternatives import Alternatives
from tumblecal.diagnosis.priors import (
    CLOSE,
    CLOSE_HAND_HELD,
    DRAWS,
    FAR,
    OWN_DRAWS_ABOVE,
    POSITIONS_SIZE,
    SEVERAL_SHARE,
    SEVERAL_SIZE,
    SIZE,
)
from tumblecal.full_model.evidence import log_evidence, log_evidence_of_noise
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.program_cache import program_cache, sources_digest


SEED = 20160319
# So many draws times coefficients at once, which fit into a cache; of large plans no fewer draws than the second number,
# because every part reads all signals from memory.
_AT_ONCE, _LEAST_AT_ONCE = 180_000, 150
# Null distributions on disk, and the residual vectors whose scores are a part of their keys.
_PREFIX, _MOST_KEPT, _KEY_VECTORS = "null-", 200, 4


@dataclass(frozen=True)
class Detection:
    """Outcome of the test.

    - `statistic`: log Bayes factor of "one cause of the list" against "adequate", or the statistic that replaced it; its
      `p_value` for the whole list.
    - `chi2`, `dof`, `chi2_p_value`: omnibus test, None for unknown noise.
    - `threshold`: statistic above which the data are not adequate.
    """

    statistic: float
    p_value: float
    threshold: float
    dof: int
    chi2: float | None
    chi2_p_value: float | None

    @computed_field
    @property
    def noise(self) -> str:
        """Whether the noise is `stated` or `estimated`."""
        return "estimated" if self.chi2 is None else "stated"

    @property
    def detected(self) -> bool:
        """Whether the data contradict the nominal model."""
        return self.statistic > self.threshold


def null_distribution(
    pool: Pool, alternatives: Alternatives | None, known: bool, draws: int = DRAWS
) -> Float[np.ndarray, " draws"]:
    """Sorted statistics of data without errors."""
    rng, near = np.random.default_rng(SEED), _near(pool)
    count = min(1 + draws * near.stacked.shape[1] // _AT_ONCE, 1 + draws // _LEAST_AT_ONCE)
    parts = np.array_split(np.arange(draws), count)
    chunks = [statistics(near, alternatives, rng.standard_normal((len(part), pool.dof)), known) for part in parts]
    return np.sort(np.concatenate(chunks))


def kept_null(pool: Pool, alternatives: Alternatives, known: bool) -> Float[np.ndarray, " draws"]:
    """`null_distribution`, from disk where it was drawn before and programs are kept.

    Its key contains the inputs of the draws: the scores of every cause for a few residual vectors, which are unique for plan,
    catalogue and noise, and the sources.
    """
    cache = program_cache()
    if cache is None:
        return null_distribution(pool, alternatives, known)
    vectors = np.random.default_rng(SEED).standard_normal((_KEY_VECTORS, pool.dof))
    digest = hashlib.sha256(sources_digest("diagnosis", "full_model", "noise").encode())
    for array in (*scores_of_each(pool, alternatives, vectors, known), np.array([pool.dof, known, DRAWS])):
        digest.update(repr(array.shape).encode() + array.tobytes())
    name = f"{_PREFIX}{digest.hexdigest()[:32]}"
    payload = cache.get(name)
    if payload is not None:
        return np.frombuffer(payload)
    drawn = null_distribution(pool, alternatives, known)
    cache.put(name, drawn.tobytes())
    cache.keep_newest(_PREFIX, _MOST_KEPT)
    return drawn


def _near(pool: Pool) -> Pool:
    """Without the faults so large that pure noise never looks like them."""
    far = pool.faults[pool.offset_squares >= FAR**2]
    return pool.only(np.setdiff1d(np.arange(pool.size), far))


def statistics(
    pool: Pool, alternatives: Alternatives | None, z: Float[np.ndarray, "draws nu"], known: bool
) -> Float[np.ndarray, " draws"]:
    """Log Bayes factor of "one cause of the list" against "adequate", for many residual vectors."""
    scores = scores_of_each(pool, alternatives, z, known)
    highest = np.max([np.max(score, axis=1, initial=-np.inf) for score in scores], axis=0)
    together = sum(np.sum(np.exp(score - highest[:, None]), axis=1) for score in scores)
    return highest + np.log(together) - log_evidence_of_noise(np.sum(z**2, axis=1), pool.dof, known)


def scores_of_each(
    pool: Pool, alternatives: Alternatives | None, z: Float[np.ndarray, "draws nu"], known: bool
) -> list[Float[np.ndarray, "draws causes"]]:
    """Log evidence with its weight in the test of each cause, family and alternative, in parts of the list."""
    total, scores = np.sum(z**2, axis=1), [np.zeros((len(z), 0))]
    for tested in pool.tested:
        if len(tested.ranks):
            explained = np.add.reduceat((z @ tested.columns) ** 2, tested.first, axis=1)
            totals = np.broadcast_to(total[:, None], explained.shape)
            scores.append(log_evidence(totals, [(explained, tested.ranks)], pool.dof, known) + tested.log_weights)
    if len(pool.faults):
        totals = total[:, None] - 2 * z @ pool.offsets + pool.offset_squares
        scores.append(log_evidence_of_noise(totals, pool.dof, known) + pool.test_log_weights[pool.faults])
    if alternatives is not None:
        scores.append(alternatives.test_log_evidence(z, known))
    return scores


def detected_together(detection: Detection, log_odds: float, size: float = SIZE) -> Detection:
    """The outcome where several causes together contradict the nominal model, each hidden by the others' part of an
    unknown noise; the same outcome where they do not.

    **Arguments:**

    - `log_odds`: Bayes factor of all sets of causes against "adequate". Ville's inequality bounds its p-value; of noise
      alone the share above any value is at most `SEVERAL_SHARE` of that bound.
    """
    threshold = float(np.log(SEVERAL_SHARE / SEVERAL_SIZE / size))
    p_value = SEVERAL_SHARE * float(np.exp(-max(log_odds, 0.0)))
    return _detected_by(detection, log_odds, threshold, p_value)


def detected_positions(detection: Detection, p_value: float, size: float = SIZE) -> Detection:
    """The outcome if a few positions together contradict the nominal model, with its p-value; otherwise the given outcome."""
    threshold = -float(np.log(POSITIONS_SIZE * size))
    return _detected_by(detection, -float(np.log(p_value)), threshold, p_value)


def _detected_by(detection: Detection, statistic: float, threshold: float, p_value: float) -> Detection:
    """The outcome of another test where that detects what the first did not; else the first's."""
    if detection.detected or statistic <= threshold:
        return detection
    return replace(detection, statistic=statistic, threshold=threshold, p_value=p_value)


def detect(
    at: Tangent,
    pool: Pool,
    alternatives: Alternatives,
    null: Float[np.ndarray, " draws"],
    size: float = SIZE,
    *,
    null_of_data: bool = True,
) -> Detection:
    """Test the residuals of a problem.

    **Arguments:**

    - `at`, `pool`, `alternatives`: the linearised problem, its causes, and other noise models and lack of fit.
    - `null`: null distribution of the plan.
    - `size`: false alarms allowed, all causes together.
    - `null_of_data`: whether the null distribution of these data may differ from that of the plan.
    """
    z, known = at.z, at.problem.known
    statistic = float(statistics(pool, alternatives, z[None], known)[0])
    close = CLOSE_HAND_HELD if at.model.hand_held else CLOSE
    if null_of_data and size / close < _p_value(statistic, null) < size * close:
        draws = min(DRAWS, round(OWN_DRAWS_ABOVE / size))
        null = null_distribution(pool.in_units_of(at.rough_level), alternatives, known, draws)
    chi2 = float(z @ z)
    return Detection(
        statistic=statistic,
        p_value=_p_value(statistic, null),
        threshold=_quantile(null, 1 - size),
        dof=pool.dof,
        chi2=chi2 if known else None,
        chi2_p_value=float(special.gammaincc(pool.dof / 2, chi2 / 2)) if known else None,
    )


def _quantile(null: Float[np.ndarray, " draws"], share: float) -> float:
    """The value that this share of sorted draws lies below."""
    return float(np.interp(share * (len(null) - 1), np.arange(len(null)), null))


def _p_value(statistic: float, null: Float[np.ndarray, " draws"]) -> float:
    above = len(null) - int(np.searchsorted(null, statistic))
    p_value = (above + 1) / (len(null) + 1)
    return min(p_value, float(np.exp(-statistic))) if above == 0 else p_value
