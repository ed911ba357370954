"""One problem from readings to explanations: robust start, linearisation, causes, test, search."""

import logging
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.generic import UNEXPLAINED
from tumblecal.diagnosis.causes.pool import Pool, pooled
from tumblecal.diagnosis.detection.alternatives import Alternatives, alternatives
from tumblecal.diagnosis.detection.detect import Detection, detect, detected_together
from tumblecal.diagnosis.detection.reference import Reference
from tumblecal.diagnosis.evidence import log_evidence_of_noise
from tumblecal.diagnosis.exact.insert import fit_with
from tumblecal.diagnosis.exact.kinks import kink_start, turns_a_sign
from tumblecal.diagnosis.model.full_model import FullModel
from tumblecal.diagnosis.model.tangent import Tangent, robust_start, tangent
from tumblecal.diagnosis.sets.cause_sets import MOST
from tumblecal.diagnosis.sets.classes import Explanation, explanations
from tumblecal.diagnosis.sets.patchwork import Neighbours
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.tuning import (
    CURVED,
    KINK,
    LARGE,
    MOST_RELINEARISATIONS,
    RIVAL_SHARE,
    SETTLED,
    SIZE,
    SIZE_PRIOR,
    UNMOVED,
)
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.problem import Problem
from tumblecal.ground.showing import brief


_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Screened:
    """What the linear screen says of one problem.

    `sigma` is the noise in units of the white rows: 1 where it is known, else the best explanation's own.
    `fit`: the exact fit of the best explanation, where it was made.
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
        """Log posterior of what no entry describes, generic terms aside, on the search's scale."""
        return self.alternatives.by_label[UNEXPLAINED] + float(np.log(SIZE_PRIOR[1]))

    @property
    def unexplained_by_repeats(self) -> str:
        """In words what comes back in repeats and no entry describes, where that is the best explanation; else ""."""
        alone = self.best.unexplained and not self.best.members
        return self._unexplained if alone and isinstance(self._unexplained, str) else ""

    @property
    def _unexplained(self) -> Cause | str:
        return self.alternatives.unexplained


@dataclass(frozen=True)
class Screening:
    """The screen of the problems of one plan, which differ in their readings and noise.

    - `model`: the chain with every testable effect in it.
    - `reference`: what the plan alone decides.
    - `size`: false alarms allowed, all causes together.
    - `corrected`: whether the noise was corrected from the data: its level is not known then.
    - `noise_stands`: whether the noise is as stated whatever the data look like, because they were computed.
    """

    model: FullModel
    reference: Reference
    size: float = SIZE
    corrected: bool = False
    noise_stands: bool = False

    def __call__(self, problem: Problem) -> Screened:
        """Screen one problem.

        The screen is linear around the nominal fit; where the winner's exact fit contradicts that, it is repeated around
        the exact fit.
        """
        screened = self.around(robust_start(self.model, problem), problem)
        if screened.detection.detected and not _settled(screened):
            screened = self._kinks_tried(screened)
        visible, tried = screened.pool.visible, set[tuple[str, ...]]()
        before: tuple[tuple[int, ...], float] = (), np.nan
        for number in range(MOST_RELINEARISATIONS):
            members = screened.members
            if not any(cause.slot.columns for cause in members):
                break
            fit = fit_with(screened.at, members)
            linear_left = screened.search.left(screened.best.members)
            explained = (screened.at.z @ screened.at.z - linear_left) / screened.sigma**2
            if any(cause.left_out for cause in members):
                linear_left = min(linear_left, fit.chi2)
            trusted = abs(fit.chi2 - linear_left) < CURVED * screened.sigma**2 and (explained < LARGE**2 or number)
            if fit.code.good and trusted and screened.best.labels not in tried:
                tried.add(screened.best.labels)
                better = _better(screened, fit, bool(explained > LARGE**2))
                trusted, fit = better is None, better or fit
            # Of an effect that jumps with an input's sign the linear screen stays another than the exact fit.
            same = abs(fit.chi2 - before[1]) < UNMOVED * screened.sigma**2 and screened.best.members == before[0]
            if not fit.code.good or trusted or same:
                screened = replace(screened, fit=fit)
                break
            before = screened.best.members, fit.chi2
            again = self.around(fit.vector, problem, visible)
            if not again.detection.detected:
                break
            screened = again
        return screened

    def _kinks_tried(self, screened: Screened) -> Screened:
        """The screen around the exact fit of an effect that jumps with an input's sign, where that explains more."""
        causes, best = screened.pool.causes, screened.best.members
        if not _of_effects(screened):
            start = kink_start(screened.at, screened.members, screened.sigma)
            better = screened if start is None else self._better_around(start, screened)
            if better is not screened:
                return better
        faults = tuple(k for k in best if causes[k].positions)
        effects = tuple(k for k in best if causes[k].slot.columns)
        own, large = (faults, effects, (*faults, *effects)), _large(screened)
        for beside in dict.fromkeys((*own, *_parts_of_leading_effects(screened))):
            for k in screened.pool.effects.tolist():
                cause = causes[k]
                if not cause.slot.kinked or k in best or len(beside) >= MOST:
                    continue
                together = [*(causes[other] for other in beside), cause]
                small = not large and all(other.slot.columns for other in together)
                if small and not turns_a_sign(screened.at, together):
                    continue
                fit = fit_with(screened.at, together)
                if fit.chi2 > screened.search.left((*beside, k)) - KINK * screened.sigma**2:
                    continue
                better = self._better_around(fit.vector, screened)
                if better is not screened and (beside in own or _settled(better)):
                    return better
        return screened

    def _better_around(self, vector: Float[np.ndarray, " full"], screened: Screened) -> Screened:
        """The screen around a full vector where a set is more probable in it; else the one given."""
        again = self.around(vector, screened.problem, screened.pool.visible)
        return again if again.detection.detected and again.search.top > screened.search.top else screened

    def around(
        self, vector: Float[np.ndarray, " full"], problem: Problem, visible: frozenset[str] | None = None
    ) -> Screened:
        """The screen with the model linearised at a full vector; `visible` as of `pooled`."""
        at = tangent(self.model, problem, vector)
        known, level = problem.known, at.rough_level
        pool = pooled(at, level, self.reference.pool.generic, visible)
        beside = alternatives(at, pool.effect_blocks)
        if self.noise_stands:
            beside = replace(beside, noise=replace(beside.noise, listed=()))
        null = self.reference.null_of_unknown if self.corrected else self.reference.null
        detection = detect(at, pool, beside, null, self.size, own_null=not self.reference.stands_for(at))
        search = Search(pool, at.z, known)
        if not detection.detected and not known:
            none = float(log_evidence_of_noise(at.z @ at.z, pool.dof, known))
            together = float(np.logaddexp(search.several(), beside.lack_of_fit - none))
            detection = detected_together(detection, together, self.size)
        if detection.detected:
            ranked = search.run()
        else:
            search.expand([()])
            ranked = search.ranked()
        sigma = 1.0 if known else search.sigma(ranked.set_at(0))
        by_label = {label: value + float(np.log(SIZE_PRIOR[1])) for label, value in beside.by_label.items()}
        told = explanations(search, ranked, by_label, sigma, Neighbours(at))
        leads = " + ".join(told[0].labels) or "adequate"
        _log.debug("%d causes, p = %.2g; %s leads with %.3f", pool.size, detection.p_value, leads, told[0].probability)
        return Screened(at, pool, beside, detection, told, search, sigma)


