"""Residual of one unit of a batch, by the signals that all units may share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.diagnosis.causes.cause import NO_SLOT, Cause
from tumblecal.diagnosis.causes.generic import GENERIC, HEAD_ANGLES, UNEXPLAINED
from tumblecal.diagnosis.causes.pool import Pool, pooled
from tumblecal.diagnosis.detection.detect import statistics
from tumblecal.diagnosis.evidence import log_evidence
from tumblecal.diagnosis.model.full_model import FullModel
from tumblecal.diagnosis.model.layout import Slot
from tumblecal.diagnosis.model.tangent import Tangent, tangent
from tumblecal.diagnosis.priors import SIZE_PRIOR
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.search import Search
from tumblecal.effects.effect import of_head


# Log Bayes factor of one cause against none below which no set of causes can lead.
_NOT_EVEN = -1.0
# The residual of a unit is searched once within this distance (in its noise): 877 of 877 searches so near to an earlier one,
# and 212 of 212 within five times that, found the same causes (96 units with effects of 20 and 30 sigma).
_SAME = 0.1
# Generic terms are counted in this size, g or rad.
_TERM_SCALE = 1e-4


class SharedSignal(NamedTuple):
    """A signal that several units can show: an effect of the catalogue, or a generic error of the head.

    `columns`: its columns among those of all shared signals; `of_head`: whether it acts before the triad's mount; `scales`:
    sizes in which its coefficients are counted, base units.
    """

    label: str
    words: str
    slot: Slot
    of_head: bool
    scales: tuple[float, ...]
    columns: tuple[int, ...] = ()

    @property
    def names_and_units(self) -> list[tuple[str, str]]:
        """Of its coefficients, in the order of `columns`; a time constant is none."""
        whole = zip(self.slot.all_columns, self.slot.names, self.slot.units, strict=True)
        return [(name, unit) for column, name, unit in whole if column in self.slot.columns]

    def slot_in(self, slots: Mapping[tuple, Slot]) -> Slot | None:
        """Its slot among those of a unit's model (`slots_of`); none where it cannot act there."""
        return slots.get(_slot_key(self.slot))

    @property
    def cause(self) -> tuple:
        """Key of its cause, independent of the plan."""
        return (self.label, self.words, self.slot.names)

    @property
    def key(self) -> tuple:
        """Key of the signal; it also distinguishes signals of one cause with different time constants."""
        return (*self.cause, self.slot.variant)


def slots_of(model: FullModel) -> dict[tuple, Slot]:
    """The slots of a model by keys that do not depend on the plan."""
    return {_slot_key(slot): slot for slot in model.slots}


def _slot_key(slot: Slot) -> tuple:
    return slot.id, slot.names, slot.variant


class Linearised(NamedTuple):
    """A unit where it is linearised: its causes there, and its noise in units of the white rows."""

    at: Tangent
    pool: Pool
    sigma: float


def linearised(screened: Screened) -> Linearised:
    """A unit as it was screened; where an effect with a time constant leads, with the time constant that fits.

    The joint model is linear: of a strong warm-up a time constant that is only near leaves more than many an error of the head.
    """
    known = screened.problem.known
    timed = [cause.slot for cause in screened.members if cause.slot.shape]
    fit = screened.fit or fit_with(screened.at, screened.members) if timed or screened.large else None
    if fit is None or not fit.code.good:
        # Not the leading set's noise where nothing was detected: the best of hundreds of causes takes a tenth of it.
        sigma = 1.0 if known else screened.search.sigma(screened.best.members)
        return Linearised(screened.at, screened.pool, sigma)
    model = screened.at.model.with_time_constants({slot.id: fit.vector[list(slot.shape)] for slot in timed})
    vector = fit.vector.copy() if screened.large else screened.at.vector.copy()
    vector[model.layout.shapes] = model.start[model.layout.shapes]
    at = tangent(model, screened.problem, vector)
    sigma = 1.0 if known else float(np.sqrt(fit.chi2 / fit.dof))
    return Linearised(at, pooled(at, sigma, screened.pool.generic, screened.pool.visible), sigma)


def shared_signals(units: Sequence[Linearised], impossible: frozenset[str] = frozenset()) -> tuple[SharedSignal, ...]:
    """The signals that at least two units can show, with consecutive column numbers, without the effects of some ids.

    A sensor effect with a time constant is one signal for each time constant that is tried first: all units may have it, each
    with a different amount. An effect of the head with a time constant is never shared.
    """
    counts: dict[tuple, int] = {}
    signals: dict[tuple, SharedSignal] = {}
    for unit in units:
        slots = [seen.slot for seen in unit.pool.seen if seen.block.shape[1]]
        slots = [slot for slot in slots if not (slot.shape and of_head(slot.links))]
        listed = [
            SharedSignal(
                slot.id, "", slot, of_head(slot.links), tuple(unit.at.model.scales[list(slot.columns)].tolist())
            )
            for slot in slots
        ]
        # What an output does by itself is its sensor's: only turns of the head can be common to all units.
        words = [cause.words for cause in _generic(unit.pool) if not cause.words.startswith("output ")]
        words += _holes(unit.at)
        listed += [SharedSignal(UNEXPLAINED, text, NO_SLOT, True, (_TERM_SCALE,)) for text in words]
        for signal in listed:
            counts[signal.key] = counts.get(signal.key, 0) + 1
            signals.setdefault(signal.key, signal)
    numbered, first = [], 0
    for key, signal in signals.items():
        if counts[key] > 1 and signal.label not in impossible:
            width = len(signal.scales)
            numbered.append(signal._replace(columns=tuple(range(first, first + width))))
            first += width
    return tuple(numbered)


