"""The joint model of many units: errors that all of them share, and errors of single units.

A hypothesis is a set of errors shared by all units with common coefficients, effects that each unit has by a different amount
(`Spread`), and the causes of single units. The latter two are searched given the leading sets of shared errors, then those
sets given them, in turn.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tumblecal.diagnosis.detection.detect import null_distribution
from tumblecal.diagnosis.priors import SIZE, SIZE_PRIOR, SURE
from tumblecal.diagnosis.sets.classes import explanations
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.diagnosis.units.spread import Spread, likely_spreads, widened
from tumblecal.diagnosis.units.unit import NOTHING, OwnCauses, SharedSignal, Unit
from tumblecal.diagnosis.units.weighed import Weighed, weigh


_MOST_ROUNDS, _MOST_SPREADS, _SPREADS_TRIED = 4, 3, 2
# Effects whose spread is less probable than this (log odds) are not tried.
_HOPELESS = -2.0


@dataclass(frozen=True)
class SharedExplanation:
    """A set of errors shared by all units (`told`), with effects that each unit has by a different amount.

    `class_probability`: of the set or its equivalents, over all hypotheses.
    """

    told: Explanation
    class_probability: float
    own_probability: float
    weighed: Weighed

    @property
    def probability(self) -> float:
        """Of the statement that is made (`Explanation.probability`), over all hypotheses."""
        return self.class_probability * self.told.probability / max(self.told.class_probability, 1e-300)

    @property
    def spreads(self) -> tuple[str, ...]:
        """Ids of the effects whose size differs from unit to unit."""
        return tuple(spread.signal.label for spread in self.weighed.spreads)

    @property
    def head_spreads(self) -> tuple[str, ...]:
        """Effects with a different amount in each unit that are errors of the head."""
        return tuple(spread.signal.label for spread in self.weighed.spreads if spread.signal.of_head)


@dataclass(frozen=True)
class Joint:
    """The result of all units together.

    `statistic`: log Bayes factor of "the head has an error" against "it has none", with its `p_value` and the `threshold`
    above which it is used; `dof`: dimension of the space of the shared errors.
    """

    explanations: tuple[SharedExplanation, ...]
    statistic: float
    threshold: float
    p_value: float
    dof: int

    @property
    def detected(self) -> bool:
        """Whether the units share an error."""
        return self.statistic > self.threshold

    @property
    def best(self) -> SharedExplanation:
        """The explanation to act on: the most probable in which the head has an error, the same for all units or another for
        each; while none is detected, one in which it shares none."""
        if not self.detected:
            return next(told for told in self.explanations if not told.told.labels)
        return next(told for told in self.explanations if told.told.labels or told.head_spreads)

    @property
    def verdict(self) -> str:
        """The verdict for the shared errors: adequate, identified, ambiguous or unexplained."""
        told = self.best.told
        if not told.labels:
            return self.differing(self.best.head_spreads) if self.detected else "adequate"
        if told.unexplained:
            return "unexplained"
        return "identified" if told.single_name and self.best.probability >= SURE else "ambiguous"

    def differing(self, ids: Collection[str]) -> str:
        """The verdict on a head of which these errors are not the same for all units: identified or ambiguous."""
        sure = len(ids) == 1 and all(self.spread_probability(id) >= SURE for id in ids)
        return "identified" if sure else "ambiguous"

    def shared_probability(self, id: str) -> float:
        """Probability that an effect, or one indistinguishable from it, is shared by all units, with one coefficient."""
        return sum(
            told.class_probability
            for told in self.explanations
            if any(id in labels for labels in (told.told.labels, *told.told.equivalents))
        )

    def spread_probability(self, id: str) -> float:
        """Probability that every unit has an effect with a different amount."""
        return sum(told.class_probability for told in self.explanations if id in told.spreads)


def joint(units: Sequence[Unit], signals: Sequence[SharedSignal]) -> Joint:
    """Compare shared errors with errors of single units."""
    own = [unit.own_causes(unit.z) for unit in units]
    faults = [unit.faults_of(causes) for unit, causes in zip(units, own, strict=True)]
    # An error of the head at one angle may look like the same outlier positions in every unit.
    starts = dict.fromkeys([tuple(own), tuple(faults), (NOTHING,) * len(units)])
    tried = [weighed for start in starts for weighed in _climbed(units, signals, weigh(units, signals, start))]
    for _ in range(_MOST_SPREADS):
        best = max(tried, key=lambda weighed: weighed.top)
        leading = {id(weighed): weighed for weighed in (best, max(tried, key=lambda weighed: weighed.without))}
        wider = [more for weighed in leading.values() for more in _with_spread(units, signals, weighed, faults)]
        tried += wider
        if not wider or max(weighed.top for weighed in wider) < best.top:
            break
    return _told(tried)


def _climbed(units: Sequence[Unit], signals: Sequence[SharedSignal], start: Weighed) -> Iterator[Weighed]:
    """Causes of the units and shared errors in turn, each given the other, until neither changes."""
    weighed = start
    for _ in range(_MOST_ROUNDS):
        yield weighed
        members = weighed.ranked.set_at(0)
        if not members and not weighed.spreads and weighed is not start:
            return
        left = weighed.left(units, members)
        own = tuple(unit.own_causes(z) for unit, z in zip(units, left, strict=True))
        if own == weighed.own:
            return
        weighed = weigh(units, signals, own, weighed.spreads)


def _with_spread(
    units: Sequence[Unit], signals: Sequence[SharedSignal], weighed: Weighed, faults: Sequence[OwnCauses]
) -> Iterator[Weighed]:
    """The hypotheses with one more effect whose size differs from unit to unit."""
    before = {spread.signal.cause for spread in weighed.spreads}
    free = [signal for signal in signals if signal.cause not in before]
    listed: dict[tuple, Spread] = {}
    for members in dict.fromkeys([weighed.ranked.set_at(0), ()]):
        for own in (weighed.own, tuple(faults)):
            reduced = [unit.reduced(causes) for unit, causes in zip(units, own, strict=True)]
            for spread in weighed.spreads:
                reduced = [widened(unit, spread) for unit in reduced]
            shared = weighed.coefficients(members)
            for odds, spread in likely_spreads(reduced, shared, free, _SPREADS_TRIED):
                if odds > _HOPELESS:
                    listed.setdefault(spread.signal.key, spread)
    for spread in listed.values():
        start = weigh(units, signals, faults, (*weighed.spreads, spread))
        yield from _climbed(units, signals, start)


def _told(tried: Sequence[Weighed]) -> Joint:
    """Explanations over all hypotheses: each class of sets with the own causes that suit it best."""
    best: dict[tuple, tuple[float, float, Explanation, Weighed]] = {}
    for weighed in tried:
        told = explanations(weighed.search, weighed.ranked, {}, 1.0)
        total = weighed.log_evidence + float(np.logaddexp.reduce(weighed.ranked.log_posterior))
        spreads = frozenset(spread.signal.label for spread in weighed.spreads)
        for explanation in told:
            key = (frozenset([explanation.labels, *explanation.equivalents]), spreads)
            score = total + float(np.log(max(explanation.class_probability, 1e-300)))
            own = total + float(np.log(max(explanation.own_probability, 1e-300)))
            if key not in best or score > best[key][0]:
                best[key] = (score, own, explanation, weighed)
    whole = float(np.logaddexp.reduce([score for score, *_ in best.values()]))
    listed = [
        SharedExplanation(told, float(np.exp(score - whole)), float(np.exp(own - whole)), weighed)
        for score, own, told, weighed in sorted(best.values(), key=lambda row: -row[0])
    ]
    with_error = float(np.logaddexp.reduce([score for score, _, told, _ in best.values() if told.labels] or [-np.inf]))
    sensors_alone = [weighed for weighed in tried if not any(spread.signal.of_head for spread in weighed.spreads)]
    without = max(weighed.without for weighed in sensors_alone)
    statistic = with_error - without - float(np.log(1 - SIZE_PRIOR[0]) - np.log(SIZE_PRIOR[0]))
    pool = max(sensors_alone, key=lambda weighed: weighed.without).search.pool
    if not pool.causes:
        # Without a head nothing can be shared.
        return Joint(tuple(listed), -np.inf, np.inf, 1.0, 0)
    null = null_distribution(pool, None, True)
    above = len(null) - int(np.searchsorted(null, statistic))
    p_value = (above + 1) / (len(null) + 1) if above else min(1 / (len(null) + 1), float(np.exp(-statistic)))
    return Joint(tuple(listed), statistic, float(np.quantile(null, 1 - SIZE)), p_value, pool.dof)
