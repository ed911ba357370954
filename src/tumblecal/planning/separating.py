"""Positions that separate the leading explanations, and the conditions under which they do."""

from dataclasses import dataclass, replace

from tumblecal.planning.alternatives import Competition, Predicted
from tumblecal.planning.choosing import Choosing
from tumblecal.planning.conditions import Conditions, candidates, continued
from tumblecal.planning.promise import PROMISED, Promise, promise_of
from tumblecal.planning.proposals import Proposal, by_pitch
from tumblecal.planning.value import Separation


# A proposal that adds less than this to the log Bayes factor is omitted.
LEAST_STEP = 0.2
# No conditions of more effort are tried if a result is this probable.
_SURE = 0.95


@dataclass(frozen=True)
class Separated:
    """Positions that separate explanations.

    - `conditions`: under which they are measured. `competing`: the leading explanation and the alternatives that they exclude
      (all if none), with the rows of all proposals.
    - `ordered`: the positions, one after another, and `gains`: the expected log Bayes factor that each adds. `in_reverse`:
      whether they are the last run in the reverse order.
    - `promise`: what they settle.
    """

    conditions: Conditions
    competing: list[Predicted]
    ordered: list[Proposal]
    gains: list[float]
    promise: Promise
    in_reverse: bool = False


def separate(
    competition: Competition, first: list[Predicted], listed: list[Proposal], again: list[Proposal]
) -> Separated | None:
    """The positions that separate the explanations under the conditions of least effort; None if only one competes.

    **Arguments:**

    - `first`: the explanations with the rows of all proposals `listed`, directly after the data.
    - `again`: the last run in the reverse order, which is evaluated if no conditions are sure to settle it.
    """
    data, best = competition.diagnosis.data, None
    needs = {name for one in competition.competing for cause in one.causes for name in cause.slot.needs}
    if len(first) < 2:
        return None
    here = continued(data)
    for conditions in candidates(data, in_time="time_s" in needs, with_temperature="temperature_degc" in needs):
        competing = first if conditions == here else competition.at(listed, conditions)
        separated = _measured(competition, _chosen(listed, competing), conditions, competing)
        if best is None or _better(separated.promise, best.promise):
            best = separated
        if best.promise.given_listed >= _SURE and not best.promise.remaining:
            return best
    reverse = replace(_measured(competition, again, here, first), in_reverse=True)
    return reverse if best is None or _better(reverse.promise, best.promise) else best


def _better(promise: Promise, than: Promise) -> bool:
    """Whether a promise is better: fewer alternatives remain, or it is more probable by a twentieth."""
    rank, before = ((one.given_listed >= PROMISED, one.worth_measuring, -len(one.remaining)) for one in (promise, than))
    return rank > before or (rank == before and promise.given_listed > than.given_listed + 0.05)


def _chosen(listed: list[Proposal], competing: list[Predicted]) -> list[Proposal]:
    """The proposals that separate the explanations, in the order in which they are measured, a position each."""
    rows = competing[0].rows
    hopeless = Separation(competing).inseparable(rows.cells)
    separable = [one for k, one in enumerate(competing) if k - 1 not in hopeless]
    if len(separable) < 2:
        return []
    chosen = Choosing(listed, rows).greedy(Separation(separable), lambda positions: LEAST_STEP)
    groups = by_pitch([listed[k] for k, _ in chosen])
    return [Proposal((alpha,), group.beta_deg, group.side) for group in groups for alpha in group.alpha_deg]


def _measured(
    competition: Competition, ordered: list[Proposal], conditions: Conditions, competing: list[Predicted]
) -> Separated:
    """Positions that are measured one after another: the value that each adds, and what they settle together."""
    if not ordered:
        remaining = tuple([one.by.labels for one in competing[1:]])
        return Separated(conditions, competing, [], [], Promise(0.0, 0.0, 1.0, (), remaining))
    predicted, gains = competition.at(ordered, conditions, in_order=True), list[float]()
    promise = promise_of(Separation(predicted), competition)
    excluded = promise.excluded or tuple(one.by.labels for one in competing)
    counts = [k for k, one in enumerate(competing) if k == 0 or one.by.labels in excluded]
    separation = Separation([predicted[k] for k in counts])
    for cells in predicted[0].rows.cells:
        gains.append(float(separation.of([cells])[0]))
        separation.take(cells)
    return Separated(conditions, [competing[k] for k in counts], ordered, gains, promise)
