"""The global test of the nominal model.

The statistic is the Bayes factor of "one of the single causes on the list" against "no error", so its p-value is valid for the
whole list together (family-wise), with known noise and with unknown. How it is distributed if nothing is wrong is a curve in
the degrees of freedom (`null_curve`).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from pydantic import computed_field
from scipy import special

from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.detection.alternatives import Alternatives
from tumblecal.diagnosis.detection.null_curve import log_p_value, threshold
from tumblecal.diagnosis.priors import FAR, POSITIONS_SIZE, SEVERAL_SHARE, SEVERAL_SIZE, SIZE
from tumblecal.diagnosis.sets.partial_set import nothing, with_each
from tumblecal.full_model.evidence import log_evidence_of_noise
from tumblecal.full_model.tangent import Tangent


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


def statistics(
    pool: Pool, alternatives: Alternatives | None, z: Float[np.ndarray, "draws nu"], known: bool
) -> Float[np.ndarray, " draws"]:
    """Log Bayes factor of "one cause of the list" against "adequate", for many residual vectors."""
    weights = np.concatenate([pool.test_log_weights, pool.together.test_log_weights])
    scores = with_each(pool, known, nothing(z), groups=True, jointly=True) + weights
    if alternatives is not None:
        scores = np.hstack([scores, alternatives.test_log_evidence(z, known)])
    return np.logaddexp.reduce(scores, axis=1, initial=-np.inf) - log_evidence_of_noise(
        np.vecdot(z, z), pool.dof, known
    )


def weight_of(pool: Pool, alternatives: Alternatives | None, sigma: float = 1.0) -> float:
    """Sum of the weights in the test: of the causes that noise alone, of standard deviation `sigma`, may look like, and of the
    alternatives."""
    logs, far = pool.test_log_weights.copy(), pool.offset_squares >= (FAR * sigma) ** 2
    logs[pool.faults[far]] = -np.inf
    others = [] if alternatives is None else [alternatives.test_log_weights]
    return float(np.sum(np.exp(np.concatenate([logs, pool.together.test_log_weights, *others]))))


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
    at: Tangent, pool: Pool, alternatives: Alternatives, size: float = SIZE, *, level_estimated: bool = False
) -> Detection:
    """Test the residuals of a problem.

    **Arguments:**

    - `at`, `pool`, `alternatives`: the linearised problem, its causes, and other noise models and lack of fit.
    - `size`: false alarms allowed, all causes together.
    - `level_estimated`: whether the level of a noise that counts as known was estimated from these data.
    """
    known, chi2 = at.problem.known, float(at.z @ at.z)
    statistic = statistics(pool, alternatives, at.z[None], known)[0]
    null = pool.dof, known and not level_estimated, weight_of(pool, alternatives, at.rough_level)
    return Detection(
        statistic=float(statistic),
        p_value=float(np.exp(log_p_value(statistic, *null))),
        threshold=threshold(size, *null),
        dof=pool.dof,
        chi2=chi2 if known else None,
        chi2_p_value=float(special.gammaincc(pool.dof / 2, chi2 / 2)) if known else None,
    )
