"""A unit where it is linearised: residual, signals that it may share with others, and its own causes; a batch of units."""

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_file import pitch_names
from tumblecal.diagnosis.causes.cause import GENERIC, NO_SLOT, UNEXPLAINED, Cause
from tumblecal.diagnosis.causes.pool import Pool, pooled
from tumblecal.diagnosis.causes.terms import HEAD_ANGLES
from tumblecal.diagnosis.detection.detect import statistics
from tumblecal.diagnosis.priors import SAME_RESIDUAL, UNIT_SEARCHED
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.cause_sets import Members
from tumblecal.diagnosis.sets.search import Search
from tumblecal.diagnosis.units.mixed_model import NormalEquations
from tumblecal.effects.effect import of_head
from tumblecal.full_model.layout import Slot
from tumblecal.full_model.tangent import Tangent, tangent, unreachable


# Generic terms and pitch errors are counted in this size, g or rad.
TERM_SCALE = 1e-4


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
    - `rows`: white rows of the signals of a batch; zero if the unit lacks a required column.
    """

    at: Tangent
    pool: Pool
    sigma: float
    rows: Float[np.ndarray, "rows columns"] = field(default_factory=lambda: np.zeros((0, 0)))
    _searched: list[tuple[Float[np.ndarray, " nu"], Members]] = field(default_factory=list)

    @cached_property
    def signals(self) -> list[tuple[SharedSignal, Float[np.ndarray, "rows coefficients"], bool]]:
        """The signals that it may have in common with others, their white rows, and whether its residuals can show them.

        A sensor effect with a time constant is one signal for each time constant that is tried first: all units may have it,
        each with a different amount. An effect of the head with a time constant is never shared.
        """
        at, signals = self.at, []
        for seen in self.pool.seen_effects or ():
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

    def with_pitch(self, causes: Members, levels: Sequence[str]) -> NormalEquations:
        """Of the shared signals, then the errors of the pitch settings of these names, with causes of the unit fitted or
        undone."""
        at, fitted = self.at, [self.pool.causes[k] for k in causes]
        problem = reduce(lambda problem, cause: cause.undone(problem), fitted, at.problem)
        if problem is not at.problem:
            at = tangent(at.model, problem, at.vector)
        weights = np.full((len(at.residual), 1), 1.0 / self.sigma)
        weights[: problem.readings.size, 0] *= np.repeat(problem.takes_part, 3)
        pitch = [at.model.names.index(f"dbeta_{k}") for k in range(len(self.levels))]
        rows = np.hstack([self.rows, np.zeros((len(weights), len(levels) + 1))])
        of_pitch = [self.rows.shape[1] + levels.index(name) for name in self.levels]
        rows[:, of_pitch] = at.jacobian[:, pitch] * (TERM_SCALE / at.model.scales[pitch])
        rows[:, -1] = at.residual + at.jacobian[:, pitch] @ (at.vector[pitch] / at.model.scales[pitch])
        # Its own unknowns: nominal parameters without pitch errors, and the coefficients of its causes.
        own = [at.jacobian[:, [k for k in range(at.model.nominal) if k not in pitch]]]
        own += [at.jacobian[:, list(cause.slot.columns)] @ cause.directions for cause in fitted if cause.slot.columns]
        own += [np.pad(term, (0, len(weights) - len(term)))[:, None] for cause in fitted for term in cause.terms]
        left = unreachable(np.hstack(own) * weights)[0].T @ (rows * weights)
        return NormalEquations(left[:, :-1].T @ left[:, :-1], left[:, :-1].T @ left[:, -1], np.zeros(()))


def linearised(screened: Screened) -> Unit:
    """A unit as it was screened, around its exact fit where its errors are large, with the time constants that fit.

    The joint model is linear: of a strong warm-up a time constant that is only near leaves more than many an error of the head.
    """
    at, pool, known = screened.at, screened.pool, screened.problem.known
    timed = [cause.slot for cause in screened.members if cause.slot.shape]
    fit = screened.fit or fit_with(at, screened.members) if timed or screened.large else None
    # Not the leading set's noise where nothing was detected: the best of hundreds of causes takes a tenth of it.
    sigma = 1.0 if known else screened.search.sigma(screened.best.members)
    if fit is not None and fit.code.good:
        model = at.model.with_time_constants({slot.id: fit.vector[list(slot.shape)] for slot in timed})
        vector = fit.vector.copy() if screened.large else at.vector.copy()
        vector[model.layout.shapes] = model.start[model.layout.shapes]
        sigma, at = 1.0 if known else float(np.sqrt(fit.chi2 / fit.dof)), tangent(model, screened.problem, vector)
        pool = pooled(at, sigma, pool.generic, pool.visible)
    return Unit(at, pool.in_units_of(sigma), sigma)


@dataclass(frozen=True)
class Batch:
    """Units with the signals that they may share, their columns numbered."""

    units: tuple[Unit, ...]
    signals: tuple[SharedSignal, ...]

    @classmethod
    def of(cls, units: Sequence[Unit], impossible: frozenset[str] = frozenset()) -> "Batch":
        """The units by the signals that at least two of them can show, without the effects of some ids."""
        visible = [
            signal for unit in units for signal, _, shown in unit.signals if shown and signal.label not in impossible
        ]
        counts, signals, width = Counter(signal.key for signal in visible), dict[tuple, SharedSignal](), 0
        for signal in visible:
            if counts[signal.key] > 1 and signal.key not in signals:
                last = width + len(signal.scales)
                signals[signal.key] = signal._replace(columns=tuple(range(width, last)))
                width = last
        with_rows = []
        for unit in units:
            rows = np.zeros((len(unit.at.residual), width))
            for signal, block, _ in unit.signals:
                if signal.key in signals:
                    rows[:, list(signals[signal.key].columns)] = block
            with_rows.append(replace(unit, rows=rows))
        return cls(tuple(with_rows), tuple(signals.values()))

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
