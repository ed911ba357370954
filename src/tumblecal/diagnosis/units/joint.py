"""The joint diagnosis of separately screened units: shared errors, errors of the head, remaining errors of each unit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tumblecal.chain.head_file import MeasuredHead
from tumblecal.diagnosis.priors import OUTLYING_UNIT, SURE, TOO_LARGE_SD
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.units.amounts import TwoLevels, UnitAmounts, two_levels, unit_amounts
from tumblecal.diagnosis.units.head_fit import HeadFit, head_fit, most_excluded
from tumblecal.diagnosis.units.search import JointPosterior, SharedExplanation, joint_posterior
from tumblecal.diagnosis.units.unit import Batch, SharedSignal, linearised
from tumblecal.estimation.plausibility import Implausible, implausible_head
from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class JointDiagnosis:
    """Units on one head.

    - `joint`: shared errors, by probability; `fit`: errors of the head; `implausible`: those beyond the usual range.
    - `levels`: errors of the head that change at some unit.
    """

    batch: Batch
    joint: JointPosterior
    fit: HeadFit
    implausible: tuple[Implausible, ...] = ()
    levels: tuple[TwoLevels, ...] = ()

    @property
    def hand_held(self) -> bool:
        """Whether no head is involved: the attitudes are unknown."""
        return any(unit.at.model.hand_held for unit in self.batch.units)

    @property
    def verdict(self) -> str:
        """The verdict for the shared errors: adequate, identified, ambiguous or unexplained."""
        best, levels = self.joint.best, [levels.signal.label for levels in self.levels]
        # Errors that are not the same for all units.
        differing = best.by_unit if self.hand_held else best.head_by_unit if self.joint.detected else levels
        if best.shared.unexplained or (self.implausible and not (best.shared.labels or differing)):
            return "unexplained"
        if best.shared.labels:
            sure = best.shared.single_name and best.probability >= SURE
        elif differing:
            sure = len(differing) == 1 and self.joint.by_unit_probability(differing[0]) >= SURE
        else:
            return "adequate"
        return "identified" if sure and not self.implausible else "ambiguous"

    @property
    def measured(self) -> MeasuredHead | None:
        """The head for later measurements; None if there is no result, an implausible one, or one between two levels."""
        between = {levels.signal.label for levels in self.levels} & {signal.label for signal in self.shared}
        return None if self.implausible or between else self.fit.head

    @cached_property
    def amounts(self) -> dict[str, UnitAmounts]:
        """Amount in every unit of each effect that differs between units or has two levels, by its id."""
        signals = (*(levels.signal for levels in self.levels), *self.joint.best.varying)
        return {signal.label: unit_amounts(self.batch, self.joint.best, signal) for signal in signals}

    @property
    def shared(self) -> tuple[SharedSignal, ...]:
        """The effects of the catalogue that all units share, by the explanation acted on."""
        return tuple(signal for signal in self.joint.best.signals if signal.is_effect)

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Further shared errors that are not in the catalogue, in words."""
        return tuple(signal.words for signal in self.joint.best.signals if not signal.is_effect)

    @property
    def nothing_of_their_own(self) -> tuple[int, ...]:
        """Numbers of the units that need no cause in addition to an error of the head without a name or with two levels. This
        error is not given to them, so their separate diagnoses show it."""
        if not (self.unexplained or self.levels):
            return ()
        causes = enumerate(self.joint.best.hypothesis.unit_causes)
        return tuple(k for k, own in causes if not own and k not in self.fit.excluded)

    @property
    def outlying(self) -> tuple[int, ...]:
        """Numbers of the deviating units: by their separate estimate of the shared errors, or because they need an error of
        the head that no other unit has."""
        deviating = set(self.fit.excluded)
        if self.shared:
            least = OUTLYING_UNIT / len(self.batch.units)
            rows = zip(self.batch.units, self.joint.best.hypothesis.unit_causes, self.fit.consistent, strict=True)
            needs = (p_value < least or unit.without_head(own) != own for unit, own, p_value in rows)
            deviating |= {number for number, one in enumerate(needs) if one}
        return tuple(sorted(deviating))

    def known_to(self, number: int) -> MeasuredHead | None:
        """Prior of the head for the diagnosis of one unit, as measured by the others. There is none for a deviating unit, or
        if no result of the head can be used later. With unknown noise, the errors from all units are treated as exact."""
        if number in self.outlying or self.measured is None:
            return None
        return self.fit.without(number) if self.batch.noise_known else self.fit.head


def joint_diagnosis(
    screened: Sequence[Screened], sources: Sequence[str], usual: Mapping[str, float] | None = None
) -> JointDiagnosis:
    """Diagnose units together that were screened one by one.

    **Arguments:**

    - `sources`: the units' files, in the same order.
    - `usual`: the largest usual sizes of parameters, as of `estimation.plausibility.implausible`.

    **Raises:** `InputError` for fewer than two units, or if only some are hand-held.
    """
    if len(screened) < 2:
        raise InputError(
            "--units: at least two units must be diagnosed; one file does not show which errors are shared"
        )
    held = [source for source, unit in zip(sources, screened, strict=True) if unit.at.model.hand_held]
    if held and len(held) < len(screened):
        raise InputError(
            f"--units: {', '.join(held)}: attitudes unknown (hand-held), but other files state angles of a head; "
            "run them separately"
        )
    starts = [linearised(unit) for unit in screened]
    impossible, excluded = frozenset[str](), frozenset[int]()
    while True:
        batch = Batch.of(starts, impossible)
        joint = joint_posterior(batch.excluding(excluded))
        found = JointDiagnosis(batch, joint, head_fit(batch, joint.best, sources, excluded))
        too_large = impossible_effects(found.joint.best, found.fit.head) - impossible
        # A deviating unit would add a part of its error to the shared errors.
        more = frozenset(found.outlying) | {*found.fit.pitch.alone}
        if too_large:
            impossible |= too_large
        elif more <= excluded or len(more) > most_excluded(len(starts)):
            break
        else:
            excluded |= more
    head, levels = found.fit.head, tuple(two_levels(found.batch, found.joint.best))
    return replace(found, implausible=implausible_head(head, usual) if head is not None else (), levels=levels)


def impossible_effects(best: SharedExplanation, head: MeasuredHead | None) -> frozenset[str]:
    """Ids of the effects of an explanation that would need coefficients such as no head has (`Effect.largest`), common to all
    units or differing between them."""
    sizes = dict(zip(head.names, np.abs(head.values) - TOO_LARGE_SD * head.sd, strict=True)) if head else {}
    largest = [(signal, [sizes.get(name, 0.0) for name in signal.slot.names]) for signal in best.signals]
    largest += [(one.signal, [one.tau * max(one.signal.scales)]) for one in best.hypothesis.random_effects]
    return frozenset(signal.label for signal, own in largest if max(own, default=0.0) > signal.slot.largest)
