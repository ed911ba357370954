"""One data set from readings to explanations: robust start, linearisation, candidates, test, search."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis.adapt import Fit, fit_members
from tumblecal.diagnosis.candidates import Candidate, Pool, Visibility
from tumblecal.diagnosis.detect import Detection, detect
from tumblecal.diagnosis.explanations import UNEXPLAINED, Explanation, explanations
from tumblecal.diagnosis.linear import Linear, Weighting, linearise, robust_start
from tumblecal.diagnosis.model import Evaluation, Model
from tumblecal.diagnosis.noise import NoiseAlternative, alternatives, log_noise_evidence
from tumblecal.diagnosis.pool import pooled
from tumblecal.diagnosis.reference import References
from tumblecal.diagnosis.search import SIZE_PRIOR, Search


# A linear screen is trusted when the exact fit of its winner leaves the same sum of squares to within this (sigma^2).
CURVED = 1.0
MOST_RELINEARISATIONS = 2
# A signal larger than this (sigma) has spoiled the nominal fit that it was linearised around: repeated in any case.
LARGE = 25.0
# An effect with a jump is tried around its own exact fit when that leaves this much less (sigma^2) than the linear one.
KINK = 4.0
SETTLED = 0.9
FAULTS = ("swap", "mislabel", "outlier")


@dataclass(frozen=True)
class Screened:
    """What the linear screen says of one data set.

    `sigma` is the noise in units of the weighted residuals: 1 where it is known, else the best explanation's own.
    `fit`: the exact fit of the best explanation, where it was made.
    """

    linear: Linear
    pool: Pool
    seen: list[Visibility]
    noise: list[NoiseAlternative]
    detection: Detection
    explanations: list[Explanation]
    search: Search
    sigma: float
    fit: Fit | None = None

    @property
    def best(self) -> Explanation:
        """The explanation to act on: the best that is not `adequate` once something was detected."""
        if not self.detection.detected:
            return next(one for one in self.explanations if not one.labels)
        return next(one for one in self.explanations if one.labels)


@dataclass(frozen=True)
class Measured:
    """One data set as the screen takes it.

    - `model`, `where`, `readings` (g), `names`: the data and the chain with every testable effect in it.
    - `how`: weights; `given`: the weights before any correction of the noise model.
    - `references`: what plans alone decide, made once for each.
    - `at_start`: the evaluation at the model's start.
    """

    model: Model
    where: Where
    readings: Float[np.ndarray, "positions 3"]
    names: tuple[str, ...]
    how: Weighting
    given: Weighting
    references: References
    at_start: Evaluation

    def fit(self, linear: Linear, members: Sequence[Candidate]) -> Fit:
        """The exact fit of the nominal parameters with some causes, from a linearisation's."""
        start, evaluation = linear.vector, linear.evaluation
        return fit_members(self.model, self.where, self.readings, self.how, start, list(members), evaluation)


def screen(measured: Measured) -> Screened:
    """Screen one data set.

    The screen is linear around the nominal fit; where the winner's exact fit contradicts that, it is repeated around
    the exact fit.
    """
    vector = robust_start(measured.model, measured.where, measured.readings, measured.how.weights, measured.at_start)
    screened = _around(vector, measured)
    if screened.detection.detected and not _settled(screened):
        screened = _kinks_tried(screened, measured)
    for number in range(MOST_RELINEARISATIONS):
        members = [screened.pool.candidates[k] for k in screened.best.members]
        if not any(one.slot is not None for one in members):
            break
        fit = measured.fit(screened.linear, members)
        linear_left = screened.search.left(screened.best.members)
        if any(one.family == "outlier" for one in members):
            linear_left = min(linear_left, fit.chi2)
        explained = (
            screened.linear.z @ screened.linear.z - screened.search.left(screened.best.members)
        ) / screened.sigma**2
        trusted = abs(fit.chi2 - linear_left) < CURVED * screened.sigma**2 and (explained < LARGE**2 or number)
        if not fit.converged or trusted:
            screened = replace(screened, fit=fit)
            break
        again = _around(fit.vector, measured)
        if not again.detection.detected:
            break
        screened = again
    return screened


def _settled(screened: Screened) -> bool:
    """Whether a single named set is so sure that no kink needs trying."""
    return screened.best.probability > SETTLED and UNEXPLAINED not in screened.best.labels


def _kinks_tried(screened: Screened, measured: Measured) -> Screened:
    """The screen around the exact fit of an effect that jumps with an input's sign, where that explains more."""
    candidates = screened.pool.candidates
    faults = tuple(k for k in screened.best.members if candidates[k].family in FAULTS)
    for place, one in enumerate(candidates):
        if one.slot is None or not one.slot.kinked or place in screened.best.members:
            continue
        fit = measured.fit(screened.linear, [*(candidates[k] for k in faults), one])
        if fit.chi2 > screened.search.left((*faults, place)) - KINK * screened.sigma**2:
            continue
        again = _around(fit.vector, measured)
        if again.detection.detected and again.search.top > screened.search.top:
            return again
    return screened


def _around(vector: Float[np.ndarray, " full"], measured: Measured) -> Screened:
    """The screen with the model linearised at a full vector."""
    model, where, how = measured.model, measured.where, measured.how
    linear = linearise(model, where, measured.readings, how, vector)
    scale = 1.0 if how.known else _rough_sigma(linear)
    reference = measured.references.of(model, where, measured.given)
    pool, seen, _ = pooled(model, linear, where, measured.readings, measured.names, how, scale, reference.generic)
    noise = alternatives(linear, how, where)
    # Weights found from the data are those of no other data: so is their null distribution.
    null = reference.null if how is measured.given else None
    detection = detect(pool, noise, linear.z, how.known, null, scale)
    search = Search(pool, linear.z, how.known)
    if detection.detected:
        ranked = search.run()
    else:
        search.expand([()])
        ranked = search.ranked()
    members = ranked.set_at(0)
    sigma = 1.0 if how.known else search.sigma(members)
    logs = log_noise_evidence(noise, linear.z[None], how.known)[0] + np.log(SIZE_PRIOR[1])
    by_label: dict[str, float] = {}
    for one, value in zip(noise, logs, strict=True):
        by_label[one.label] = float(np.logaddexp(by_label.get(one.label, -np.inf), value))
    found = explanations(search, ranked, by_label, sigma)
    return Screened(linear, pool, seen, noise, detection, found, search, sigma)


def _rough_sigma(linear: Linear) -> float:
    """Noise from the residuals' median size, in weighted units."""
    rows = linear.basis @ linear.z
    return float(1.4826 * np.median(np.abs(rows))) or 1e-12
