"""What a set of new positions is expected to settle, from the distribution of the odds after it."""

from dataclasses import dataclass

import numpy as np

from tumblecal.diagnosis.priors import LEAST_ODDS, SURE
from tumblecal.planning.alternatives import Competition
from tumblecal.planning.value import Separation


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

    @property
    def made(self) -> bool:
        """Whether the result is probable enough to be promised."""
        return bool(self.excluded) and self.probability >= PROMISED

    @property
    def worth_measuring(self) -> bool:
        """Whether the positions are worth measuring for it."""
        return bool(self.excluded) and self.odds >= LEAST_WORTH_ODDS


def promise_of(separation: Separation, competition: Competition) -> Promise:
    """What the new positions of all rows are expected to settle.

    Each explanation in turn is the true one, by its probability; its coefficients and the noise are drawn, and the posterior
    odds of all explanations follow in closed form. If another explanation is true, or comes up that nothing predicted, nothing
    is settled. An alternative without a name remains: it predicts nothing.
    """
    log_odds = np.append(0.0, separation.log_odds)
    weights = np.exp(log_odds - np.logaddexp.reduce(log_odds))
    scores = _scores(separation) + log_odds
    # The true causes with further ones keep their share of the probability, but for chance: half of chi-squared of one degree
    # of freedom in its logarithm.
    chance = np.exp(0.5 * (np.random.default_rng(_SEED).chisquare(1, _DRAWS) - 1.0))
    alone = 1.0 / (1.0 + np.array(separation.larger)[:, None] * chance)
    sure_odds = np.log(SURE) - np.log(np.maximum(alone - SURE, 1e-12))
    # Alternatives that are separated from the leading explanation in most draws; the others are one group with it.
    excluded = np.mean(scores[0, :, :1] - scores[0] > LEAST_ODDS, axis=0) >= _MOSTLY
    group = np.where(excluded, np.arange(len(log_odds)), 0)
    same = (group[:, None] == group)[:, None]
    of_group = np.logaddexp.reduce(np.where(same, scores, -np.inf), axis=2)
    others = np.where(same, -np.inf, scores)
    odds = of_group - np.logaddexp.reduce(others, axis=2)
    sure = (of_group - np.max(others, axis=2) > LEAST_ODDS) & (odds > sure_odds) & np.any(excluded)
    median = np.quantile(odds, 0.5, weights=np.repeat(weights[:, None], _DRAWS, axis=1), method="inverted_cdf")
    decided = list(zip(separation.labels, excluded[1:].tolist(), strict=True))
    given_listed = float(weights @ sure.mean(axis=1))
    return Promise(
        given_listed * (1.0 - competition.unlisted) * _FORESEEN,
        given_listed,
        float(np.exp(min(median, 100.0))),
        tuple([labels for labels, out in decided if out]),
        (*[labels for labels, out in decided if not out], *competition.unnamed),
    )


def _scores(separation: Separation) -> np.ndarray:
    """Log likelihoods of drawn new readings, by the true explanation, the draw, and the explanation that is judged."""
    every = np.arange(len(separation.explanations[0].new))[None]
    predicted = [known.predicted(every) for known in separation.explanations]
    noise = np.random.default_rng(_SEED).normal(size=(_DRAWS, predicted[0][0].shape[1]))
    drawn_from = [(mean[0], np.linalg.cholesky(spread[0])) for mean, spread in predicted]
    scores = np.zeros((len(drawn_from), _DRAWS, len(drawn_from)))
    for judged, (expected, root) in enumerate(drawn_from):
        inverse = np.linalg.inv(root)
        for true, (mean, true_root) in enumerate(drawn_from):
            white = (mean - expected + noise @ true_root.T) @ inverse.T
            scores[true, :, judged] = -0.5 * np.sum(white**2, axis=1) - np.sum(np.log(np.diag(root)))
    return scores
