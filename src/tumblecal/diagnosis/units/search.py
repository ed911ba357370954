"""Search of the errors that the units share: hypotheses of the mixed model, and the explanations that they make up.

Random effects and causes of single units are searched given the leading sets of shared errors, then those given them, in turn.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.detection.detect import weight_of
from tumblecal.diagnosis.detection.null_curve import log_p_value, threshold
from tumblecal.diagnosis.priors import (
    HEAD_ROUNDS,
    LEAST_SPREAD_ODDS,
    MOST_RANDOM_EFFECTS,
    RANDOM_EFFECTS_TRIED,
    SIZE,
)
from tumblecal.diagnosis.sets.cause_sets import Members
from tumblecal.diagnosis.sets.classes import explanations
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.diagnosis.units.hypotheses import Hypothesis, RandomEffect, hypothesis, likely_random_effects
from tumblecal.diagnosis.units.unit import Batch, SharedSignal
from tumblecal.full_model.priors import SIZE_PRIOR


@dataclass(frozen=True, eq=False)
class SharedExplanation:
    """A set of errors shared by all units (`shared`), with effects that each unit has by a different amount.

    `class_probability`: of the set or its equivalents, over all hypotheses.
    """

    shared: Explanation
    class_probability: float
    hypothesis: Hypothesis

    @property
    def probability(self) -> float:
        """Of the statement that is made (`Explanation.probability`), over all hypotheses."""
        return self.class_probability * self.shared.probability / max(self.shared.class_probability, 1e-300)

    @property
    def signals(self) -> tuple[SharedSignal, ...]:
        """Of the shared errors."""
        return tuple(self.hypothesis.signals[k] for k in self.shared.members)

    @property
    def coefficients(self) -> Float[np.ndarray, " columns"]:
        """Of the shared errors and of the means of random effects, scaled, zero elsewhere."""
        return self.hypothesis.coefficients(self.shared.members)

    @property
    def varying(self) -> tuple[SharedSignal, ...]:
        """The effects whose size differs from unit to unit."""
        return tuple(effect.signal for effect in self.hypothesis.random_effects)

    @property
    def by_unit(self) -> tuple[str, ...]:
        """Ids of these."""
        return tuple(signal.label for signal in self.varying)

    @property
    def head_by_unit(self) -> tuple[str, ...]:
        """Those of them that are errors of the head."""
        return tuple(signal.label for signal in self.varying if signal.of_head)


@dataclass(frozen=True)
class JointPosterior:
    """The explanations of all units together, the most probable first.

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
        """The explanation to act on: the most probable in which the head has an error, the same for all units or different in
        each; while none is detected, one in which it shares none."""
        if not self.detected:
            return next(explanation for explanation in self.explanations if not explanation.shared.labels)
        return next(one for one in self.explanations if one.shared.labels or one.head_by_unit)

    def shared_probability(self, id: str) -> float:
        """Probability that an effect, or one indistinguishable from it, is shared by all units, with one coefficient."""
        sets = ((one, (one.shared.labels, *one.shared.equivalents)) for one in self.explanations)
        return sum(one.class_probability for one, stated in sets if any(id in labels for labels in stated))

    def by_unit_probability(self, id: str) -> float:
        """Probability that every unit has an effect with a different amount."""
        return sum(one.class_probability for one in self.explanations if id in one.by_unit)


def joint_posterior(batch: Batch) -> JointPosterior:
    """Compare shared errors with errors of single units."""
    causes = tuple([unit.causes_of(unit.z) for unit in batch.units])
    # Faults of single positions cannot be shared.
    pairs = zip(batch.units, causes, strict=True)
    faults = tuple([unit.only(own, lambda cause: bool(cause.positions)) for unit, own in pairs])
    evaluated: dict[tuple, Hypothesis] = {}
    # An error of the head at one angle may look like the same outlier positions in every unit.
    for start in (causes, faults, ((),) * len(batch.units)):
        _climb(evaluated, batch, start, ())
    for _ in range(MOST_RANDOM_EFFECTS):
        tried = list(evaluated.values())
        best = max(tried, key=lambda one: one.top)
        for leading in dict.fromkeys([best, max(tried, key=lambda one: one.without)]):
            for effect in _further_random_effects(leading, faults):
                _climb(evaluated, batch, faults, (*leading.random_effects, effect))
        if max((one.top for one in list(evaluated.values())[len(tried) :]), default=-np.inf) < best.top:
            break
    return _posterior(list(evaluated.values()))


