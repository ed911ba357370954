"""The joint diagnosis of separately screened units: shared errors, errors of the head, remaining errors of each unit."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincc

from tumblecal.chain.head_file import MeasuredHead
from tumblecal.diagnosis.causes.pool import pooled
from tumblecal.diagnosis.model.tangent import tangent
from tumblecal.diagnosis.priors import LARGE, MOST_RELINEARISATIONS
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.units.joint import Joint, joint
from tumblecal.diagnosis.units.measured import HeadFit, measured_head
from tumblecal.diagnosis.units.own_amounts import OwnAmounts, own_amounts
from tumblecal.diagnosis.units.set_aside import has_head_of_its_own, impossible_effects, most_aside
from tumblecal.diagnosis.units.two_levels import TwoLevels, two_levels
from tumblecal.diagnosis.units.unit import Linearised, SharedSignal, Unit, linearised, shared_signals, unit_of
from tumblecal.diagnosis.units.unit_fit import Information
from tumblecal.estimation.plausibility import Implausible, implausible_head
from tumblecal.ground.errors import InputError


# A unit deviates if its estimate of the shared errors is less probable than this, over all units together.
_OUTLYING = 0.01
# A solution so near to where its unit was linearised (in its noise) is not linearised again: the next step was at most a
# tenth of it (10 units with effects of 30 and 100 sigma).
_SETTLED = 0.05
# Directions of information below this share of the largest contain only rounding errors.
_ROUNDING = 1e-10


@dataclass(frozen=True)
class Together:
    """Units on one head.

    - `joint`: shared errors, by probability; `fit`: errors of the head; `implausible`: those beyond the usual range.
    - `levels`: errors of the head that change at some unit.
    - `consistent`: for each unit the probability that its separate estimate of the shared errors deviates so much by noise
      alone.
    """

    units: tuple[Unit, ...]
    joint: Joint
    fit: HeadFit
    consistent: tuple[float, ...]
    implausible: tuple[Implausible, ...] = ()
    levels: tuple[TwoLevels, ...] = ()

    @property
    def hand_held(self) -> bool:
        """Whether no head is involved: the attitudes are unknown."""
        return any(unit.at.model.hand_held for unit in self.units)

    @property
    def verdict(self) -> str:
        """The verdict for the shared errors: adequate, identified, ambiguous or unexplained."""
        common = self.joint.best.spreads
        if self.hand_held:
            return self.joint.differing(common) if common else "adequate"
        verdict = self.joint.verdict
        if verdict == "adequate" and self.levels:
            verdict = self.joint.differing([own.signal.label for own in self.levels])
        if not self.implausible:
            return verdict
        return {"adequate": "unexplained", "identified": "ambiguous"}.get(verdict, verdict)

    @property
    def measured(self) -> MeasuredHead | None:
        """The head for later measurements; None if there is no result, an implausible one, or one between two levels."""
        between = {own.signal.label for own in self.levels} & {signal.label for signal in self.shared}
        return None if self.implausible or between else self.fit.head

    def amounts(self, signal: SharedSignal) -> OwnAmounts:
        """Amount of an effect in every unit."""
        best = self.joint.best
        return own_amounts(self.units, best.weighed, best.told.members, signal)

    @property
    def shared(self) -> tuple[SharedSignal, ...]:
        """The effects of the catalogue that all units share, by the explanation acted on."""
        best = self.joint.best
        signals = (best.weighed.signals[k] for k in best.told.members)
        return tuple(signal for signal in signals if signal.slot.columns)

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Further shared errors that are not in the catalogue, in words."""
        best = self.joint.best
        signals = (best.weighed.signals[k] for k in best.told.members)
        return tuple(signal.words for signal in signals if not signal.slot.columns)

    @property
    def nothing_of_their_own(self) -> tuple[int, ...]:
        """Numbers of the units that need no cause in addition to an error of the head without a name or with two levels. This
        error is not given to them, so their separate diagnoses show it."""
        own = self.joint.best.weighed.own
        if not (self.unexplained or self.levels):
            return ()
        return tuple(k for k, causes in enumerate(own) if not causes.members and k not in self.fit.aside)

    @property
    def outlying(self) -> tuple[int, ...]:
        """Numbers of the deviating units: by their separate estimate of the shared errors, or because they need an error of
        the head that no other unit has."""
        aside = self.fit.aside
        if not self.shared:
            return tuple(sorted(aside))
        least, own = _OUTLYING / len(self.units), self.joint.best.weighed.own
        off = (k for k, p in enumerate(self.consistent) if p < least or has_head_of_its_own(self.units[k], own[k]))
        return tuple(sorted(aside | {*off}))

    def known_to(self, number: int) -> MeasuredHead | None:
        """Prior of the head for the diagnosis of one unit, as measured by the others. There is none for a deviating unit, or
        if no result of the head can be used later. With unknown noise, the errors from all units are treated as exact."""
        if number in self.outlying or self.measured is None:
            return None
        known = all(unit.at.problem.known for unit in self.units)
        return self.fit.without(number) if known else self.fit.head


