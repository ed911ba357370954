"""One problem from readings to explanations: robust start, linearisation, causes, test, search."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.causes.cause import Cause
from tumblecal.diagnosis.causes.pool import Pool, pooled
from tumblecal.diagnosis.causes.sign_variants import sign_variants
from tumblecal.diagnosis.detection.alternatives import Alternatives, alternatives
from tumblecal.diagnosis.detection.detect import Detection, detect, detected_positions, detected_together
from tumblecal.diagnosis.priors import CURVED, MOST_RELINEARISATIONS, PROMISING, RIVAL_SHARE, SIZE, UNMOVED
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import Members, parts_of
from tumblecal.diagnosis.sets.classes import explanations
from tumblecal.diagnosis.sets.patchwork import Neighbours
from tumblecal.diagnosis.sets.positions_off import positions_off
from tumblecal.diagnosis.sets.prior import given_found
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.sets.setting_changes import SettingChanges
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.plausibility import implausible
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.evidence import log_evidence_of_noise
from tumblecal.full_model.full_model import FullModel
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.priors import LARGE, SIZE_PRIOR
from tumblecal.full_model.tangent import Tangent, robust_start, tangent


_log = logging.getLogger(__name__)
# A coefficient is too large when it is so by this many of its standard deviations.
_SURE_SD = 2.0
# Sets with a sign variant that are fitted exactly from each start.
_MOST_VARIED = 3


@dataclass(frozen=True)
class Screening:
    """The screen of the problems of one plan, which differ in their readings and noise.

    - `model`: the chain with every testable effect in it.
    - `size`: false alarms allowed, all causes together.
    - `corrected`: whether the noise was corrected from the data: its level is then unknown.
    - `noise_stands`: whether the stated noise is used in any case, because the readings were computed.
    - `found`: number of other causes found before: set-up errors, and faults of the noise.
    - `impossible`: ids of effects that would need coefficients beyond those of any instrument.
    - `usual`: largest usual sizes of parameters, base units, for those that differ from `estimation.plausibility.USUAL`.
    """

    model: FullModel
    size: float = SIZE
    corrected: bool = False
    noise_stands: bool = False
    impossible: frozenset[str] = frozenset()
    found: int = 0
    usual: Mapping[str, float] = field(default_factory=dict)

    def first(self, problem: Problem) -> Screened:
        """The screen around the nominal fit, nothing refined."""
        return self.around(robust_start(self.model, problem), problem)

    def __call__(self, problem: Problem, first: Screened | None = None) -> Screened:
        """Screen one problem; `first`: its screen around the nominal fit already.

        The screen is linear around the nominal fit; where the winner's exact fit contradicts that, it is repeated around
        the exact fit. Where that needs an effect of an impossible size, it is repeated without the effect; of an implausible
        size, if the result needs no implausible parameter.
        """
        first = first or self.first(problem)
        screened = self._relinearised(first)
        if screened.detection.detected and not screened.settled:
            screened = self._signs_varied(screened, first)
        for sizes in (_impossible, self._implausible):
            too_large = sizes(screened)
            without = replace(self, impossible=self.impossible | too_large)(problem) if too_large else screened
            if too_large and (too_large <= _impossible(screened) or not implausible(_fit_of(without), self.usual)):
                return without
        return screened

    def _implausible(self, screened: Screened) -> set[str]:
        """Ids of the effects of the best explanation with coefficients beyond the usual sizes."""
        if not any(cause.slot.columns for cause in screened.members):
            return set()
        unusual = {one.parameter for one in implausible(_fit_of(screened), self.usual)}
        return {cause.slot.id for cause in screened.members if not unusual.isdisjoint(cause.slot.names)}

    def _signs_varied(self, screened: Screened, first: Screened) -> Screened:
        """The most probable of a screen and of those around the exact fits of sets with a sign variant. These are sought around
        the nominal fit `first` and, where the signal is large and that fit may be far off, around the instrument without
        errors."""
        starts = [first]
        if screened.large:
            starts.append(self.around(self.model.start, screened.problem, screened.pool))
        for start in starts:
            varied = self._with_signs(start)
            for members in varied.with_signs[:_MOST_VARIED]:
                causes = [varied.pool.causes[k] for k in members]
                fit = fit_with(varied.at, causes)
                if not fit.code.good or varied.search.posterior_at(members, fit.chi2) < screened.top - PROMISING:
                    continue
                around = self.around(fit.vector, screened.problem, screened.pool, causes)
                again = self._relinearised(around)
                if again.detection.detected and again.improves(screened):
                    screened = again
            if screened.settled:
                break
        return screened

    def _with_signs(self, screened: Screened) -> Screened:
        """A screen with the sign variants as further candidates."""
        at, own = screened.at, screened.pool
        parts = [own, *sign_variants(at)]
        pool = Pool.joined(parts, at.dof, seen_effects=own.seen_effects, generic=own.generic).without(self.impossible)
        search = Search(pool, at.z, at.problem.known, self.found)
        return self._explained(at, pool, screened.alternatives, screened.detection, search)

    def _relinearised(self, screened: Screened) -> Screened:
        """The screen repeated around the exact fit of what leads, until that agrees with it."""
        like, tried = screened.pool, set[tuple[str, ...]]()
        before: tuple[tuple[int, ...], float] = (), np.nan
        for _ in range(MOST_RELINEARISATIONS):
            members = screened.members
            if not any(cause.slot.columns for cause in members):
                if members and all(cause.positions for cause in members):
                    screened = replace(screened, fit=fit_with(screened.at, members))
                break
            own = fit = fit_with(screened.at, members)
            linear_left = screened.search.left(screened.best.members)
            explained = (screened.at.z @ screened.at.z - linear_left) / screened.sigma**2
            if any(cause.left_out for cause in members):
                linear_left = min(linear_left, fit.chi2)
            spoilt = explained > LARGE**2 and not np.any(screened.at.of_effects)
            trusted = abs(fit.chi2 - linear_left) < CURVED * screened.sigma**2 and not spoilt
            if fit.code.good and trusted and screened.best.labels not in tried:
                tried.add(screened.best.labels)
                better = _better(screened, fit, bool(explained > LARGE**2))
                trusted, fit = better is None, better or fit
            # Of an effect that jumps with an input's sign the linear screen stays another than the exact fit.
            same = abs(fit.chi2 - before[1]) < UNMOVED * screened.sigma**2 and screened.best.members == before[0]
            if not fit.code.good or trusted or same:
                screened = replace(screened, fit=own)
                break
            before = screened.best.members, fit.chi2
            again = self.around(fit.vector, screened.problem, like, members)
            if not again.detection.detected:
                break
            screened = again
        return screened

    def around(
        self,
        vector: Float[np.ndarray, " full"],
        problem: Problem,
        like: Pool | None = None,
        likely: Sequence[Cause] = (),
    ) -> Screened:
        """The screen with the model linearised at a full vector; `like`: the causes around the nominal fit, whose generic terms
        and visible effects are used again; `likely`: causes whose effects are evaluated together in any case."""
        at = tangent(self.model, problem, vector)
        known, level = problem.known, at.rough_level
        generic, visible = (like.generic, like.visible) if like else (None, None)
        pool = pooled(at, level, generic, visible).without(self.impossible)
        others = alternatives(at, pool.effect_blocks)
        if self.noise_stands:
            others = replace(others, noise=replace(others.noise, listed=()))
        detection = detect(at, pool, others, self.size, level_estimated=self.corrected)
        search = Search(pool, at.z, known, self.found)
        if not detection.detected and not known:
            none = float(log_evidence_of_noise(at.z @ at.z, pool.dof, known))
            together = float(np.logaddexp(search.several(), others.lack_of_fit - none))
            detection = detected_together(detection, together, self.size)
        if not detection.detected and not known:
            detection = detected_positions(detection, positions_off(pool, at.z)[0], self.size)
        return self._explained(at, pool, others, detection, search, likely)

    def _explained(
        self,
        at: Tangent,
        pool: Pool,
        others: Alternatives,
        detection: Detection,
        search: Search,
        likely: Sequence[Cause] = (),
    ) -> Screened:
        """The sets of causes that explain what was detected; arguments as of `Screened` and `around`."""
        known = at.problem.known
        if detection.detected:
            ranked = search.run(likely=_effects_in(pool, likely))
        else:
            search.expand([()])
            ranked = search.ranked()
        sigma = 1.0 if known else search.sigma(ranked.set_at(0))
        of_one = float(np.log(SIZE_PRIOR[1]) + given_found(np.ones(1, int), self.found)[0])
        by_label = {label: value + of_one for label, value in others.by_label.items()}
        # Of a large signal, the linear screen gives no probability that could decide between a listed and an unnamed cause.
        named_first = bool(at.z @ at.z - search.left(ranked.set_at(0)) <= (LARGE * sigma) ** 2)
        found = explanations(
            search, ranked, by_label, sigma, Neighbours(at), SettingChanges(at), named_first=named_first
        )
        leads = " + ".join(found[0].labels) or "adequate"
        _log.debug(
            "%d causes, p = %.2g; %s leads with %.3f", pool.size, detection.p_value, leads, found[0].class_probability
        )
        return Screened(at, pool, others, detection, found, search, sigma)


def _effects_in(pool: Pool, causes: Sequence[Cause]) -> Members:
    """The effects among some causes as they are numbered in a pool; those that it lacks are left out."""
    slots = {(cause.slot.id, cause.slot.variant) for cause in causes if cause.slot.columns}
    if len(slots) < 2:
        return ()
    own = ((k, pool.slots[k]) for k in pool.effects.tolist())
    return tuple(k for k, slot in own if (slot.id, slot.variant) in slots)


def _better(screened: Screened, fit: Fit, large: bool) -> Fit | None:
    """The exact fit of a different set that, fitted exactly, is more probable than the leading one; None if there is none.

    For a large effect, each part of the explanation is tried: the other parts may only compensate the linearisation.
    Alternatives with a time constant are tried too: the screen has it at its start value.
    """
    search, best = screened.search, screened.best.members
    needed = _needed(screened, fit) if large else set()
    sets = [part for part in parts_of(best) if part and needed <= {*part}] if large else []
    probable = [other.members for other in screened.explanations if other.own_probability > RIVAL_SHARE]
    sets += [members for members in probable if any(screened.pool.slots[k].shape for k in members)]
    top, better = search.posterior_at(best, fit.chi2), None
    for members in sorted(set(sets) - {best}):
        other = fit_with(screened.at, [screened.pool.causes[k] for k in members])
        posterior = search.posterior_at(members, other.chi2)
        if other.code.good and posterior > top:
            top, better = posterior, other
    return better


def _needed(screened: Screened, fit: Fit) -> set[int]:
    """Which members of the best explanation are effects without which its exact fit would be far worse, by their sizes there
    in standard deviations (Wald's statistic). For one that jumps with the sign of an input this is no indication."""
    needed = set[int]()
    for number in screened.best.members:
        slot = screened.pool.slots[number]
        if slot.columns and not slot.kinked:
            sizes, covariance = _coefficients(fit, slot)
            if (
                np.all(np.isfinite(covariance))
                and sizes @ np.linalg.pinv(covariance, hermitian=True) @ sizes > LARGE**2
            ):
                needed.add(number)
    return needed


def _fit_of(screened: Screened) -> Fit:
    """The exact fit of the best explanation."""
    return screened.fit or fit_with(screened.at, screened.members)


def _impossible(screened: Screened) -> set[str]:
    """Ids of the effects of the best explanation whose coefficients in its exact fit are larger than any instrument has."""
    fit = screened.fit
    if fit is None or not fit.code.good:
        return set()
    impossible = set[str]()
    for slot in (cause.slot for cause in screened.members if cause.slot.columns):
        sizes, covariance = _coefficients(fit, slot)
        if np.any(np.abs(sizes) - _SURE_SD * np.sqrt(np.diag(covariance)) > slot.largest):
            impossible.add(slot.id)
    return impossible


def _coefficients(fit: Fit, slot: Slot) -> tuple[Float[np.ndarray, " columns"], Float[np.ndarray, "columns columns"]]:
    """An effect's coefficients in an exact fit, time constants aside, and their covariance by the noise alone; base units."""
    own = [fit.names.index(slot.names[slot.all_columns.index(column)]) for column in slot.columns]
    return fit.values[own], fit.noise_covariance[np.ix_(own, own)]
