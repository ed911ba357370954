"""The result of the screen of one problem."""

from dataclasses import dataclass

import numpy as np

from tumblecal.diagnosis.causes.cause import SIGNS, UNEXPLAINED, Cause
from tumblecal.diagnosis.causes.effects import SeenEffects
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.detection.alternatives import Alternatives
from tumblecal.diagnosis.detection.detect import Detection
from tumblecal.diagnosis.priors import CONTRADICTED, SETTLED, UNMOVED
from tumblecal.diagnosis.sets.cause_sets import Members
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.diagnosis.sets.search import Search
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.priors import SIZE_PRIOR
from tumblecal.full_model.tangent import Tangent
from tumblecal.ground.showing import brief


@dataclass(frozen=True)
class Screened:
    """The result of the linear screen of one problem.

    `sigma` is the noise in units of the white rows: 1 for known noise, otherwise that of the best explanation. `fit`: the
    exact fit of the best explanation, if available.
    """

    __repr__ = brief

    at: Tangent
    pool: Pool
    alternatives: Alternatives
    detection: Detection
    explanations: list[Explanation]
    search: Search
    sigma: float
    fit: Fit | None = None

    @property
    def problem(self) -> Problem:
        """The problem that was screened."""
        return self.at.problem

    @property
    def seen(self) -> SeenEffects:
        """Visibility of every effect."""
        seen = self.pool.seen_effects
        assert seen is not None  # the pool of a screen has it
        return seen

    @property
    def best(self) -> Explanation:
        """The explanation to act on: the best that is not `adequate` once something was detected."""
        if not self.detection.detected:
            return next(told for told in self.explanations if not told.labels)
        return next(told for told in self.explanations if told.labels)

    @property
    def members(self) -> tuple[Cause, ...]:
        """The causes of the best explanation; none where it is about the noise."""
        if self.best.unexplained and not self.best.members:
            return () if isinstance(self._unexplained, str) else (self._unexplained,)
        return tuple(self.pool.causes[k] for k in self.best.members)

    @property
    def log_posterior_of_unexplained(self) -> float:
        """Log posterior of lack of fit (without generic terms), on the scale of the search."""
        return self.alternatives.by_label[UNEXPLAINED] + float(np.log(SIZE_PRIOR[1]))

    @property
    def log_odds_of_noise(self) -> float:
        """Log odds of noise of any size, without a cause, against the best causes under the noise as assumed."""
        of_level = self.alternatives.by_label.get("noise_level", -np.inf) + float(np.log(SIZE_PRIOR[1]))
        return (of_level if self.problem.known else self.search.posterior(())) - self.search.top

    @property
    def unexplained_by_repeats(self) -> str:
        """Description of an error without a name that repeats show, if it is the best explanation; otherwise ""."""
        alone = self.best.unexplained and not self.best.members
        return self._unexplained if alone and isinstance(self._unexplained, str) else ""

    @property
    def _unexplained(self) -> Cause | str:
        return self.alternatives.unexplained

    @property
    def large(self) -> bool:
        """Whether there is much more than noise."""
        return self.at.much_more_than(self.sigma)

    @property
    def of_effects(self) -> bool:
        """Whether effects lead alone; for a large one that jumps with the sign of an input, whether it is the only one."""
        members = self.members
        jumps = len(members) > 1 and any(cause.slot.kinked for cause in members) and self.large
        effects = bool(members) and all(cause.slot.columns for cause in members)
        return effects and not (jumps or self.contradicted)

    @property
    def with_signs(self) -> list[Members]:
        """The explanations with a sign variant, the most probable first."""
        variants = frozenset(self.pool.numbers_of(SIGNS).tolist())
        return [told.members for told in self.explanations if variants & {*told.members}]

    def improves(self, other: "Screened") -> bool:
        """Whether it is more probable than another screen of the same problem. Where the same causes lead, one must jump and
        the difference exceed rounding: otherwise no sign mattered."""
        gain = 0.0
        if self.best.labels == other.best.labels:
            gain = 0.5 * UNMOVED if any(cause.slot.kinked for cause in self.members) else np.inf
        return self.top > other.top + gain

    @property
    def contradicted(self) -> bool:
        """Whether the exact fit of the best explanation, if available, leaves a share of the sum of squares that it explains
        by the linear screen."""
        if self.fit is None or not (self.best.members and self.large):
            return False
        left = self.search.left(self.best.members)
        return self.fit.chi2 - left > CONTRADICTED * float(self.at.z @ self.at.z - left)

    @property
    def top(self) -> float:
        """Log posterior of the best set of causes; by its exact fit where that contradicts the screen."""
        if self.fit is None or not self.contradicted:
            return self.search.top
        return self.search.posterior_at(self.best.members, self.fit.chi2)

    @property
    def settled(self) -> bool:
        """Whether effects, or a noise that is not large, are so sure that no kink needs trying; what acts at single
        positions may stand for one."""
        plain = self.of_effects or not (self.members or self.large)
        return self.best.class_probability > SETTLED and not self.best.unexplained and plain