def together(
    screened: Sequence[Screened], sources: Sequence[str], usual: Mapping[str, float] | None = None
) -> Together:
    """Take units together that were screened one by one.

    **Arguments:**

    - `sources`: the units' files, in the same order.
    - `usual`: the largest usual sizes of parameters, as of `estimation.plausibility.implausible`.

    **Raises:** `InputError` for fewer than two units.
    """
    if len(screened) < 2:
        raise InputError(
            "--units: at least two units must be diagnosed; one file does not show which errors are shared"
        )
    hand_held = [unit.at.model.hand_held for unit in screened]
    if any(hand_held) and not all(hand_held):
        held = ", ".join(source for source, own in zip(sources, hand_held, strict=True) if own)
        raise InputError(
            f"--units: {held}: attitudes unknown (hand-held), but other files state angles of a head; run them separately"
        )
    starts = [linearised(unit) for unit in screened]
    impossible, aside = frozenset[str](), frozenset[int]()
    while True:
        found = _judged(starts, shared_signals(starts, impossible), aside, sources)
        too_large = impossible_effects(found.joint.best, found.fit.head) - impossible
        if too_large:
            impossible |= too_large
            continue
        # A deviating unit would add a part of its error to the shared errors.
        more = frozenset(found.outlying) | {*found.fit.pitch.alone}
        if more <= aside or len(more) > most_aside(len(starts)):
            break
        aside |= more
    head, best = found.fit.head, found.joint.best
    return replace(
        found,
        implausible=implausible_head(head, usual) if head is not None else (),
        levels=tuple(two_levels(found.units, best.weighed, best.told.members)),
    )


def _judged(
    starts: Sequence[Linearised], signals: Sequence[SharedSignal], aside: frozenset[int], sources: Sequence[str]
) -> Together:
    """What the units share, some of them set aside; around the solution where that is large."""
    units, number = [unit_of(start, signals) for start in starts], 0
    while True:
        judged = [unit.apart if k in aside else unit for k, unit in enumerate(units)]
        told = joint(judged, signals)
        fit = measured_head(units, told.best, sources, aside)
        vectors = [unit.at.vector if k in aside else fit.vectors[k] for k, unit in enumerate(units)]
        bent = max(_signals(judged, told)) > LARGE and max(_steps(units, vectors)) > _SETTLED
        renoised = number == 0 and bool(told.best.told.labels) and not all(unit.at.problem.known for unit in units)
        if number == MOST_RELINEARISATIONS or not (bent or renoised):
            return Together(tuple(units), told, fit, tuple(_consistent(fit)))
        # Again around the shared solution, and with the noise that it leaves.
        units = [unit_of(start, signals) for start in _around(units, vectors, _levels(judged, told))]
        number += 1


def _around(
    units: Sequence[Unit], vectors: Sequence[Float[np.ndarray, " full"]], levels: Iterable[float]
) -> Iterator[Linearised]:
    """The units linearised at other vectors, with other noise."""
    for unit, vector, level in zip(units, vectors, levels, strict=True):
        at = tangent(unit.at.model, unit.at.problem, vector)
        yield Linearised(at, pooled(at, level, unit.pool.generic), level)


def _signals(units: Sequence[Unit], told: Joint) -> Iterator[float]:
    """How large what is shared is in each unit's residual space, in its noise."""
    shared = told.best.weighed.coefficients(told.best.told.members)
    return (float(np.linalg.norm(unit.response @ shared)) for unit in units)


def _steps(units: Sequence[Unit], vectors: Sequence[Float[np.ndarray, " full"]]) -> Iterator[float]:
    """How far each unit's solution is from where it was linearised, in its noise."""
    for unit, vector in zip(units, vectors, strict=True):
        moved = (vector - unit.at.vector) / unit.at.model.scales
        yield float(np.linalg.norm(unit.at.jacobian @ moved)) / unit.sigma


def _levels(units: Sequence[Unit], told: Joint) -> Iterator[float]:
    """Each unit's noise, in units of its white rows, as the best explanation leaves it."""
    weighed = told.best.weighed
    left = weighed.left(units, told.best.told.members)
    for unit, z, own in zip(units, left, weighed.own, strict=True):
        base = Search(unit.pool, z, True).base(own.members)
        free = max(1, unit.pool.dof - base.q.shape[1])
        yield 1.0 if unit.at.problem.known else unit.sigma * float(np.sqrt(base.left / free))


def _consistent(fit: HeadFit) -> Iterator[float]:
    """For each unit the probability that its own estimate of what is shared is so far from the others' by noise alone."""
    whole, nothing = fit.whole, np.zeros_like(fit.whole.matrix)
    for number, part in enumerate(fit.parts):
        counted = part if number not in fit.aside else Information(nothing, np.zeros(len(nothing)))
        others = np.linalg.pinv(whole.matrix - counted.matrix, rcond=_ROUNDING, hermitian=True)
        off = part.towards - part.matrix @ (others @ (whole.towards - counted.towards))
        scatter = part.matrix + part.matrix @ others @ part.matrix
        dof = int(np.linalg.matrix_rank(part.matrix, rtol=_ROUNDING, hermitian=True)) if len(nothing) else 0
        chi2 = float(off @ np.linalg.pinv(scatter, rcond=_ROUNDING, hermitian=True) @ off)
        yield float(gammaincc(dof / 2, chi2 / 2)) if dof else 1.0
