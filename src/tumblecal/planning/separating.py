"""Positions that separate the leading explanations, under the conditions in which they do."""

from collections.abc import Sequence
from dataclasses import dataclass

from tumblecal.diagnosis import Diagnosis
from tumblecal.planning.choosing import Choosing
from tumblecal.planning.conditions import Conditions, candidates, going_on
from tumblecal.planning.new_rows import Rows, rows_of
from tumblecal.planning.promise import Promise, positions_needed, promise_of
from tumblecal.planning.proposals import Proposal, by_pitch
from tumblecal.planning.rivals import Rival, columns_of, rivals_of
from tumblecal.planning.value import Separation


# A proposal that adds less than this to the log Bayes factor is left out.
LEAST_STEP = 0.2
# No conditions of more effort are tried where a result is so probable.
_SURE = 0.95


@dataclass(frozen=True)
class Alternatives:
    """The explanations that are still possible beside the leading one, with the rows of the data and of all proposals."""

    rows: Rows
    rivals: list[Rival]


@dataclass(frozen=True)
class Separated:
    """Positions that separate explanations.

    - `conditions`: under which they are measured; `told`: the alternatives under them.
    - `chosen`: numbers of the proposals of the set, in order, with what each adds; `singles`: the best by themselves, with
      their values. `value`: expected log Bayes factor of the set.
    - `promise`: what it settles. `measured`: the explanations with rows of the set, one position after another.
    """

    conditions: Conditions
    told: Alternatives
    chosen: list[tuple[int, float]]
    singles: list[tuple[int, float]]
    value: float
    promise: Promise
    measured: Separation

    @property
    def needed(self) -> int | None:
        """How many positions like these would settle it; None where none would, or these do."""
        if self.promise.made or not self.chosen:
            return None
        return positions_needed(self.measured)


def separate(diagnosis: Diagnosis, listed: list[Proposal], most: int) -> tuple[Alternatives, Separated | None]:
    """The alternatives, and the positions that separate them under the conditions that take least effort of those in which
    they do; None where there is no alternative.

    **Arguments:**

    - `listed`: the proposals. `most`: number of single proposals asked for.
    """
    here = going_on(diagnosis.data)
    rows = rows_of(diagnosis, listed, here)
    first = Alternatives(rows, rivals_of(diagnosis, rows))
    if not first.rivals or not columns_of(diagnosis.members):
        return first, None
    needs = _needs(diagnosis, first.rivals)
    best: Separated | None = None
    for conditions in candidates(
        diagnosis.data, in_time="time_s" in needs, with_temperature="temperature_degc" in needs
    ):
        told = first
        if conditions != here:
            rows = rows_of(diagnosis, listed, conditions)
            told = Alternatives(rows, rivals_of(diagnosis, rows))
        separated = _under(diagnosis, listed, conditions, told, most)
        if best is None or _better(separated.promise, best.promise):
            best = separated
        if best.promise.probability >= _SURE and not best.promise.remaining:
            break
    return first, best


def _better(promise: Promise, than: Promise) -> bool:
    """Whether a promise is the better one: fewer alternatives remain, or it is more probable by a twentieth."""
    worth, before = ((own.made, own.worth_measuring, -len(own.remaining)) for own in (promise, than))
    return worth > before or (worth == before and promise.probability > than.probability + 0.05)


def _under(
    diagnosis: Diagnosis, listed: list[Proposal], conditions: Conditions, told: Alternatives, most: int
) -> Separated:
    """The positions that separate the alternatives under some conditions."""
    choosing, every = Choosing(listed, told.rows), separation_of(diagnosis, told)
    hopeless = every.inseparable(told.rows.cells)
    kept = [rival for k, rival in enumerate(told.rivals) if k not in hopeless]
    chosen, singles, value = [], [], 0.0
    if kept:
        separation = separation_of(diagnosis, Alternatives(told.rows, kept))
        singles = choosing.best(separation, most, LEAST_STEP)
        chosen = choosing.greedy(separation, lambda positions: LEAST_STEP)
        value = separation.total if chosen else 0.0
    if not chosen:
        promise = Promise(0.0, 1.0, (), tuple([rival.labels for rival in told.rivals]))
        return Separated(conditions, told, [], [], 0.0, promise, every)
    measured = _as_measured(diagnosis, [listed[k] for k, _ in chosen], conditions)
    separation = separation_of(diagnosis, measured)
    return Separated(conditions, told, chosen, singles, value, promise_of(separation), separation)


def _as_measured(diagnosis: Diagnosis, chosen: Sequence[Proposal], conditions: Conditions) -> Alternatives:
    """The alternatives with rows of the chosen positions, one after another."""
    ordered = [Proposal((alpha,), own.beta_deg, own.side) for own in by_pitch(chosen) for alpha in own.alpha_deg]
    rows = rows_of(diagnosis, ordered, conditions, in_order=True)
    return Alternatives(rows, rivals_of(diagnosis, rows))


def separation_of(diagnosis: Diagnosis, told: Alternatives) -> Separation:
    """The leading explanation and its alternatives."""
    model, leader = diagnosis.model, columns_of(diagnosis.members)
    amplitudes = diagnosis.extended.vector[leader] / model.scales[leader]
    own = Rival(diagnosis.best.labels, tuple(leader), 1.0, told.rows)
    return Separation(model.nominal, own, amplitudes, told.rivals)


def _needs(diagnosis: Diagnosis, rivals: Sequence[Rival]) -> set[str]:
    """Columns that an explanation depends on."""
    columns = {*columns_of(diagnosis.members), *(column for rival in rivals for column in rival.columns)}
    return {name for slot in diagnosis.model.slots if columns & {*slot.columns} for name in slot.needs}
