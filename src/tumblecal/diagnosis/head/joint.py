"""The joint model of many units: which errors all of them share, beside each unit's own.

A hypothesis is a set of errors shared by all units with common coefficients, effects that each unit has by an amount of
its own (`Spread`), and each unit's own causes. Given the latter two, the shared errors are searched as in one data set:
their stacked signals, reduced to the normal equations summed over the units, are a residual space for `Search`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from tumblecal.diagnosis.causes import Cause, EffectCause, visibility
from tumblecal.diagnosis.classes import Explanation, explanations
from tumblecal.diagnosis.detect import null_distribution, statistics
from tumblecal.diagnosis.evidence import gain
from tumblecal.diagnosis.generic_causes import Generic
from tumblecal.diagnosis.head.spread import Spread, deviation, likely_spreads, widened
from tumblecal.diagnosis.head.unit import NOTHING, OwnCauses, Reduced, SharedSignal, Unit
from tumblecal.diagnosis.pool import Pool
from tumblecal.diagnosis.search import Ranked, Search
from tumblecal.diagnosis.tuning import (
    EFFECT_TEST_WEIGHT,
    EFFECT_WEIGHT,
    GENERIC_TEST_WEIGHT,
    GENERIC_WEIGHT,
    LEAST_VISIBLE_TERM,
    SIZE,
    SIZE_PRIOR,
    SURE,
)


_MOST_ROUNDS, _MOST_SPREADS, _SPREADS_TRIED = 4, 3, 2
# Directions of the summed normal equations below this share of the largest hold rounding alone.
_ROUNDING = 1e-11
# Effects whose spread is less probable than this (log odds) are not tried.
_HOPELESS = -2.0


@dataclass(frozen=True)
class Weighed:
    """The shared errors searched beside given own causes and spreads.

    - `reduced`: every unit beside its own causes. `gram`, `towards`: summed over the units, spreads integrated out.
    - `log_evidence`: with nothing shared; `search`, `ranked`: of the shared errors.
    """

    own: tuple[OwnCauses, ...]
    spreads: tuple[Spread, ...]
    reduced: tuple[Reduced, ...]
    gram: Float[np.ndarray, "columns columns"]
    towards: Float[np.ndarray, " columns"]
    signals: tuple[SharedSignal, ...]
    log_evidence: float
    search: Search
    ranked: Ranked

    @property
    def top(self) -> float:
        """Log posterior of the best set of shared errors, on a scale common to all hypotheses."""
        return self.log_evidence + self.search.top

    @property
    def without(self) -> float:
        """The same of nothing shared."""
        return self.log_evidence + self.search.posterior(())

    def coefficients(self, members: Sequence[int]) -> Float[np.ndarray, " columns"]:
        """Least-squares coefficients (scaled) of a set of shared errors and of the spreads' means, zero elsewhere."""
        width = len(self.towards)
        directions = [np.zeros((width, 0))]
        for k in members:
            cause = self.search.pool.causes[k]
            block = np.zeros((width, cause.block.shape[1] if cause.block is not None else 0))
            block[list(self.signals[k].columns)] = cause.directions if cause.directions is not None else 1.0
            directions.append(block)
        for spread in self.spreads:
            if spread.with_mean:
                directions.append(np.eye(width)[:, list(spread.signal.columns)])
        moved = np.hstack(directions)
        step = np.linalg.pinv(moved.T @ self.gram @ moved, rcond=_ROUNDING, hermitian=True) @ (moved.T @ self.towards)
        return moved @ step

    def left(self, units: Sequence[Unit], members: Sequence[int]) -> Iterator[Float[np.ndarray, " nu"]]:
        """What every unit leaves beside a set of shared errors and its share of the spreads."""
        shared = self.coefficients(members)
        for unit, reduced in zip(units, self.reduced, strict=True):
            own = shared.copy()
            for spread in self.spreads:
                own = own + deviation(reduced, spread, own)
            yield unit.z - unit.response @ own


