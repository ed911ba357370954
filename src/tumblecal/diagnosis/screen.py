"""One data set from readings to explanations: robust start, linearisation, candidates, test, search."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Where
from tumblecal.diagnosis import generic, gross
from tumblecal.diagnosis.candidates import Candidate, Pool, Visibility, effect_candidates, pool_of
from tumblecal.diagnosis.detect import Detection, NullDistributions, detect
from tumblecal.diagnosis.explanations import Explanation, explanations
from tumblecal.diagnosis.linear import Linear, Weighting, linearise, robust_start
from tumblecal.diagnosis.model import Model
from tumblecal.diagnosis.noise import NoiseAlternative, alternatives, log_noise_evidence
from tumblecal.diagnosis.search import SIZE_PRIOR, Search


@dataclass(frozen=True)
class Screened:
    """What the linear screen says of one data set.

    `sigma` is the noise in units of the weighted residuals: 1 where it is known, else the best explanation's own.
    """

    linear: Linear
    pool: Pool
    seen: list[Visibility]
    noise: list[NoiseAlternative]
    detection: Detection
    explanations: list[Explanation]
    search: Search
    sigma: float

    @property
    def best(self) -> Explanation:
        """The explanation to act on: the best that is not `adequate` once something was detected."""
        if not self.detection.detected:
            return next(one for one in self.explanations if not one.labels)
        return next(one for one in self.explanations if one.labels)


def screen(
    model: Model,
    where: Where,
    readings: Float[np.ndarray, "positions 3"],
    names: tuple[str, ...],
    how: Weighting,
    nulls: NullDistributions,
    key: tuple,
) -> Screened:
    """Screen one data set.

    **Arguments:**

    - `model`, `where`, `readings`, `names`, `how`: the data, their model and weights.
    - `nulls`, `key`: null distributions already drawn, and the key of this plan.
    """
    vector = robust_start(model, where, readings, how.weights)
    linear = linearise(model, where, readings, how, vector)
    scale = 1.0 if how.known else _rough_sigma(linear)
    effects, seen = effect_candidates(model, linear)
    candidates: list[Candidate] = [
        *effects,
        *gross.outliers(linear, how, names),
        *gross.swaps(linear, how, readings, where, names, scale),
        *gross.mislabels(model, linear, how, where, names, scale),
        *generic.candidates(model, linear, how, where, effects),
    ]
    pool = pool_of(candidates, linear.dof)
    noise = alternatives(linear, how, where)
    null = nulls.of((*key, how.known), scaled(pool, scale), noise, how.known)
    detection = detect(pool, noise, linear.z, how.known, null)
    search = Search(pool, linear.z, how.known)
    if detection.detected:
        scored = search.run()
    else:
        search.expand(())
        scored = search.ranked()
    members = scored[0].members
    sigma = 1.0 if how.known else search.sigma(members)
    logs = log_noise_evidence(noise, linear.z[None], how.known)[0] + np.log(SIZE_PRIOR[1])
    by_label: dict[str, float] = {}
    for one, value in zip(noise, logs, strict=True):
        by_label[one.label] = float(np.logaddexp(by_label.get(one.label, -np.inf), value))
    found = explanations(search, scored, by_label, sigma)
    return Screened(linear, pool, seen, noise, detection, found, search, sigma)


def _rough_sigma(linear: Linear) -> float:
    """Noise from the residuals' median size, in weighted units."""
    rows = linear.basis @ linear.z
    return float(1.4826 * np.median(np.abs(rows))) or 1e-12


def scaled(pool: Pool, sigma: float) -> Pool:
    """The pool for residuals counted in units of sigma."""
    from dataclasses import replace

    if sigma == 1.0:
        return pool
    members = tuple(
        one if one.offset is None else replace(one, offset=one.offset / sigma) for one in pool.candidates
    )
    return Pool(members, pool.dof)
