"""What a set of new positions is expected to settle, from the distribution of the odds after it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import computed_field

from tumblecal.diagnosis.priors import LEAST_ODDS, SURE
from tumblecal.plan.next.competition import Competition
from tumblecal.plan.next.posterior import Posterior


# A result of at least this probability is promised; new positions with lower odds are not worth measuring.
PROMISED, LEAST_WORTH_ODDS = 0.9, 10.0
_DRAWS, _SEED = 400, 43
# Share of the new diagnoses in which no further explanation comes up that nothing predicted (benchmarks/blind next).
_FORESEEN = 0.93
# An alternative that is excluded less often than this stays open.
_MOSTLY = 0.5


@dataclass(frozen=True)
class Promise:
    """What a set of positions is expected to settle.

    - `probability`: that one explanation remains, together with those of `remaining`, and is the true one; `given_listed`: the
      same if an explanation that competes is true. `odds`: median odds of the true explanation and those indistinguishable
      from it against all others.
    - `excluded`, `remaining`: alternatives that the positions exclude if the leading explanation is true, and those that they
      do not.
    """

    probability: float
    given_listed: float
    odds: float
    excluded: tuple[tuple[str, ...], ...]
    remaining: tuple[tuple[str, ...], ...]

    @computed_field
    @property
    def made(self) -> bool:
        """Whether the result is probable enough to be promised."""
        return bool(self.excluded) and self.probability >= PROMISED

    @computed_field
    @property
    def worth_measuring(self) -> bool:
        """Whether the positions are worth measuring for it."""
        return bool(self.excluded) and self.odds >= LEAST_WORTH_ODDS


def promise_of(posteriors: Sequence[Posterior], competition: Competition) -> Promise:
    """What the new positions of these posteriors of the explanations are expected to settle.

    Each explanation in turn is the true one, by its probability; its coefficients and the noise are drawn, and the posterior
    odds of all explanations follow in closed form. If another explanation is true, or comes up that nothing predicted, nothing
    is settled. An alternative without a name remains: it predicts nothing.
    """
    rng, every = np.random.default_rng(_SEED), np.arange(len(posteriors[0].columns))[None]
    predicted = [known.predicted(every) for known in posteriors]
    mean = np.array([own.mean[0] for own in predicted])
    roots = np.linalg.cholesky([own.spread[0] for own in predicted])
    drawn = mean[:, None] + rng.normal(size=(_DRAWS, mean.shape[1])) @ roots.transpose(0, 2, 1)
    # Log posteriors by the true explanation, the draw, and the explanation that is judged.
    log_odds = np.append(0.0, competition.log_odds)
    rests = [
        np.sum(((drawn - own) @ inverse.T) ** 2, axis=2)
        for own, inverse in zip(mean, np.linalg.inv(roots), strict=True)
    ]
    scores = log_odds - np.sum(np.log(np.diagonal(roots, axis1=1, axis2=2)), axis=1) - 0.5 * np.stack(rests, axis=2)
    # Alternatives that are separated from the leading explanation in most draws; the others are one group with it.
    excluded = np.mean(scores[0, :, :1] - scores[0] > LEAST_ODDS, axis=0) >= _MOSTLY
    group = np.where(excluded, np.arange(len(log_odds)), 0)
    same = (group[:, None] == group)[:, None]
    of_group = np.logaddexp.reduce(np.where(same, scores, -np.inf), axis=2)
    others = np.where(same, -np.inf, scores)
    odds = of_group - np.logaddexp.reduce(others, axis=2)
    # The true causes with further ones keep their share of the probability.
    alone = 1.0 / (1.0 + np.array([[one.larger] for one in competition.competing]))
    least = np.log(SURE) - np.log(np.maximum(alone - SURE, 1e-12))
    sure = (of_group - np.max(others, axis=2) > LEAST_ODDS) & (odds > least) & np.any(excluded)
    weights = np.exp(log_odds - np.logaddexp.reduce(log_odds))
    median = np.quantile(odds, 0.5, weights=np.repeat(weights[:, None], _DRAWS, axis=1), method="inverted_cdf")
    given_listed, decided = (
        float(weights @ sure.mean(axis=1)),
        [*zip(competition.alternatives, excluded[1:], strict=True)],
    )
    return Promise(
        given_listed * (1.0 - competition.unlisted) * _FORESEEN,
        given_listed,
        float(np.exp(min(median, 100.0))),
        tuple([labels for labels, out in decided if out]),
        (*[labels for labels, out in decided if not out], *competition.unnamed),
    )