def _generic(pool: Pool) -> list[Cause]:
    """The generic terms of one coefficient."""
    numbers = pool.numbers_of(GENERIC)
    return [pool.causes[k] for k in numbers[pool.ranks[numbers] == 1].tolist()]


def _holes(at: Tangent) -> dict[str, Bool[np.ndarray, " positions"]]:
    """The positions at each angle, measured more than once, at which the index may be in error, at any pitch."""
    if at.model.hand_held:
        return {}
    alpha = np.round(np.degrees(np.asarray(at.problem.where.alpha)) % 360.0, 3) % 360.0
    angles, counts = np.unique(alpha, return_counts=True)
    return {f"{HEAD_ANGLES[0]}: at {angle:g} deg alone": alpha == angle for angle in angles[counts > 1].tolist()}


class OwnCauses(NamedTuple):
    """Causes of one unit alone, by their numbers in its pool, and the logarithm of their prior."""

    members: tuple[int, ...] = ()
    log_prior: float = float(np.log(SIZE_PRIOR[0]))


NOTHING = OwnCauses()


class Reduced(NamedTuple):
    """A unit given its causes: log evidence without shared errors, and the normal equations of the shared signals."""

    log_evidence: float
    gram: Float[np.ndarray, "columns columns"]
    towards: Float[np.ndarray, " columns"]


@dataclass(frozen=True)
class Unit:
    """One unit, in units of its noise.

    - `at`: its linearised problem; `pool`: its causes; `sigma`: its noise in units of the white rows.
    - `signals` (rows, columns): white rows of the shared signals, zero if the unit lacks a required column.
    """

    at: Tangent
    pool: Pool
    sigma: float
    signals: Float[np.ndarray, "rows columns"]
    _searched: list[tuple[Float[np.ndarray, " nu"], OwnCauses]] = field(default_factory=list)

    @cached_property
    def z(self) -> Float[np.ndarray, " nu"]:
        """Residual of the nominal model."""
        return self.at.z / self.sigma

    @cached_property
    def response(self) -> Float[np.ndarray, "nu columns"]:
        """The shared signals in the residual space."""
        return self.at.basis.T @ self.signals

    @cached_property
    def whole(self) -> Float[np.ndarray, "columns columns"]:
        """Normal equations of the shared signals before the nominal model takes its part."""
        return self.signals.T @ self.signals

    @cached_property
    def _alone(self) -> tuple[np.ndarray, np.ndarray]:
        return self.response.T @ self.response, self.response.T @ self.z

    def reduced(self, own: OwnCauses) -> Reduced:
        """The unit given its causes, which are counted first."""
        gram, towards = self._alone
        if not own.members:
            return Reduced(own.log_prior - 0.5 * float(self.z @ self.z), gram, towards)
        base = Search(self.pool, self.z, True).base(own.members)
        along = base.q.T @ base.z
        evidence = log_evidence(np.array(base.z @ base.z), base.explained(along), self.pool.dof, True)
        taken = base.q.T @ self.response
        offset = self.response.T @ (base.z - self.z)
        return Reduced(own.log_prior + float(evidence), gram - taken.T @ taken, towards + offset - taken.T @ along)

    @cached_property
    def apart(self) -> "Unit":
        """The same unit without information on shared errors."""
        return replace(self, signals=np.zeros_like(self.signals))

    def own_causes(self, z: Float[np.ndarray, " nu"]) -> OwnCauses:
        """The best set of causes of the unit for the residual of the shared ones. A residual close to an earlier one is not
        searched again."""
        for searched, own in self._searched:
            if np.linalg.norm(z - searched) < _SAME:
                return own
        own = self._own_causes(z)
        self._searched.append((z, own))
        return own

    def _own_causes(self, z: Float[np.ndarray, " nu"]) -> OwnCauses:
        if float(statistics(self.pool, None, z[None], True)[0]) < _NOT_EVEN:
            return NOTHING
        search = Search(self.pool, z, True)
        members = search.run().set_at(0)
        base = search.base(members)
        as_fitted = log_evidence(np.array(base.z @ base.z), base.explained(base.q.T @ base.z), self.pool.dof, True)
        return OwnCauses(members, search.posterior(members) - float(as_fitted))

    def faults_of(self, own: OwnCauses) -> OwnCauses:
        """Those causes of the unit that are faults of single positions, which cannot be shared."""
        members = tuple(k for k in own.members if self.pool.causes[k].positions)
        return own if members == own.members else OwnCauses(members, own.log_prior if members else NOTHING.log_prior)


def unit_of(start: Linearised, signals: Sequence[SharedSignal]) -> Unit:
    """A unit by the shared signals."""
    at, pool, sigma = start
    width = signals[-1].columns[-1] + 1 if signals else 0
    rows = np.zeros((len(at.residual), width))
    slots, turned = slots_of(at.model), at.evaluation.jacobian[:, :, at.model.probe.start]
    terms = {cause.words: cause.terms[0] for cause in _generic(pool)}
    terms |= {words: at.problem.rows(turned * here[:, None]) for words, here in _holes(at).items()}
    for signal in signals:
        if signal.words in terms:
            rows[: len(terms[signal.words]), signal.columns[0]] = terms[signal.words] * _TERM_SCALE
        elif (slot := signal.slot_in(slots)) is not None:
            columns = slot.columns
            rows[:, list(signal.columns)] = at.jacobian[:, list(columns)]
    return Unit(at, pool.in_units_of(sigma), sigma, rows / sigma)