def weigh(
    units: Sequence[Unit], signals: Sequence[SharedSignal], own: Sequence[OwnCauses], spreads: tuple[Spread, ...] = ()
) -> Weighed:
    """Search the shared errors beside the units' own causes and spreads."""
    width = signals[-1].columns[-1] + 1 if signals else 0
    gram, whole, towards = np.zeros((width, width)), np.zeros((width, width)), np.zeros(width)
    log_evidence, listed = sum(spread.log_prior for spread in spreads), []
    for unit, causes in zip(units, own, strict=True):
        reduced = unit.reduced(causes)
        listed.append(reduced)
        for spread in spreads:
            reduced = widened(reduced, spread)
        log_evidence += reduced.log_evidence
        gram, towards = gram + reduced.gram, towards + reduced.towards
        whole += unit.whole
    left = gram, towards
    for spread in spreads:
        if spread.with_mean:
            columns = list(spread.signal.columns)
            own_part = np.linalg.pinv(left[0][np.ix_(columns, columns)], rcond=_ROUNDING, hermitian=True)
            explained = left[1][columns] @ own_part @ left[1][columns]
            log_evidence += float(gain(np.array(explained), int(np.linalg.matrix_rank(own_part, hermitian=True))))
            taken = left[0][:, columns] @ own_part
            left = left[0] - taken @ left[0][columns], left[1] - taken @ left[1][columns]
    pool, chosen, z = _pool(*left, whole, signals)
    search = Search(pool, z, True)
    ranked = search.run() if len(pool.causes) else search.ranked()
    evidence = log_evidence + 0.5 * float(z @ z)
    return Weighed(tuple(own), spreads, tuple(listed), gram, towards, chosen, evidence, search, ranked)


def _pool(
    gram: np.ndarray, towards: np.ndarray, whole: np.ndarray, signals: Sequence[SharedSignal]
) -> tuple[Pool, tuple[SharedSignal, ...], np.ndarray]:
    """The errors that all units may share as causes in a residual space of the summed normal equations; their signals
    in the same order; and the residual there."""
    wholes = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    gram, towards, whole = gram / np.outer(wholes, wholes), towards / wholes, whole / np.outer(wholes, wholes)
    values, vectors = np.linalg.eigh(gram) if len(gram) else (np.zeros(0), gram)
    kept = values > _ROUNDING * np.max(values, initial=1e-300)
    rows = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    z = (vectors[:, kept].T @ towards) / np.sqrt(values[kept])
    sizes = np.sqrt(np.maximum(np.diag(gram), 0.0))
    shown: list[tuple[SharedSignal, np.ndarray, np.ndarray | None]] = []
    for signal in signals:
        columns = list(signal.columns)
        if not signal.of_head or not len(z):
            continue
        if not signal.slot.columns:
            if sizes[columns[0]] > LEAST_VISIBLE_TERM:
                shown.append((signal, rows[:, columns] / sizes[columns], None))
            continue
        own, axes = np.linalg.eigh(whole[np.ix_(columns, columns)])
        root = np.sqrt(np.maximum(own, 0.0))[:, None] * axes.T
        seen = visibility(root, rows[:, columns], sizes[columns], np.ones(len(columns)), signal.slot)
        if seen.block.shape[1]:
            shown.append((signal, seen.block, seen.directions / wholes[columns][:, None]))
    generic = sum(directions is None for _, _, directions in shown)
    causes: list[Cause] = []
    for signal, block, directions in shown:
        if directions is None:
            share = -float(np.log(generic))
            weights = share + float(np.log(GENERIC_WEIGHT)), share + float(np.log(GENERIC_TEST_WEIGHT))
            causes.append(Generic(*weights, block, (), signal.words))
        else:
            share = -float(np.log(len(shown) - generic))
            weights = share + float(np.log(EFFECT_WEIGHT)), share + float(np.log(EFFECT_TEST_WEIGHT))
            causes.append(EffectCause(signal.label, *weights, block, signal.slot, directions))
    return Pool(tuple(causes), len(z)), tuple(signal for signal, _, _ in shown), z


