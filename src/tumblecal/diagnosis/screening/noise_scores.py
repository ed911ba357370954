"""Sets of causes under other noise models, scored together.

For a set M and a noise alternative N with covariance K on the residual space, `z` and the set's columns are whitened by K and
the evidence is that of the screen, less half the logarithm of K's determinant.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.evidence import LEAST_FREE, log_evidence, log_evidence_of_noise
from tumblecal.diagnosis.noise.alternatives import NoiseAlternatives
from tumblecal.diagnosis.noise.models import NoiseModel
from tumblecal.diagnosis.priors import MANY_OUTLIERS, SURE
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import parts_of, rows_of
from tumblecal.diagnosis.sets.prior import SetPriors, given_found
from tumblecal.diagnosis.sets.search import Search


# The alternative to a fault of the noise: none.
ASSUMED = "assumed"
_MOST_SETS = 8
# A noise model so far (log) behind, before the set is refitted with it, is not tried.
_HOPELESS = 10.0


@dataclass(frozen=True)
class NoiseChange:
    """A noise model that, with the causes `members` (indices into the pool), is more probable than the best set of causes
    under the noise as assumed; `log_odds` of all of its kind against that set.

    - `probability`: of its label, among all noise models and the noise as assumed.
    - `rival`: the best alternative, if these data do not decide.
    """

    model: NoiseModel
    members: tuple[int, ...]
    log_odds: float
    probability: float
    rival: str = ""


def many_outliers(screened: Screened) -> bool:
    """Whether so many outlying positions are named that they are rather heavy tails."""
    return sum(bool(cause.left_out) for cause in screened.members) >= MANY_OUTLIERS


def without_outliers(search: Search, members: tuple[int, ...]) -> tuple[int, ...]:
    """A set of causes less its outlying positions."""
    return tuple(k for k in members if k not in search.pool.outlying)


@dataclass(frozen=True)
class NoiseScores:
    """Noise alternatives with the sets of causes that may go with them.

    - `log_posterior`: of each set under each alternative, unnormalised, on the scale of the search's `top`; -inf where the pair
      is hopeless. A fault of the noise counts as one more cause. `total`: of all sets under the noise as assumed.
    - `without_outliers`: each set without its outlying positions, which heavy tails replace.
    """

    tried: NoiseAlternatives
    sets: list[tuple[int, ...]]
    without_outliers: list[tuple[int, ...]]
    log_posterior: Float[np.ndarray, "sets alternatives"]
    top: float
    total: float

    @classmethod
    def of(cls, screened: Screened, tried: NoiseAlternatives) -> "NoiseScores":
        """The noise alternatives of a screen, with their scores."""
        return cls.among(screened.search, _sets(screened), tried, many_outliers(screened))

    @classmethod
    def among(
        cls, search: Search, sets: list[tuple[int, ...]], tried: NoiseAlternatives, many: bool = False
    ) -> "NoiseScores":
        """Scores of some sets; `many`: whether heavy tails are also tried with outlier positions."""
        others = [without_outliers(search, members) for members in sets]
        scores = np.full((len(sets), len(tried.listed)), -np.inf)
        total = float(np.logaddexp.reduce(search.ranked().log_posterior))
        if not sets or not tried.listed:
            return cls(tried, sets, others, scores, search.top, total)
        gains = _gains(search, sets, tried)
        posterior = np.array([search.posterior(members) for members in sets])
        worth = posterior[:, None] + gains > search.top - _HOPELESS
        if not many:
            # If heavy tails replace the outlier positions of a set, its other causes are tried separately.
            whole = np.array([own == members for own, members in zip(others, sets, strict=True)], bool)
            worth &= whole[:, None] | tried.is_gaussian
        for row, members in enumerate(sets):
            if np.any(worth[row]):
                scores[row] = np.where(worth[row], _log_posterior(search, members, tried, gains[row]), -np.inf)
        return cls(tried, sets, others, scores, search.top, total)

    def most_probable(self, among: Callable[[NoiseModel], bool] = lambda _: True) -> NoiseChange | None:
        """The alternative that, with the causes that go best with it, explains the data best; None where all are hopeless."""
        kinds: dict[tuple[str, str], list[int]] = {}
        for k, model in enumerate(self.tried.listed):
            if among(model):
                kinds.setdefault((model.label, model.kind), []).append(k)
        if not self.sets or not kinds:
            return None
        # Kinds are compared by all their members together: one tried in fine steps is not worse for it.
        each = [np.logaddexp.reduce(self.log_posterior[:, columns], axis=1) for columns in kinds.values()]
        row, kind = divmod(int(np.argmax(np.stack(each, axis=1))), len(kinds))
        most = float(each[kind][row])
        if most == -np.inf:
            return None
        columns = list(kinds.values())[kind]
        k = columns[int(np.argmax(self.log_posterior[row, columns]))]
        model = self.tried.listed[k]
        members = self.sets[row] if model.tail is None else self.without_outliers[row]
        probability, rival = self._probability(model.label)
        return NoiseChange(model, members, most - self.top, probability, rival)

    def _probability(self, label: str) -> tuple[float, str]:
        """Probability of the noise models of a label; where that decides nothing, the best alternative too."""
        by_label, each = {ASSUMED: self.total}, np.logaddexp.reduce(self.log_posterior, axis=0)
        for value, model in zip(each.tolist(), self.tried.listed, strict=True):
            by_label[model.label] = float(np.logaddexp(by_label.get(model.label, -np.inf), value))
        probability = float(np.exp(by_label[label] - np.logaddexp.reduce([*by_label.values()])))
        del by_label[label]
        return probability, "" if probability >= SURE else max(by_label, key=by_label.__getitem__)


def _gains(
    search: Search, sets: list[tuple[int, ...]], tried: NoiseAlternatives
) -> Float[np.ndarray, "sets alternatives"]:
    """By how much each alternative explains better what each set leaves when it is fitted under the noise as assumed (log, with
    the alternative's prior)."""
    rest = np.stack([base.z - base.q @ (base.q.T @ base.z) for base in search.bases(sets)])
    normal = log_evidence_of_noise(np.sum(rest**2, axis=1), search.pool.dof, search.known)
    return tried.log_evidence(rest, search.known) - normal[:, None]


def _log_posterior(
    search: Search, members: tuple[int, ...], tried: NoiseAlternatives, gains: Float[np.ndarray, " alternatives"]
) -> Float[np.ndarray, " alternatives"]:
    """Log posterior of one set of causes, fitted under each alternative, unnormalised."""
    base, dof, gaussian = search.base(members), search.pool.dof, tried.is_gaussian
    # Tails are judged by what the set leaves; its own part counts as under the normal distribution.
    scores = gains + float(
        log_evidence(np.array(base.z @ base.z), base.explained(base.q.T @ base.z), dof, search.known)
    )
    if np.any(gaussian):
        white = tried.whitening.whitened(np.column_stack([base.q, base.z]))
        q, z = np.linalg.qr(white[:, :, :-1])[0], white[:, :, -1]
        total, parts = np.sum(z**2, axis=1), base.explained(np.einsum("awr,aw->ra", q, z))
        own = log_evidence(total, parts, dof, search.known)
        open_level = tried.is_level[gaussian]
        own[open_level] = log_evidence(
            total[open_level], [(part[open_level], rank) for part, rank in parts], dof, known=False
        )
        scores[gaussian] = tried.log_weights[gaussian] + own - tried.whitening.half_log_dets
    priors = SetPriors.of(search.pool, rows_of([members]))
    recorded = np.array([model.recorded for model in tried.listed], bool)
    return scores + priors.own + np.where(recorded, 0.0, given_found(priors.causes, 1))


def _sets(screened: Screened) -> list[tuple[int, ...]]:
    """The sets worth trying: nothing, those of the best explanations, and every part of the best one; none that leaves too few
    degrees of freedom to estimate a noise."""
    listed = [told for told in screened.explanations if told.members][:_MOST_SETS]
    first = listed[0].members if listed else ()
    sets = list(dict.fromkeys([*parts_of(first), *(told.members for told in listed)]))
    bases, dof = screened.search.bases(sets), screened.pool.dof
    return [members for members, base in zip(sets, bases, strict=True) if base.q.shape[1] + LEAST_FREE <= dof]