def _climb(
    evaluated: dict[tuple, Hypothesis],
    batch: Batch,
    causes: tuple[Members, ...],
    random_effects: tuple[RandomEffect, ...],
) -> None:
    """Evaluate causes of the units and shared errors in turn, each given the other, until neither changes, or the way from
    there is known."""
    for number in range(HEAD_ROUNDS):
        key = (causes, tuple((*effect.law, effect.with_mean, effect.log_prior) for effect in random_effects))
        if key in evaluated:
            return
        current = evaluated[key] = hypothesis(batch, causes, random_effects)
        members = current.ranked.set_at(0)
        if number and not members and not random_effects:
            return
        residuals = zip(batch.units, current.residuals(members), strict=True)
        causes = tuple([unit.causes_of(z) for unit, z in residuals])


def _further_random_effects(before: Hypothesis, faults: tuple[Members, ...]) -> list[RandomEffect]:
    """The likely ones that a hypothesis lacks."""
    labels = {effect.signal.label for effect in before.random_effects}
    free = [signal for signal in before.batch.signals if signal.label not in labels]
    given = [before.equations, before.batch.equations(faults)]
    for effect in before.random_effects:
        given = [equations.marginal(*effect.law) for equations in given]
    found: dict[tuple, RandomEffect] = {}
    for members in dict.fromkeys([before.ranked.set_at(0), ()]):
        coefficients = before.coefficients(members)
        for equations in given:
            for odds, effect in likely_random_effects(equations.given(coefficients), free, RANDOM_EFFECTS_TRIED):
                if odds > LEAST_SPREAD_ODDS:
                    found.setdefault(effect.signal.key, effect)
    return list(found.values())


def _posterior(tried: Sequence[Hypothesis]) -> JointPosterior:
    """Explanations over all hypotheses: each class of sets with the causes of single units that suit it best."""
    best: dict[tuple, tuple[float, Explanation, Hypothesis]] = {}
    for one in tried:
        total = one.log_evidence + float(np.logaddexp.reduce(one.ranked.log_posterior))
        by_unit = frozenset(effect.signal.label for effect in one.random_effects)
        for explanation in explanations(one.search, one.ranked, {}, 1.0):
            key = (frozenset([explanation.labels, *explanation.equivalents]), by_unit)
            score = total + float(np.log(max(explanation.class_probability, 1e-300)))
            if key not in best or score > best[key][0]:
                best[key] = (score, explanation, one)
    ranked = sorted(best.values(), key=lambda row: -row[0])
    scores = np.array([score for score, *_ in ranked])
    shares = np.exp(scores - np.logaddexp.reduce(scores)).tolist()
    listed = tuple(SharedExplanation(row[1], share, row[2]) for row, share in zip(ranked, shares, strict=True))
    with_error = np.array([bool(one.shared.labels) for one in listed])
    # The head has no error in common, nor one that differs between units.
    of_sensors = (one for one in tried if not any(effect.signal.of_head for effect in one.random_effects))
    null = max(of_sensors, key=lambda one: one.without)
    pool = null.search.pool
    if not pool.size:
        # Without a head nothing can be shared.
        return JointPosterior(listed, -np.inf, np.inf, 1.0, 0)
    log_odds = float(np.logaddexp.reduce(scores[with_error], initial=-np.inf)) - null.without
    statistic = log_odds - float(np.log(1 - SIZE_PRIOR[0]) - np.log(SIZE_PRIOR[0]))
    of_null = pool.dof, True, weight_of(pool, None)
    p_value = float(np.exp(log_p_value(np.array(statistic), *of_null)))
    return JointPosterior(listed, statistic, threshold(SIZE, *of_null), p_value, pool.dof)
