"""Positions that separate the leading explanations, and the conditions under which they do."""

from collections.abc import Sequence
from dataclasses import dataclass

from tumblecal.diagnosis import Diagnosis
from tumblecal.planning.alternatives import Alternative, alternatives_of, columns_of
from tumblecal.planning.choosing import Choosing
from tumblecal.planning.conditions import Conditions, candidates, continued
from tumblecal.planning.new_rows import Rows, rows_of
from tumblecal.planning.promise import Promise, positions_needed, promise_of
from tumblecal.planning.proposals import Proposal, by_pitch
from tumblecal.planning.value import Separation


# A proposal that adds less than this to the log Bayes factor is omitted.
LEAST_STEP = 0.2
# No conditions of more effort are tried if a result is this probable.
_SURE = 0.95


@dataclass(frozen=True)
class EvaluatedAlternatives:
    """The alternatives to the leading explanation, with the rows of the data and of all proposals."""

    rows: Rows
    alternatives: list[Alternative]


@dataclass(frozen=True)
class Separated:
    """Positions that separate explanations.

    - `conditions`: under which they are measured; `evaluated`: the alternatives under them.
    - `listed`: the proposals that the numbers refer to. `in_reverse`: whether they are the last run in the reverse order.
    - `chosen`: numbers of the proposals of the set, in order, with the value that each adds; `singles`: the best single ones,
      with their values. `value`: expected log Bayes factor of the set.
    - `promise`: what it settles. `measured`: the explanations with rows of the set, one position after another.
    """

    conditions: Conditions
    evaluated: EvaluatedAlternatives
    chosen: list[tuple[int, float]]
    singles: list[tuple[int, float]]
    value: float
    promise: Promise
    measured: Separation
    listed: list[Proposal]
    in_reverse: bool = False

    @property
    def needed(self) -> int | None:
        """Number of such positions that would settle it; None if no number would, or if these do."""
        if self.promise.made or not self.chosen:
            return None
        return positions_needed(self.measured)


def separate(
    diagnosis: Diagnosis, listed: list[Proposal], most: int, again: list[Proposal]
) -> tuple[EvaluatedAlternatives, Separated | None]:
    """The alternatives, and the positions that separate them under the conditions of least effort; None if there is no
    alternative.

    **Arguments:**

    - `listed`: the proposals. `most`: number of single proposals asked for.
    - `again`: the last run in the reverse order, which is evaluated as a whole if no conditions are sure to settle it.
    """
    here = continued(diagnosis.data)
    rows = rows_of(diagnosis, listed, here)
    first = EvaluatedAlternatives(rows, alternatives_of(diagnosis, rows))
    if not first.alternatives or not columns_of(diagnosis.members):
        return first, None
    needs = _needs(diagnosis, first.alternatives)
    best: Separated | None = None
    for conditions in candidates(
        diagnosis.data, in_time="time_s" in needs, with_temperature="temperature_degc" in needs
    ):
        evaluated = first
        if conditions != here:
            rows = rows_of(diagnosis, listed, conditions)
            evaluated = EvaluatedAlternatives(rows, alternatives_of(diagnosis, rows))
        separated = _under(diagnosis, listed, conditions, evaluated, most)
        if best is None or _better(separated.promise, best.promise):
            best = separated
        if best.promise.probability >= _SURE and not best.promise.remaining:
            break
    else:
        reverse = _in_reverse(diagnosis, again, here, first) if again else None
        if reverse is not None and best is not None and _better(reverse.promise, best.promise):
            best = reverse
    return first, best


def _better(promise: Promise, than: Promise) -> bool:
    """Whether a promise is better: fewer alternatives remain, or it is more probable by a twentieth."""
    rank, before = ((one.made, one.worth_measuring, -len(one.remaining)) for one in (promise, than))
    return rank > before or (rank == before and promise.probability > than.probability + 0.05)


def _under(
    diagnosis: Diagnosis, listed: list[Proposal], conditions: Conditions, evaluated: EvaluatedAlternatives, most: int
) -> Separated:
    """The positions that separate the alternatives under some conditions."""
    choosing, every = Choosing(listed, evaluated.rows), separation_of(diagnosis, evaluated)
    hopeless = every.inseparable(evaluated.rows.cells)
    separable = [alternative for k, alternative in enumerate(evaluated.alternatives) if k not in hopeless]
    chosen, singles, value = [], [], 0.0
    if separable:
        separation = separation_of(diagnosis, EvaluatedAlternatives(evaluated.rows, separable))
        singles = choosing.best(separation, most, LEAST_STEP)
        chosen = choosing.greedy(separation, lambda positions: LEAST_STEP)
        value = separation.total if chosen else 0.0
    if not chosen:
        promise = Promise(0.0, 1.0, (), tuple([alternative.labels for alternative in evaluated.alternatives]))
        return Separated(conditions, evaluated, [], [], 0.0, promise, every, listed)
    groups = by_pitch([listed[k] for k, _ in chosen])
    ordered = [Proposal((alpha,), group.beta_deg, group.side) for group in groups for alpha in group.alpha_deg]
    separation = separation_of(diagnosis, _as_measured(diagnosis, ordered, conditions))
    return Separated(conditions, evaluated, chosen, singles, value, promise_of(separation), separation, listed)


def _in_reverse(
    diagnosis: Diagnosis, again: list[Proposal], conditions: Conditions, evaluated: EvaluatedAlternatives
) -> Separated:
    """The whole run in the reverse order, under the conditions of `evaluated`."""
    measured = _as_measured(diagnosis, again, conditions)
    separation, chosen = separation_of(diagnosis, measured), list[tuple[int, float]]()
    for k, cells in enumerate(measured.rows.cells):
        chosen.append((k, float(separation.of([cells])[0])))
        separation.take(cells)
    value, separation = separation.total, separation_of(diagnosis, measured)
    promise = promise_of(separation)
    return Separated(conditions, evaluated, chosen, [], value, promise, separation, again, in_reverse=True)


def _as_measured(diagnosis: Diagnosis, ordered: Sequence[Proposal], conditions: Conditions) -> EvaluatedAlternatives:
    """The alternatives with rows of some positions, one after another."""
    rows = rows_of(diagnosis, ordered, conditions, in_order=True)
    return EvaluatedAlternatives(rows, alternatives_of(diagnosis, rows))


def separation_of(diagnosis: Diagnosis, evaluated: EvaluatedAlternatives) -> Separation:
    """The leading explanation and its alternatives."""
    model, leader = diagnosis.model, columns_of(diagnosis.members)
    amplitudes = diagnosis.extended.vector[leader] / model.scales[leader]
    leading = Alternative(diagnosis.best.labels, tuple(leader), 1.0, evaluated.rows)
    return Separation(model.nominal, leading, amplitudes, evaluated.alternatives)


def _needs(diagnosis: Diagnosis, alternatives: Sequence[Alternative]) -> set[str]:
    """Columns that an explanation depends on."""
    columns = {
        *columns_of(diagnosis.members),
        *(column for alternative in alternatives for column in alternative.columns),
    }
    return {name for slot in diagnosis.model.slots if columns & {*slot.columns} for name in slot.needs}
