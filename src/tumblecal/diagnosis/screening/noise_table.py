"""Sets of causes (rows) and noise models (columns) as one table of log posteriors.

For a set and a noise model of covariance K on the residual space, the residual and the set's columns are weighted by K, and the
evidence is that of the screen, less half the logarithm of K's determinant.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.noise.alternatives import NoiseAlternatives
from tumblecal.diagnosis.noise.models import NoiseModel
from tumblecal.diagnosis.priors import HOPELESS_NOISE, MANY_OUTLIERS, MOST_SETS_WITH_NOISE, SURE
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import Members, parts_of, rows_of
from tumblecal.diagnosis.sets.partial_set import PartialSet
from tumblecal.diagnosis.sets.prior import SetPriors, given_found
from tumblecal.diagnosis.sets.search import Search
from tumblecal.full_model.evidence import LEAST_FREE, log_evidence, log_evidence_of_noise


# The noise as assumed, as an alternative to a fault of the noise.
ASSUMED = "assumed"


@dataclass(frozen=True)
class NoiseChange:
    """A noise model with the causes `members` (indices into the pool) that go best with it; `log_odds` of all of its kind
    against the best set under the noise as assumed.

    - `probability`: of its label, among all noise models and the noise as assumed.
    - `alternative`: the best one, if these data do not decide.
    """

    model: NoiseModel
    members: Members
    log_odds: float
    probability: float
    alternative: str = ""


def many_outliers(screened: Screened) -> bool:
    """Whether so many outlying positions are named that they are rather heavy tails."""
    return sum(bool(cause.left_out) for cause in screened.members) >= MANY_OUTLIERS


def without_outliers(search: Search, members: Members) -> Members:
    """A set of causes less its outlying positions."""
    return tuple(k for k in members if not search.pool.is_outlier[k])


@dataclass(frozen=True)
class NoiseTable:
    """Sets of causes and the noise models that may go with them.

    - `log_posterior`: unnormalised, on the scale of the search's `top`; -inf where the pair is hopeless. A fault of the noise
      counts as one more cause. `total`: of all sets under the noise as assumed.
    """

    search: Search
    noise: NoiseAlternatives
    sets: list[Members]
    log_posterior: Float[np.ndarray, "sets noises"]
    total: float

    @classmethod
    def of(cls, screened: Screened, noise: NoiseAlternatives) -> "NoiseTable":
        """Of a screen: nothing, the sets of the best explanations, and every part of the best one; none that leaves too few
        degrees of freedom to estimate a noise."""
        listed = [own.members for own in screened.explanations if own.members][:MOST_SETS_WITH_NOISE]
        sets = list(dict.fromkeys([*parts_of(listed[0] if listed else ()), *listed]))
        bases, dof = screened.search.bases(sets), screened.pool.dof
        sets = [members for members, base in zip(sets, bases, strict=True) if base.q.shape[1] + LEAST_FREE <= dof]
        if many_outliers(screened) and not np.all(noise.is_gaussian):
            # Tails stand for the outlier positions, so the noise as assumed, which needs these, is no alternative to them.
            return cls.among(screened.search, sets, noise, total=-np.inf, outliers_in_tails=True)
        return cls.among(screened.search, sets, noise)

    @classmethod
    def among(
        cls,
        search: Search,
        sets: list[Members],
        noise: NoiseAlternatives,
        *,
        total: float | None = None,
        outliers_in_tails: bool = False,
    ) -> "NoiseTable":
        """The table of some sets; `outliers_in_tails`: whether heavy tails are also tried with outlier positions."""
        total = float(np.logaddexp.reduce(search.ranked().log_posterior)) if total is None else total
        if not (sets and noise.listed):
            return cls(search, noise, sets, np.zeros((len(sets), len(noise.listed))), total)
        bases, priors = search.bases(sets), SetPriors.of(search.pool, rows_of(sets))
        # Products of each set's columns and residual, last, with each other under each covariance.
        parts = [np.column_stack([base.q, base.z]) for base in bases]
        ends = np.cumsum([part.shape[1] for part in parts]).tolist()
        whole, firsts = noise.whitening.products(np.hstack(parts)), [0, *ends[:-1]]
        products = [whole[:, a:b, a:b] for a, b in zip(firsts, ends, strict=True)]
        # Log evidence of each set under the noise as assumed.
        explained = [(np.array(base.z @ base.z), base.explained(base.q.T @ base.z)) for base in bases]
        normal = np.array([float(log_evidence(*parts, search.pool.dof, search.known)) for parts in explained])
        recorded = np.array([model.recorded for model in noise.listed], bool)
        prior = priors.own[:, None] + np.where(recorded, 0.0, given_found(priors.causes, 1)[:, None])
        gains = _gains(search, bases, noise, products)
        tried = (priors.own + normal)[:, None] + gains > search.top - HOPELESS_NOISE
        if not outliers_in_tails:
            # Heavy tails replace the outlier positions of a set: its other causes are a set of their own.
            plain = np.array([without_outliers(search, own) == own for own in sets], bool)
            tried &= plain[:, None] | noise.is_gaussian
        # Tails are judged by the residual; the part of the set counts as under the normal distribution.
        scores = normal[:, None] + gains
        for row in np.flatnonzero(tried.any(axis=1) & noise.is_gaussian.any()).tolist():
            scores[row, noise.is_gaussian] = _evidence(search, bases[row], noise, products[row])
        return cls(search, noise, sets, np.where(tried, scores + prior, -np.inf), total)

    def best(self, among: Callable[[NoiseModel], bool] = lambda _: True) -> NoiseChange | None:
        """The kind of noise that, with the causes that go best with it, explains the data best; None if all are hopeless.

        Kinds are compared by all their members together: one tried in fine steps has no disadvantage.
        """
        scores = np.where([among(model) for model in self.noise.listed], self.log_posterior, -np.inf)
        if not np.any(scores > -np.inf):
            return None
        order, first = self.noise.by_kind
        each = np.logaddexp.reduceat(scores[:, order], first, axis=1)
        row, kind = divmod(int(np.argmax(each)), len(first))
        of_kind = np.split(order, first[1:])[kind]
        model = self.noise.listed[of_kind[int(np.argmax(scores[row, of_kind]))]]
        members = self.sets[row] if model.tail is None else without_outliers(self.search, self.sets[row])
        return NoiseChange(model, members, float(each[row, kind]) - self.search.top, *self._probability(model.label))

    def _probability(self, label: str) -> tuple[float, str]:
        """Probability of the noise models of a label; if that does not decide, the best alternative too."""
        by_label, each = {ASSUMED: self.total}, np.logaddexp.reduce(self.log_posterior, axis=0)
        for value, model in zip(each.tolist(), self.noise.listed, strict=True):
            by_label[model.label] = float(np.logaddexp(by_label.get(model.label, -np.inf), value))
        probability = float(np.exp(by_label[label] - np.logaddexp.reduce([*by_label.values()])))
        del by_label[label]
        return probability, "" if probability >= SURE else max(by_label, key=by_label.__getitem__)


def _gains(
    search: Search,
    bases: list[PartialSet],
    noise: NoiseAlternatives,
    products: list[Float[np.ndarray, "noises width width"]],
) -> Float[np.ndarray, "sets noises"]:
    """By how much each noise model explains better the residual of each set that is fitted under the noise as assumed (log,
    with the model's prior)."""
    rest, squares = [], []
    for base, own in zip(bases, products, strict=True):
        along = base.q.T @ base.z
        shares = np.append(-along, 1.0)
        rest.append(base.z - base.q @ along)
        squares.append(own @ shares @ shares)
    normal = log_evidence_of_noise(np.vecdot(rest, rest), search.pool.dof, search.known)
    return noise.log_evidence(np.stack(rest), search.known, np.stack(squares, axis=1)) - normal[:, None]


def _evidence(
    search: Search, base: PartialSet, noise: NoiseAlternatives, products: Float[np.ndarray, "noises width width"]
) -> Float[np.ndarray, " noises"]:
    """Log evidence of one set, fitted under each covariance, with the noise's prior weight."""
    along = np.linalg.solve(np.linalg.cholesky(products[:, :-1, :-1]), products[:, :-1, -1:])[:, :, 0]
    total, parts, level = products[:, -1, -1], base.explained(along.T), noise.is_level[noise.is_gaussian]
    evidence = log_evidence(total, parts, search.pool.dof, search.known)
    of_level = [(part[level], rank) for part, rank in parts]
    evidence[level] = log_evidence(total[level], of_level, search.pool.dof, known=False)
    return evidence + noise.log_weights[noise.is_gaussian] - noise.whitening.half_log_dets
