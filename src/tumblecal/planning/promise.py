"""What a set of new positions is expected to settle, from the distribution of the odds after it."""

from dataclasses import dataclass

import numpy as np

from tumblecal.diagnosis.priors import LEAST_ODDS, SURE
from tumblecal.planning.value import Separation


# A result of at least this probability is promised; new positions with lower odds are not worth measuring.
PROMISED, LEAST_WORTH_ODDS = 0.9, 10.0
_DRAWS, _SEED = 400, 43
# An alternative that is excluded less often than this stays open.
_MOSTLY = 0.5
# Repetitions of a set that are tried to find a sufficient number of positions.
_REPEATS = (2, 4, 8)


@dataclass(frozen=True)
class Promise:
    """What a set of positions is expected to settle.

    - `probability`: that one explanation remains, together with those of `remaining`. `odds`: median odds of the true
      explanation and those indistinguishable from it against all others.
    - `excluded`, `remaining`: alternatives that the positions exclude if the leading explanation is true, and those that they
      do not.
    """

    probability: float
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


def promise_of(separation: Separation, repeats: int = 1) -> Promise:
    """What the new positions of all rows, each measured `repeats` times, are expected to settle.

    Each explanation in turn is the true one, by its probability; its coefficients and the noise are drawn, and the posterior
    odds of all explanations follow in closed form.
    """
    log_odds = np.append(0.0, separation.log_odds)
    weights = np.exp(log_odds - np.logaddexp.reduce(log_odds))
    scores = _scores(separation, repeats) + log_odds
    count = len(log_odds)
    # Alternatives that are separated from the leading explanation in most draws.
    excluded = np.mean(scores[0, :, :1] - scores[0] > LEAST_ODDS, axis=0) >= _MOSTLY
    group = np.where(excluded, np.arange(count), 0)
    sure, odds = np.zeros((count, _DRAWS)), np.zeros((count, _DRAWS))
    for true in range(count):
        same = group == group[true]
        of_group = np.logaddexp.reduce(scores[true][:, same], axis=1)
        if np.all(same):
            odds[true] = np.inf
            continue
        others = scores[true][:, ~same]
        odds[true] = of_group - np.logaddexp.reduce(others, axis=1)
        sure[true] = (of_group - np.max(others, axis=1) > LEAST_ODDS) & (odds[true] > np.log(SURE / (1 - SURE)))
    drawn = np.repeat(weights / _DRAWS, _DRAWS)
    order = np.argsort(odds.ravel())
    middle = odds.ravel()[order][np.searchsorted(np.cumsum(drawn[order]), 0.5)]
    decided = list(zip(separation.labels, excluded[1:].tolist(), strict=True))
    return Promise(
        float(weights @ sure.mean(axis=1)),
        float(np.exp(min(middle, 100.0))),
        tuple([labels for labels, out in decided if out]),
        tuple([labels for labels, out in decided if not out]),
    )


def positions_needed(separation: Separation) -> int | None:
    """Number of positions that settle it if the new positions are repeated; None if the largest number does not."""
    for repeats in _REPEATS:
        if promise_of(separation, repeats).made:
            return repeats * len(separation.explanations[0].new)
    return None


def _scores(separation: Separation, repeats: int) -> np.ndarray:
    """Log likelihoods of drawn new readings, by the true explanation, the draw, and the explanation that is judged."""
    predicted = separation.predictions(np.arange(len(separation.explanations[0].new))[None])
    rows = predicted[0][0].shape[1]
    # The mean of repeats has less noise.
    less = (1.0 - 1.0 / repeats) * np.eye(rows)
    noise = np.random.default_rng(_SEED).normal(size=(_DRAWS, rows))
    drawn_from = [(mean[0], np.linalg.cholesky(spread[0] - less)) for mean, spread in predicted]
    scores = np.zeros((len(drawn_from), _DRAWS, len(drawn_from)))
    for judged, (expected, root) in enumerate(drawn_from):
        inverse = np.linalg.inv(root)
        for true, (mean, true_root) in enumerate(drawn_from):
            white = (mean - expected + noise @ true_root.T) @ inverse.T
            scores[true, :, judged] = -0.5 * np.sum(white**2, axis=1) - np.sum(np.log(np.diag(root)))
    return scores
