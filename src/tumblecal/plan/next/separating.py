"""Positions that separate the leading explanations, and the conditions under which they do."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from tumblecal.plan.next.choosing import Value, greedy
from tumblecal.plan.next.competition import Competition, Predicted
from tumblecal.plan.next.conditions import Conditions, candidates, continued
from tumblecal.plan.next.posterior import separations
from tumblecal.plan.next.promise import PROMISED, Promise, promise_of
from tumblecal.plan.next.proposals import NextPosition


# A proposal that adds less than this to the log Bayes factor is omitted.
LEAST_STEP = 0.2
# No conditions of more effort are tried if a result is this probable.
_SURE = 0.95


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
    for conditions in candidates(data, in_time="time_s" in needs, with_temperature="temperature_degc" in needs):
        predicted = first if conditions == here else competition.at(listed, conditions._replace(step_s=0.0))
        every = np.arange(len(predicted.rows.new))[None]
        (expected, _), *others = (known.predicted(every) for known in predicted.posteriors)
        rests = [(expected[0] - mean[0], spread[0]) for mean, spread in others]
        # Alternatives that even all proposals together would not separate from the leader do not count.
        separable = np.array([0.5 * rest @ np.linalg.solve(spread, rest) >= 1.0 for rest, spread in rests])
        value, least = separation(competition, predicted, separable), np.full(len(listed), LEAST_STEP)
        chosen = greedy(listed, predicted.rows.cells, value, least, data.pitch_setting_deg) if np.any(separable) else []
        if not chosen:
            continue
        separated = _measured(competition, chosen, conditions, predicted)
        if best is None or _better(separated.promise, best.promise):
            best = separated
        if best.promise.given_listed >= _SURE and not best.promise.remaining:
            return best
    if not again:
        return best
    reverse = replace(_measured(competition, again, here, first), in_reverse=True)
    return reverse if best is None or _better(reverse.promise, best.promise) else best


def _better(promise: Promise, than: Promise) -> bool:
    """Whether a promise is better: fewer alternatives remain, or it is more probable by a twentieth."""
    rank, before = ((one.given_listed >= PROMISED, one.worth_measuring, -len(one.remaining)) for one in (promise, than))
    return rank > before or (rank == before and promise.given_listed > than.given_listed + 0.05)


def _measured(
    competition: Competition, ordered: list[NextPosition], conditions: Conditions, predicted: Predicted
) -> Separated:
    """Positions that are measured one after another: the value that each adds, and what they settle together."""
    in_order = competition.at(ordered, conditions)
    promise = promise_of(in_order.posteriors, competition)
    excluded = promise.excluded or competition.alternatives
    counted = np.array([labels in excluded for labels in competition.alternatives])
    value = separation(competition, in_order, counted)
    pairs = zip(ordered, in_order.rows.cells, strict=True)
    valued = [replace(one, value=value.take(cells)) for one, cells in pairs]
    return Separated(conditions, predicted, valued, promise, counted)