def _settled(screened: Screened) -> bool:
    """Whether effects, or a noise that is not large, are so sure that no kink needs trying; what acts at single positions may
    stand for one."""
    best = screened.best
    plain = _of_effects(screened) or not (screened.members or _large(screened))
    return best.probability > SETTLED and not best.unexplained and plain


def _of_effects(screened: Screened) -> bool:
    """Whether effects lead alone; one that jumps with an input's sign, and is large, alone or with none beside it."""
    members = screened.members
    jumps = len(members) > 1 and any(cause.slot.kinked for cause in members) and _large(screened)
    return bool(members) and all(cause.slot.columns for cause in members) and not jumps


def _large(screened: Screened) -> bool:
    """Whether there is much more than noise: of what is left of an effect that is not understood the noise is told by the
    median."""
    sigma = min(screened.sigma, screened.at.rough_level)
    return bool(screened.at.z @ screened.at.z > LARGE**2 * sigma**2)


def _parts_of_leading_effects(screened: Screened) -> list[tuple[int, ...]]:
    """The effects of the most probable set of causes, and each of them alone, where a large signal seems to be something
    else: beside it an effect that jumps may lie on the wrong side."""
    if screened.best.members or not _large(screened):
        return []
    leading = next((told.members for told in screened.explanations if told.members), ())
    effects = tuple(k for k in leading if screened.pool.causes[k].slot.columns)
    return [effects, *((k,) for k in effects)]


def _better(screened: Screened, fit: Fit, large: bool) -> Fit | None:
    """The exact fit of another set that, fitted exactly, is more probable than the leading one; None where that stays.

    Of a large effect's explanation each part is tried: what is beside it may only make up for the linearisation. Rivals with a
    time constant are tried as well: the screen has it at its start.
    """
    search, best = screened.search, screened.best.members
    sets = [part for size in range(1, len(best)) for part in combinations(best, size)] if large else []
    rivals = [told.members for told in screened.explanations if told.own_probability > RIVAL_SHARE]
    sets += [members for members in rivals if any(screened.pool.causes[k].slot.shape for k in members)]
    top, better = search.posterior_at(best, fit.chi2), None
    for members in sorted(set(sets) - {best}):
        other = fit_with(screened.at, [screened.pool.causes[k] for k in members])
        posterior = search.posterior_at(members, other.chi2)
        if other.code.good and posterior > top:
            top, better = posterior, other
    return better
