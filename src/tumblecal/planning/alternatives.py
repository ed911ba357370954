"""The explanations that compete, the leading one first, and their rows of old and new positions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tumblecal.chain import Link
from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import Members, sets_of
from tumblecal.diagnosis.sets.exchanges import Labels
from tumblecal.planning.conditions import Conditions
from tumblecal.planning.new_rows import Rows, acts_at_settings, rows_of
from tumblecal.planning.proposals import Proposal


MOST_ALTERNATIVES = 10
# A less probable explanation is no alternative, unless it is in one class with the leader: as long as the data do not separate
# the two, nothing is identified, however improbable it is alone. It then has this probability.
LEAST_PROBABILITY = 0.01


@dataclass(frozen=True)
class Competing:
    """An explanation that competes.

    - `labels`: of its `causes`; empty: nothing beyond the nominal model. `probability`: of it.
    - `larger`: the probability of its causes with further ones, relative to that of its causes alone.
    - `vector`: the full vector that its rows are linearised at.
    """

    labels: Labels
    causes: tuple[Cause, ...]
    probability: float
    larger: float
    vector: np.ndarray


class Predicted(NamedTuple):
    """The rows of data and new positions under an explanation: without its outlier positions, and with its permanent changes.

    `columns`: of its coefficients, time constants included, with the nominal ones.
    """

    by: Competing
    rows: Rows
    columns: tuple[int, ...]


@dataclass(frozen=True)
class Competition:
    """The explanations that compete, the leading one first; `unlisted`: the probability of all others, such as an error that is
    not in the catalogue."""

    diagnosis: Diagnosis
    competing: tuple[Competing, ...]
    unlisted: float

    @property
    def unnamed(self) -> list[Labels]:
        """The alternatives with an error that is not in the catalogue."""
        return [labels for labels in self.diagnosis.best.separable if UNEXPLAINED in labels]

    @property
    def at_settings(self) -> list[Link]:
        """Links of the explanations that act at one pitch setting, or have a value for each."""
        links = (link for one in self.competing for cause in one.causes for link in cause.slot.links)
        return [link for link in links if acts_at_settings(link)]

    def at(
        self, listed: Sequence[Proposal], conditions: Conditions | None = None, *, in_order: bool = False
    ) -> list[Predicted]:
        """Every explanation with its rows; arguments as of `rows_of`."""
        model, made, predicted = self.diagnosis.model, dict[int, Rows](), []
        for one in self.competing:
            if id(one.vector) not in made:
                made[id(one.vector)] = rows_of(self.diagnosis, listed, one.vector, conditions, in_order=in_order)
            rows = _rows_under(one.causes, self.diagnosis, made[id(one.vector)])
            own = (column for cause in one.causes for column in cause.slot.all_columns)
            predicted.append(Predicted(one, rows, (*range(model.nominal), *own)))
        return predicted


def competition(diagnosis: Diagnosis) -> Competition:
    """The explanations that compete in a diagnosis, the alternatives to the leading one by their probability.

    An error that is not in the catalogue predicts nothing, and noise of another kind no other readings: neither competes. A set
    that includes the leading causes can always produce their signal.
    """
    screened, best, vector = diagnosis.screened, diagnosis.best, diagnosis.extended.vector
    claimed = {*best.identical, *best.powers}
    shares = dict(zip(best.equivalents, best.shares, strict=True))
    own = best.own_probability + sum(share for labels, share in shares.items() if labels in claimed)
    sets = _EvaluatedSets(screened)
    made = [Competing(best.labels, diagnosis.members, own, sets.larger(best.labels), vector)]
    if not all(cause.named for cause in diagnosis.members):
        return Competition(diagnosis, tuple(made), 1.0 - own)
    listed = [(labels, max(shares[labels], LEAST_PROBABILITY)) for labels in best.separable]
    listed += best.less_probable
    listed += [(e.labels, e.class_probability) for e in screened.explanations if e is not best and not e.noise]
    within = sum(probability for labels, probability in listed if {*best.labels} < {*labels})
    for labels, probability in sorted(listed, key=lambda item: -item[1]):
        causes = sets.named(labels)
        if probability < LEAST_PROBABILITY or {*best.labels} <= {*labels} or causes is None:
            continue
        same = next((k for k, one in enumerate(made) if k and _identical_at_1_g(causes, one.causes)), None)
        if same is not None:
            made[same] = replace(made[same], probability=made[same].probability + probability)
        elif len(made) <= MOST_ALTERNATIVES:
            # A time constant is not linear: it is fitted.
            curved = any(cause.slot.shape for cause in causes)
            at = fit_with(screened.at, causes).vector if curved else vector
            made.append(Competing(labels, causes, probability, sets.larger(labels), at))
    return Competition(diagnosis, tuple(made), max(0.0, 1.0 - within - sum(one.probability for one in made)))


class _EvaluatedSets:
    """The evaluated sets of causes of a screen by their labels: the most probable set with them, and the relative probability
    of all."""

    def __init__(self, screened: Screened):
        ranked, self.causes = screened.search.ranked(), screened.pool.causes
        self.members, self.weights = dict[frozenset[str], Members](), dict[frozenset[str], float]()
        weights = np.exp(ranked.log_posterior - ranked.log_posterior[0]).tolist()
        for members, weight in zip(sets_of(ranked.members), weights, strict=True):
            labels = frozenset([screened.pool.labels[k] for k in members])
            self.members.setdefault(labels, members)
            self.weights[labels] = self.weights.get(labels, 0.0) + weight

    def named(self, labels: Labels) -> tuple[Cause, ...] | None:
        """The causes with these labels; None if there is one that is not in the catalogue."""
        causes = tuple([self.causes[k] for k in self.members.get(frozenset(labels), (-1,)) if k >= 0])
        return causes if len(causes) >= len({*labels}) and all(cause.named for cause in causes) else None

    def larger(self, labels: Labels) -> float:
        """The probability of all sets with further causes, relative to that of the set."""
        own = self.weights.get(frozenset(labels), np.inf)
        return sum(weight for other, weight in self.weights.items() if {*labels} < other) / own


def _identical_at_1_g(causes: Sequence[Cause], others: Sequence[Cause]) -> bool:
    """Whether two sets of effects differ by effects that are one function at 1 g: no measurement on a head separates them."""
    if not all(cause.slot.columns for cause in (*causes, *others)):
        return False
    common = {cause.label for cause in causes} & {cause.label for cause in others}
    first, second = ([cause.slot for cause in own if cause.label not in common] for own in (causes, others))
    return one_function_at_1_g(first, second)


def _rows_under(causes: Sequence[Cause], diagnosis: Diagnosis, rows: Rows) -> Rows:
    """Rows under an explanation with these causes. Outlier, exchanged or mislabelled positions do not count; a permanent change
    of an axis applies to every new position."""
    used, new = rows.old.copy(), rows.new
    used[[3 * position + axis for cause in causes for position in cause.positions for axis in range(3)]] = 0.0
    old, names = used, [name.partition("@")[0] for name in diagnosis.model.names]
    for cause in causes:
        if not cause.lasting:
            continue
        # After the change the readings respond to it as to the parameter.
        changed = np.any(np.reshape(cause.terms, (len(cause.terms), -1, 3)), axis=(0, 2))
        shown = np.pad(np.repeat(changed, 3), (0, len(used) - 3 * len(changed)))
        for parameter in cause.lasting:
            columns = [k for k, name in enumerate(names) if name == parameter]
            here = np.where(shown, used[:, columns].sum(axis=1), 0.0)
            old, new = np.column_stack([old, here]), np.dstack([new, rows.new[:, :, columns].sum(axis=2)])
    terms = old.shape[1] - used.shape[1]
    return replace(rows, old=old, new=new, prior=np.append(rows.prior, np.zeros(terms)), own=rows.own + terms)
