"""The explanations that compete, the leading one first, and their posteriors with the rows of new positions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.diagnosis.causes.cause import UNEXPLAINED, Cause
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.sets.cause_sets import sets_of
from tumblecal.diagnosis.sets.exchanges import Labels
from tumblecal.plan.next.conditions import Conditions
from tumblecal.plan.next.proposals import NextPosition
from tumblecal.plan.next.rows import Posterior, Rows, rows_of


MOST_ALTERNATIVES = 10
# A less probable explanation is no alternative, unless it is in one class with the leader: as long as the data do not separate
# the two, nothing is identified, however improbable it is alone. It then has this probability.
LEAST_PROBABILITY = 0.01


@dataclass(frozen=True)
class Competing:
    """An explanation that competes.

    - `labels`: of its `causes`; empty: nothing beyond the nominal model. `probability`: of it.
    - `larger`: the probability of its causes with further ones, relative to that of its causes alone.
    """

    labels: Labels
    causes: tuple[Cause, ...]
    probability: float
    larger: float


class Predicted(NamedTuple):
    """New positions under the explanations: their rows, and the posterior of each, with its coefficients (time constants
    included) and the nominal parameters."""

    rows: Rows
    posteriors: list[Posterior]


@dataclass(frozen=True)
class Competition:
    """The explanations that compete, the leading one first; `unlisted`: the probability of all others, such as an error that is
    not in the catalogue."""

    diagnosis: Diagnosis
    competing: tuple[Competing, ...]
    unlisted: float

    @property
    def log_odds(self) -> np.ndarray:
        """Logarithm of the odds of each alternative."""
        return np.log([one.probability / self.competing[0].probability for one in self.competing[1:]])

    @property
    def alternatives(self) -> tuple[Labels, ...]:
        """Labels of the alternatives."""
        return tuple([one.labels for one in self.competing[1:]])

    @property
    def unnamed(self) -> list[Labels]:
        """The alternatives with an error that is not in the catalogue."""
        return [labels for labels in self.diagnosis.best.separable if UNEXPLAINED in labels]

    @property
    def at_settings(self) -> bool:
        """Whether an explanation acts at one pitch setting, or has a value for each: it predicts nothing at another one."""
        links = [link for one in self.competing for cause in one.causes for link in cause.slot.links]
        return any(hasattr(link, "setting") or getattr(link, "by", "") == "pitch" for link in links)

    def at(self, listed: Sequence[NextPosition], conditions: Conditions) -> Predicted:
        """Every explanation at new positions; arguments as of `rows_of`."""
        rows = rows_of(self.diagnosis, listed, conditions)
        return Predicted(rows, [rows.posterior(one.causes, self.diagnosis.model) for one in self.competing])


def competition(diagnosis: Diagnosis) -> Competition:
    """The explanations that compete in a diagnosis, the alternatives to the leading one by their probability.

    An error that is not in the catalogue predicts nothing, and noise of another kind no other readings: neither competes. A set
    that includes the leading causes can always produce their signal.
    """
    screened, best = diagnosis.screened, diagnosis.best
    pool, ranked = screened.pool, screened.search.ranked()
    # The most probable set of each explanation, and the probability of all its sets relative to that of the first.
    sets, weights = dict[frozenset[str], tuple[Cause, ...]](), dict[frozenset[str], float]()
    relative = np.exp(ranked.log_posterior - ranked.log_posterior[0]).tolist()
    for members, weight in zip(sets_of(ranked.members), relative, strict=True):
        own = frozenset([pool.labels[k] for k in members])
        sets.setdefault(own, tuple([pool.causes[k] for k in members]))
        weights[own] = weights.get(own, 0.0) + weight

    def made(labels: Labels, causes: tuple[Cause, ...], probability: float) -> Competing:
        larger = sum(weight for other, weight in weights.items() if {*labels} < other)
        return Competing(labels, causes, probability, larger / weights.get(frozenset(labels), np.inf))

    shares, claimed = dict(zip(best.equivalents, best.shares, strict=True)), {*best.identical, *best.powers}
    own_probability = best.own_probability + sum(share for labels, share in shares.items() if labels in claimed)
    competing, listed = [made(best.labels, diagnosis.members, own_probability)], list[tuple[Labels, float]]()
    if all(cause.named for cause in diagnosis.members):
        listed += [(labels, max(shares[labels], LEAST_PROBABILITY)) for labels in best.separable]
        listed += best.less_probable
        listed += [(e.labels, e.class_probability) for e in screened.explanations if e is not best and not e.noise]
    within = sum(probability for labels, probability in listed if {*best.labels} < {*labels})
    for labels, probability in sorted(listed, key=lambda item: -item[1]):
        causes = sets.get(frozenset(labels), ())
        predicts = len(causes) >= len({*labels}) and all(cause.named for cause in causes)
        if probability < LEAST_PROBABILITY or {*best.labels} <= {*labels} or not predicts:
            continue
        same = next((k for k, one in enumerate(competing) if k and _identical_at_1_g(causes, one.causes)), None)
        if same is not None:
            competing[same] = replace(competing[same], probability=competing[same].probability + probability)
        elif len(competing) <= MOST_ALTERNATIVES:
            competing.append(made(labels, causes, probability))
    return Competition(diagnosis, tuple(competing), max(0.0, 1.0 - within - sum(one.probability for one in competing)))


def _identical_at_1_g(causes: Sequence[Cause], others: Sequence[Cause]) -> bool:
    """Whether two sets of effects differ by effects that are one function at 1 g: no measurement on a head separates them."""
    common = {cause.label for cause in causes} & {cause.label for cause in others}
    first, second = ([cause.slot for cause in own if cause.label not in common] for own in (causes, others))
    return all(cause.slot.columns for cause in (*causes, *others)) and one_function_at_1_g(first, second)
