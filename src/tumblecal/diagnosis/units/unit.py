"""One unit where it is linearised: residual, the signals that it may share with others, and its own causes; and a batch of units."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_file import pitch_names
from tumblecal.diagnosis.causes.cause import NO_SLOT, Cause
from tumblecal.diagnosis.causes.generic import GENERIC, HEAD_ANGLES, UNEXPLAINED
from tumblecal.diagnosis.causes.pool import Pool, pooled
from tumblecal.diagnosis.detection.detect import statistics
from tumblecal.diagnosis.priors import SAME_RESIDUAL, UNIT_SEARCHED
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import Members
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.units.mixed_model import NormalEquations
from tumblecal.effects.effect import of_head
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.tangent import Tangent, tangent


# Generic terms and pitch errors are counted in this size, g or rad.
TERM_SCALE = 1e-4
# Directions of a unit's own unknowns below this share of the largest contain only rounding errors.
_PRIVATE_ROUNDING = 1e-10


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
    def is_effect(self) -> bool:
        """Whether the catalogue describes it."""
        return bool(self.slot.columns)

    @property
    def names_and_units(self) -> list[tuple[str, str]]:
        """Of its coefficients, in the order of `columns`; a time constant is none."""
        whole = zip(self.slot.all_columns, self.slot.names, self.slot.units, strict=True)
        return [(name, unit) for column, name, unit in whole if column in self.slot.columns]

    @property
    def key(self) -> tuple[object, ...]:
        """Independent of the plan; it also distinguishes signals of one cause with different time constants."""
        return (self.label, self.words, self.slot.names, self.slot.variant)


@dataclass(frozen=True, eq=False)
class Unit:
    """One unit where it is linearised.

    - `at`: its problem; `sigma`: its noise in units of the white rows; `pool`: its causes, for residuals in units of that.
    - `rows`: white rows of the signals of a batch, zero if the unit lacks a required column; `places`: their columns in the
      full vector, -1 for none.
    """

    at: Tangent
    pool: Pool
    sigma: float
    rows: Float[np.ndarray, "rows columns"] = field(default_factory=lambda: np.zeros((0, 0)))
    places: Int[np.ndarray, " columns"] = field(default_factory=lambda: np.zeros(0, int))
    _searched: list[tuple[Float[np.ndarray, " nu"], Members]] = field(default_factory=list)

    @classmethod
    def of(cls, at: Tangent, sigma: float, generic: tuple[int, ...], visible: frozenset[str] | None = None) -> "Unit":
        """With the causes of `causes.pool.pooled`."""
        return cls(at, pooled(at, sigma, generic, visible).in_units_of(sigma), sigma)

    @cached_property
    def signals(self) -> list[tuple[SharedSignal, Float[np.ndarray, "rows coefficients"], bool]]:
        """The signals that it may have in common with others, their white rows, and whether its residuals can show them.

        A sensor effect with a time constant is one signal for each time constant that is tried first: all units may have it,
        each with a different amount. An effect of the head with a time constant is never shared.
        """
        at, signals = self.at, []
        for seen in self.pool.seen:
            on_head, columns = of_head(seen.slot.links), list(seen.slot.columns)
            if not (seen.slot.shape and on_head):
                signal = SharedSignal(seen.slot.id, "", seen.slot, on_head, tuple(at.model.scales[columns].tolist()))
                signals.append((signal, at.jacobian[:, columns], seen.block.shape[1] > 0))
        generic = self.pool.numbers_of(GENERIC)
        causes = [self.pool.causes[k] for k in generic[self.pool.ranks[generic] == 1].tolist()]
        for words, term in ({cause.words: cause.terms[0] for cause in causes} | self._index_errors).items():
            # An error of one output belongs to its sensor: only rotations of the head can be common to all units.
            if not words.startswith("output "):
                rows = np.pad(term * TERM_SCALE, (0, len(at.residual) - len(term)))
                signals.append((SharedSignal(UNEXPLAINED, words, NO_SLOT, True, (TERM_SCALE,)), rows[:, None], True))
        return signals

    @property
    def _index_errors(self) -> dict[str, Float[np.ndarray, " rows"]]:
        """White rows of an error of the index at each angle that was measured more than once, at any pitch."""
        if self.at.model.hand_held:
            return {}
        turned = self.at.evaluation.jacobian[:, :, self.at.model.probe.start]
        alpha = np.round(np.degrees(np.asarray(self.at.problem.where.alpha)) % 360.0, 3) % 360.0
        angles, counts = np.unique(alpha, return_counts=True)
        return {
            f"{HEAD_ANGLES[0]}: at {angle:g} deg alone": self.at.problem.rows(turned * (alpha == angle)[:, None])
            for angle in angles[counts > 1].tolist()
        }

    @cached_property
    def z(self) -> Float[np.ndarray, " nu"]:
        """Residual of the nominal model, in units of the noise."""
        return self.at.z / self.sigma

    @cached_property
    def response(self) -> Float[np.ndarray, "nu columns"]:
        """The signals of the batch in the residual space, in units of the noise."""
        return self.at.basis.T @ self.rows / self.sigma

    @cached_property
    def levels(self) -> tuple[str, ...]:
        """Names of its pitch errors; none where they are not free, or not one for each setting."""
        leaves = [leaf for leaf in self.at.model.nominal_chain.free if leaf.name == "dbeta" and leaf.by == "pitch"]
        return pitch_names(leaves[0], self.at.problem.where) if leaves else ()

    @cached_property
    def _search(self) -> Search:
        return Search(self.pool, self.z, True)

    def equations(self, causes: Members) -> NormalEquations:
        """Of the shared signals, given causes of the unit (their numbers in its pool)."""
        base = self._search.base(causes)
        along, across = base.q.T @ base.z, base.q.T @ self.response
        gram, towards = self.response.T @ self.response, self.response.T @ base.z
        return NormalEquations(gram - across.T @ across, towards - across.T @ along, self._search.posterior(causes))

    def causes_of(self, z: Float[np.ndarray, " nu"]) -> Members:
        """The best set of causes of the unit for the residual of the shared ones. A residual close to an earlier one is not
        searched again."""
        for searched, causes in self._searched:
            if np.linalg.norm(z - searched) < SAME_RESIDUAL:
                return causes
        hopeful = float(statistics(self.pool, None, z[None], True)[0]) >= UNIT_SEARCHED
        self._searched.append((z, Search(self.pool, z, True).run().set_at(0) if hopeful else ()))
        return self._searched[-1][1]

    def only(self, causes: Members, wanted: Callable[[Cause], bool]) -> Members:
        """Some of the causes of the unit."""
        return tuple(k for k in causes if wanted(self.pool.causes[k]))

    def without_head(self, causes: Members) -> Members:
        """The causes of the unit that are no errors of the head."""
        return self.only(causes, lambda cause: not (cause.slot.columns and of_head(cause.slot.links)))

    def with_pitch(self, causes: Members, levels: Sequence[str]) -> "UnitFit":
        """The shared effects, and the errors of the pitch settings of these names, with causes of the unit fitted or undone."""
        at, model, fitted = self.at, self.at.model, [self.pool.causes[k] for k in causes]
        problem = reduce(lambda problem, cause: cause.undone(problem), fitted, at.problem)
        if problem is not at.problem:
            at = tangent(model, problem, at.vector)
        weights = np.full(len(at.residual), 1.0 / self.sigma)
        weights[: problem.readings.size] *= np.repeat(problem.takes_part, 3)
        pitch = [model.names.index(f"dbeta_{k}") for k in range(len(self.levels))]
        # Its own unknowns, scaled: nominal parameters without pitch errors, and the coefficients of its causes.
        each = np.eye(len(model.scales))
        moves = [each[:, [k for k in range(model.nominal) if k not in pitch]]]
        moves += [each[:, list(cause.slot.columns)] @ cause.directions for cause in fitted if cause.directions is not None]
        own, terms = np.hstack(moves), [term for cause in fitted for term in cause.terms]
        # The shared unknowns: signals of the batch, then pitch errors.
        shared, here = np.zeros((len(each), len(self.places) + len(levels))), np.flatnonzero(self.places >= 0)
        shared[self.places[here], here] = 1.0
        of_pitch = [len(self.places) + levels.index(name) for name in self.levels]
        shared[pitch, of_pitch] = TERM_SCALE / model.scales[pitch]
        start = model.with_nominal(at.vector[: model.nominal])
        residual = at.residual + at.jacobian[:, pitch] @ (start[pitch] / model.scales[pitch])
        start[pitch] = 0.0
        private = np.column_stack([at.jacobian @ own, *(np.pad(term, (0, len(weights) - len(term))) for term in terms)])
        rows = (part * weights[:, None] for part in (at.jacobian @ shared, private))
        return UnitFit(start, *(model.scales[:, None] * part for part in (shared, own)), *rows, residual * weights)


class UnitFit(NamedTuple):
    """A unit with its own unknowns.

    - `start`, `shared`, `own`: full vector without, and its changes by the shared and by the own unknowns.
    - `rows`, `private`, `residual`: white rows of the shared and of the own unknowns, and of the residual.
    """

    start: Float[np.ndarray, " full"]
    shared: Float[np.ndarray, "full unknowns"]
    own: Float[np.ndarray, "full private"]
    rows: Float[np.ndarray, "rows unknowns"]
    private: Float[np.ndarray, "rows private"]
    residual: Float[np.ndarray, " rows"]

    @property
    def equations(self) -> NormalEquations:
        """Of the shared unknowns, the own ones eliminated."""
        reduced = self.rows - self.private @ (self._inverse @ self.rows)
        return NormalEquations(reduced.T @ self.rows, reduced.T @ self.residual)

    @property
    def _inverse(self) -> Float[np.ndarray, "private rows"]:
        return np.linalg.pinv(self.private, rcond=_PRIVATE_ROUNDING)

    def vector(self, solution: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " full"]:
        """The full vector by the shared unknowns."""
        own = self._inverse @ (self.residual - self.rows @ solution)
        return self.start + self.shared @ solution + self.own @ own[: self.own.shape[1]]


def linearised(screened: Screened) -> Unit:
    """A unit as it was screened; where an effect with a time constant leads, with the time constant that fits.

    The joint model is linear: of a strong warm-up a time constant that is only near leaves more than many an error of the head.
    """
    known = screened.problem.known
    timed = [cause.slot for cause in screened.members if cause.slot.shape]
    fit = screened.fit or fit_with(screened.at, screened.members) if timed or screened.large else None
    if fit is None or not fit.code.good:
        # Not the leading set's noise where nothing was detected: the best of hundreds of causes takes a tenth of it.
        sigma = 1.0 if known else screened.search.sigma(screened.best.members)
        return Unit(screened.at, screened.pool.in_units_of(sigma), sigma)
    model = screened.at.model.with_time_constants({slot.id: fit.vector[list(slot.shape)] for slot in timed})
    vector = fit.vector.copy() if screened.large else screened.at.vector.copy()
    vector[model.layout.shapes] = model.start[model.layout.shapes]
    sigma = 1.0 if known else float(np.sqrt(fit.chi2 / fit.dof))
    return Unit.of(tangent(model, screened.problem, vector), sigma, screened.pool.generic, screened.pool.visible)


@dataclass(frozen=True)
class Batch:
    """Units with the signals that they may share, their columns numbered."""

    units: tuple[Unit, ...]
    signals: tuple[SharedSignal, ...]

    @classmethod
    def of(cls, units: Sequence[Unit], signals: tuple[SharedSignal, ...]) -> "Batch":
        """The units by these signals."""
        columns: Mapping[tuple, list[int]] = {signal.key: list(signal.columns) for signal in signals}
        width, with_rows = sum(len(signal.scales) for signal in signals), []
        for unit in units:
            rows, places = np.zeros((len(unit.at.residual), width)), np.full(width, -1)
            for signal, block, _ in unit.signals:
                if signal.key in columns:
                    rows[:, columns[signal.key]] = block
                    places[columns[signal.key]] = signal.slot.columns or -1
            with_rows.append(replace(unit, rows=rows, places=places))
        return cls(tuple(with_rows), signals)

    def excluding(self, numbers: Collection[int]) -> "Batch":
        """The same where some of the units have no information on shared signals."""
        units = enumerate(self.units)
        none = (replace(unit, rows=np.zeros_like(unit.rows)) if number in numbers else unit for number, unit in units)
        return Batch(tuple(none), self.signals)

    def equations(self, causes: Sequence[Members]) -> NormalEquations:
        """Of the shared signals for every unit, given causes of each."""
        return NormalEquations.stacked([unit.equations(own) for unit, own in zip(self.units, causes, strict=True)])

    @cached_property
    def squares(self) -> Float[np.ndarray, "columns columns"]:
        """Gram matrix of the shared signals before the nominal model takes its part, in units of the noise."""
        return np.sum([unit.rows.T @ unit.rows / unit.sigma**2 for unit in self.units], axis=0)

    @property
    def noise_known(self) -> bool:
        """Whether the noise of every unit is stated."""
        return all(unit.at.problem.known for unit in self.units)


def shared_signals(units: Sequence[Unit], impossible: frozenset[str] = frozenset()) -> tuple[SharedSignal, ...]:
    """The signals that at least two units can show, with consecutive column numbers, without the effects of some ids."""
    signals: dict[tuple, list[SharedSignal]] = {}
    for signal in (signal for unit in units for signal, _, visible in unit.signals if visible):
        signals.setdefault(signal.key, []).append(signal)
    numbered, first = [], 0
    for signal, *others in signals.values():
        if others and signal.label not in impossible:
            numbered.append(signal._replace(columns=tuple(range(first, first + len(signal.scales)))))
            first += len(signal.scales)
    return tuple(numbered)