@dataclass(frozen=True)
class SharedExplanation:
    """A set of errors shared by all units (`told`), beside effects that each unit has by an amount of its own.

    `probability`: of the set or its equivalents, over all hypotheses.
    """

    told: Explanation
    probability: float
    own_probability: float
    weighed: Weighed

    @property
    def spreads(self) -> tuple[str, ...]:
        """Ids of the effects whose size differs from unit to unit."""
        return tuple(spread.signal.label for spread in self.weighed.spreads)


@dataclass(frozen=True)
class Joint:
    """What the units say together.

    `statistic`: log Bayes factor of "the head has an error" against "it has none", with its `p_value` and the
    `threshold` above which it is acted on; `dof`: dimension of the space of the shared errors.
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
        """The explanation to act on: the most probable; while no error of the head is detected, one without any."""
        return next(told for told in self.explanations if self.detected or not told.told.labels)

    @property
    def verdict(self) -> str:
        """Of what the units share: adequate, identified, ambiguous or unexplained."""
        told = self.best.told
        if not told.labels:
            return "adequate"
        if told.unexplained:
            return "unexplained"
        return "identified" if told.single_name and self.best.probability >= SURE else "ambiguous"

    def shared_probability(self, id: str) -> float:
        """That an effect is shared by all units, with one coefficient."""
        return sum(told.probability for told in self.explanations if id in told.told.labels)

    def spread_probability(self, id: str) -> float:
        """That every unit has an effect by an amount of its own."""
        return sum(told.probability for told in self.explanations if id in told.spreads)


def joint(units: Sequence[Unit], signals: Sequence[SharedSignal]) -> Joint:
    """Weigh what the units may share against what may be each one's own."""
    own = [unit.own_causes(unit.z) for unit in units]
    faults = [unit.faults_of(causes) for unit, causes in zip(units, own, strict=True)]
    starts = [own] if own == faults else [own, faults]
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
    """Own causes and shared errors in turn, each beside the other, until neither changes."""
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
    before = {spread.signal.key for spread in weighed.spreads}
    free = [signal for signal in signals if signal.key not in before]
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
        total = weighed.log_evidence + float(logsumexp(weighed.ranked.log_posterior))
        spreads = frozenset(spread.signal.label for spread in weighed.spreads)
        for explanation in told:
            key = (frozenset([explanation.labels, *explanation.equivalents]), spreads)
            score = total + float(np.log(max(explanation.probability, 1e-300)))
            own = total + float(np.log(max(explanation.own_probability, 1e-300)))
            if key not in best or score > best[key][0]:
                best[key] = (score, own, explanation, weighed)
    whole = float(logsumexp([score for score, *_ in best.values()]))
    listed = [
        SharedExplanation(told, float(np.exp(score - whole)), float(np.exp(own - whole)), weighed)
        for score, own, told, weighed in sorted(best.values(), key=lambda row: -row[0])
    ]
    with_error = float(logsumexp([score for score, _, told, _ in best.values() if told.labels] or [-np.inf]))
    sensors_alone = [weighed for weighed in tried if not any(spread.signal.of_head for spread in weighed.spreads)]
    without = max(weighed.without for weighed in sensors_alone)
    statistic = with_error - without - float(np.log(1 - SIZE_PRIOR[0]) - np.log(SIZE_PRIOR[0]))
    pool = max(sensors_alone, key=lambda weighed: weighed.without).search.pool
    null = null_distribution(pool, [], True) if len(pool.causes) else np.full(1, -np.inf)
    above = len(null) - int(np.searchsorted(null, statistic))
    p_value = (above + 1) / (len(null) + 1) if above else min(1 / (len(null) + 1), float(np.exp(-statistic)))
    return Joint(tuple(listed), statistic, float(np.quantile(null, 1 - SIZE)), p_value, pool.dof)
