"""Positions that separate the leading explanations: chosen one by one, under the conditions of least effort, with the odds that
they are expected to give.

Each explanation predicts new readings as a normal distribution, by its fit to the data with the uncertainty of all its
coefficients. A position adds its rows to an information matrix, so the value of every proposal given those already chosen costs
a few small products.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from pydantic import computed_field

from tumblecal.diagnosis.priors import LEAST_ODDS, SURE
from tumblecal.plan.next.competition import Competition, Predicted
from tumblecal.plan.next.conditions import Conditions, candidates, continued
from tumblecal.plan.next.proposals import NextPosition, by_pitch
from tumblecal.plan.next.rows import Posterior, Prediction, Spots


MOST_IN_SET = 12
# Single proposals.
MOST = 6
# Separated: the odds of the alternatives together are expected to fall by e^20, so that they almost always fall by e^4, also
# against sets of causes that are not listed.
DECIDED = 20.0
# A position with new unknown parameters counts for so many: a new pitch setting or mounting is more work.
_EFFORT = 2.0
# A proposal that adds less than this to the log Bayes factor is omitted.
LEAST_STEP = 0.2
# No conditions of more effort are tried if a result is this probable.
_SURE = 0.95
# A result of at least this probability is promised; new positions with lower odds are not worth measuring.
PROMISED, LEAST_WORTH_ODDS = 0.9, 10.0
_DRAWS, _SEED = 400, 43
# Share of the new diagnoses in which no further explanation comes up that nothing predicted (benchmarks/blind next).
_FORESEEN = 0.93
# An alternative that is excluded less often than this stays open.
_MOSTLY = 0.5

Gains = Callable[[Sequence[Posterior], Spots], Float[np.ndarray, "parts proposals"]]


def separations(posteriors: Sequence[Posterior], spots: Spots) -> Float[np.ndarray, "alternatives proposals"]:
    """Expected log Bayes factor between the leading explanation and each alternative: the smaller Kullback-Leibler divergence
    between the two predictions, as either may be true."""
    leader, *others = (known.predicted(spots) for known in posteriors)
    return np.maximum([np.minimum(_divergence(leader, one), _divergence(one, leader)) for one in others], 0.0)


def _divergence(one: Prediction, other: Prediction) -> Float[np.ndarray, " proposals"]:
    """Kullback-Leibler divergence of another normal distribution from one."""
    rest = (one.mean - other.mean)[:, :, None]
    solved = np.linalg.solve(other.spread, np.concatenate([one.spread, rest], axis=2))
    traces = np.trace(solved[:, :, :-1], axis1=1, axis2=2) - rest.shape[1]
    squares = np.sum(rest[:, :, 0] * solved[:, :, -1], axis=1)
    return 0.5 * (traces + squares + np.linalg.slogdet(other.spread)[1] - np.linalg.slogdet(one.spread)[1])


def sharpenings(watched: Sequence[int]) -> Gains:
    """Decrease of the logarithm of the largest standard uncertainty among some coefficients; one part."""

    def gains(posteriors: Sequence[Posterior], spots: Spots) -> Float[np.ndarray, "1 proposals"]:
        covariance = posteriors[0].covariance
        across, before = posteriors[0].rows(spots) @ covariance[:, watched], np.diag(covariance)[watched]
        less = np.sum(across * np.linalg.solve(posteriors[0].predicted(spots).spread, across), axis=1)
        share = np.max(before - less, axis=1) / np.max(before)
        return -0.5 * np.log(np.maximum(share, 1e-24))[None]

    return gains


class Value:
    """What proposals add to a set, in natural logarithms.

    **Arguments:**

    - `posteriors`: of the explanations, the leading one first.
    - `gains`: of each proposal, in as many parts as there are `log_odds`.
    - `log_odds`: of each part: the value is the decrease of the logarithm of the sum of all odds.
    - `needed`: the value of a complete set, also if one of its positions turns out to be an outlier.
    """

    def __init__(
        self, posteriors: Sequence[Posterior], gains: Gains, log_odds: np.ndarray, needed: float = DECIDED
    ) -> None:
        self._posteriors, self._gains, self._log_odds = posteriors, gains, log_odds
        self._gained, self._needed, self._most = np.zeros((len(log_odds), 1)), needed, 0.0

    def of(self, cells: Sequence[np.ndarray]) -> Float[np.ndarray, " proposals"]:
        """The value that each proposal adds."""
        gains, counts = np.empty((len(self._log_odds), len(cells))), np.array([len(each) for each in cells])
        for count in np.unique(counts):
            numbers = np.flatnonzero(counts == count)
            gains[:, numbers] = self._gains(self._posteriors, np.stack([cells[k] for k in numbers.tolist()]))
        return self._total(gains + self._gained) - self.total

    @property
    def total(self) -> float:
        """The value of the set."""
        return float(self._total(self._gained)[0])

    @property
    def lacking(self) -> float:
        """What the set lacks, without the position that adds most."""
        return max(self._needed - self.total + self._most, 0.0)

    def take(self, cells: np.ndarray) -> float:
        """Add a proposal to the set, with the readings that the leading explanation predicts; the value that it adds."""
        before = self.total
        self._gained = self._gained + self._gains(self._posteriors, cells[None])
        expected = self._posteriors[0].predicted(cells[None]).mean[0]
        self._posteriors = [known.after(cells, expected) for known in self._posteriors]
        added = self.total - before
        self._most = max(self._most, added / len(cells))
        return added

    def _total(self, gains: Float[np.ndarray, "parts proposals"]) -> Float[np.ndarray, " proposals"]:
        return np.logaddexp.reduce(self._log_odds) - np.logaddexp.reduce(self._log_odds[:, None] - gains, axis=0)


def best_of(
    listed: Sequence[NextPosition], cells: Sequence[np.ndarray], value: Value, least: float
) -> list[NextPosition]:
    """The best single proposals with their values: at most `MOST`, each with a value above `least`; `cells`: of each."""
    values = np.where([one.needs_others for one in listed], 0.0, value.of(cells))
    order = np.argsort(-values, kind="stable")[:MOST].tolist()
    return [replace(listed[k], value=float(values[k])) for k in order if values[k] > least]


def greedy(
    listed: Sequence[NextPosition],
    cells: Sequence[np.ndarray],
    value: Value,
    least: Float[np.ndarray, " listed"] | float,
    settings: Collection[float],
) -> list[NextPosition]:
    """A set in the order in which it is measured, chosen one by one, each the best per position given those before it, with the
    value that each adds.

    **Arguments:**

    - `least`: the value of each proposal below which it is not added. `settings`: measured pitch settings, deg.
    """
    chosen, spent = list[NextPosition](), set[tuple[str, float, float]]()
    places = [{(one.mount, one.beta_deg, alpha) for alpha in one.angles_deg} for one in listed]
    effort = [len(one.angles_deg) * (_EFFORT if one.mount or one.beta_deg not in settings else 1.0) for one in listed]
    while value.lacking > 0.0:
        values, mounts = value.of(cells), {mount for mount, _, _ in spent}
        # The same position is not proposed twice: a turn of four is part of that of eight.
        fits = [
            len(own) <= MOST_IN_SET - len(spent) and not spent & own and (not one.needs_others or one.mount in mounts)
            for one, own in zip(listed, places, strict=True)
        ]
        usable = np.array(fits) & (values >= least)
        if not np.any(usable):
            break
        best = int(np.argmax(np.where(usable, np.minimum(values, value.lacking) / effort, 0.0)))
        chosen.append(replace(listed[best], value=value.take(cells[best])))
        spent |= places[best]
    return by_pitch(chosen)


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

    def better(self, than: "Promise") -> bool:
        """Whether it is better than another one: fewer alternatives remain, or it is more probable by a twentieth."""
        rank, other = ((one.given_listed >= PROMISED, one.worth_measuring, -len(one.remaining)) for one in (self, than))
        return rank > other or (rank == other and self.given_listed > than.given_listed + 0.05)


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
    drawn = mean[:, None] + rng.normal(size=(_DRAWS, mean.shape[1])) @ roots.swapaxes(1, 2)
    # Log posteriors by the true explanation, the draw, and the explanation that is judged.
    log_odds = np.append(0.0, competition.log_odds)
    pairs = zip(mean, np.linalg.inv(roots), strict=True)
    rests = np.stack([np.sum(((drawn - own) @ inverse.T) ** 2, axis=2) for own, inverse in pairs], axis=2)
    scores = log_odds - np.sum(np.log(np.diagonal(roots, axis1=1, axis2=2)), axis=1) - 0.5 * rests
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
    given_listed, out = (
        float(weights @ sure.mean(axis=1)),
        dict(zip(competition.alternatives, excluded[1:], strict=True)),
    )
    return Promise(
        given_listed * (1.0 - competition.unlisted) * _FORESEEN,
        given_listed,
        float(np.exp(min(median, 100.0))),
        tuple([labels for labels in out if out[labels]]),
        (*[labels for labels in out if not out[labels]], *competition.unnamed),
    )


@dataclass(frozen=True)
class Separated:
    """Positions that separate explanations.

    - `conditions`: under which they are measured. `predicted`: all proposals under them.
    - `ordered`: the positions, one after another, each with the expected log Bayes factor that it adds. `in_reverse`: whether
      they are the last run in the reverse order.
    - `promise`: what they settle. `counted`: the alternatives that they exclude, all if none.
    """

    conditions: Conditions
    predicted: Predicted
    ordered: list[NextPosition]
    promise: Promise
    counted: Bool[np.ndarray, " alternatives"]
    in_reverse: bool = False


def separation(competition: Competition, predicted: Predicted, counted: Bool[np.ndarray, " alternatives"]) -> Value:
    """The value of separating the leading explanation from some alternatives (`counted`, for each of them)."""
    leader, *others = predicted.posteriors
    counting = [other for other, counts in zip(others, counted, strict=True) if counts]
    return Value([leader, *counting], separations, competition.log_odds[counted])


def separate(
    competition: Competition, first: Predicted, listed: list[NextPosition], again: list[NextPosition]
) -> Separated | None:
    """The positions that separate the explanations under the conditions of least effort; None if none do.

    **Arguments:**

    - `first`: all proposals `listed`, directly after the data.
    - `again`: the last run in the reverse order, which is evaluated if no conditions are sure to settle it.
    """
    data, best = competition.diagnosis.data, None
    needs = {name for one in competition.competing for cause in one.causes for name in cause.slot.needs}
    if not competition.alternatives:
        return None
    here = continued(data)

    def measured(ordered: list[NextPosition], conditions: Conditions, predicted: Predicted) -> Separated:
        """Positions that are measured one after another: the value that each adds, and what they settle together."""
        in_order = competition.at(ordered, conditions)
        promise = promise_of(in_order.posteriors, competition)
        excluded = promise.excluded or competition.alternatives
        counted = np.array([labels in excluded for labels in competition.alternatives])
        value, pairs = separation(competition, in_order, counted), zip(ordered, in_order.rows.cells, strict=True)
        valued = [replace(one, value=value.take(cells)) for one, cells in pairs]
        return Separated(conditions, predicted, valued, promise, counted)

    for conditions in candidates(data, in_time="time_s" in needs, with_temperature="temperature_degc" in needs):
        predicted = first if conditions == here else competition.at(listed, conditions._replace(step_s=0.0))
        every = np.arange(len(predicted.rows.new))[None]
        (expected, _), *others = (known.predicted(every) for known in predicted.posteriors)
        rests = [(expected[0] - mean[0], spread[0]) for mean, spread in others]
        # Alternatives that even all proposals together would not separate from the leader do not count.
        separable = np.array([0.5 * rest @ np.linalg.solve(spread, rest) >= 1.0 for rest, spread in rests])
        value, cells = separation(competition, predicted, separable), predicted.rows.cells
        chosen = greedy(listed, cells, value, LEAST_STEP, data.pitch_setting_deg) if np.any(separable) else []
        if not chosen:
            continue
        separated = measured(chosen, conditions, predicted)
        if best is None or separated.promise.better(best.promise):
            best = separated
        if best.promise.given_listed >= _SURE and not best.promise.remaining:
            return best
    if not again:
        return best
    reverse = replace(measured(again, here, first), in_reverse=True)
    return reverse if best is None or reverse.promise.better(best.promise) else best
