"""The measured head: joint fit of the shared errors with the parameters and causes of every unit.

In every unit its own unknowns (nominal parameters, causes, deviations) are eliminated; the sum over the units determines the
shared ones. The fit is linear: of large signals the units are linearised again at its solution (`joint`). Pitch errors are
shared only where they agree (`amounts`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from tumblecal.chain.head_file import MeasuredHead, pitch_names
from tumblecal.chain.nominal import PITCH_ERROR
from tumblecal.diagnosis.priors import UNITS_FOR_EACH_EXCLUDED
from tumblecal.diagnosis.units.amounts import PitchSettings, pitch_settings
from tumblecal.diagnosis.units.batch import Batch, SharedSignal, Unit, UnitCauses, slots_of
from tumblecal.diagnosis.units.hypotheses import RandomEffect
from tumblecal.diagnosis.units.mixed_model import NormalEquations, chi2_p_value, explained, pseudo_inverse, rounding_of
from tumblecal.diagnosis.units.search import SharedExplanation
from tumblecal.full_model.tangent import tangent


# Pitch errors are counted in this size (rad), as the coefficients are in theirs.
_PITCH_SCALE = 1e-4
# Directions of a unit's unknowns below this share of the largest contain only rounding errors.
_PRIVATE_ROUNDING = 1e-10
# A combination of an effect's coefficients that no unit shows is kept at zero to within this share of its scale.
_KEPT = 1e-3
# Information that is less than this share of that of all units is rounding.
_NO_INFORMATION = 1e-6
# Steps between the values of a factor of covariances, so that units of one plan share quantities that the plan determines.
_COARSE = 1.25


def most_excluded(units: int) -> int:
    """How many units may be excluded from the results of the head: fewer than a third, so that the rest outvotes them."""
    return (units - 1) // UNITS_FOR_EACH_EXCLUDED


@dataclass(frozen=True)
class HeadFit:
    """The joint fit.

    - `head`: the measured errors; None if no error is shared.
    - `pitch`: whether the errors of the pitch settings belong to the head; its `alone` by the units' numbers.
    - `vectors`: full vector of every unit. `unit_values`, `unit_sd` (units, coefficients): separate estimate of the shared
      coefficients by every unit, base units; nan if it does not determine one.
    - `directions`: from the estimated values to the errors of the head. `equations`: of every unit for them. `excluded`:
      numbers of the excluded units.
    """

    head: MeasuredHead | None
    pitch: PitchSettings
    vectors: tuple[Float[np.ndarray, " full"], ...]
    unit_values: Float[np.ndarray, "units coefficients"]
    unit_sd: Float[np.ndarray, "units coefficients"]
    directions: Float[np.ndarray, "errors unknowns"]
    equations: NormalEquations
    excluded: frozenset[int]

    @property
    def _others(self) -> NormalEquations:
        """For every unit the sum over the other units that count."""
        gram, towards = self.equations.gram.copy(), self.equations.towards.copy()
        gram[list(self.excluded)], towards[list(self.excluded)] = 0.0, 0.0
        return NormalEquations(np.sum(gram, axis=0) - gram, np.sum(towards, axis=0) - towards)

    @cached_property
    def consistent(self) -> tuple[float, ...]:
        """For each unit the probability that its own estimate of the shared errors deviates so much from the others' by noise
        alone."""
        gram, others = self.equations.gram, self._others
        differences = self.equations.given(others.solved()).towards
        covariance = gram + gram @ pseudo_inverse(others.gram) @ gram
        squares, _ = explained(covariance, differences, rounding_of(covariance))
        dof = explained(gram, differences, rounding_of(gram))[1]
        return tuple(chi2_p_value(squares, dof).tolist())

    def without(self, number: int) -> MeasuredHead | None:
        """The head as measured by the other units, so that the prior of a unit does not contain its own data.

        The values are the others'. Their covariance is that of all units times a factor on a coarse scale: units of one plan
        then share quantities that the plan determines.
        """
        if self.head is None or len(self.vectors) - len(self.excluded) < 2:
            return None
        gram, towards = (part[number] for part in self._others[:2])
        whole = gram + self.equations.gram[number]
        shown = np.diag(gram) > _NO_INFORMATION * np.diag(whole)
        # The others know nothing of a pitch setting of this unit alone.
        kept = ~np.any(self.directions[:, ~shown] != 0, axis=1)
        if number in self.pitch.alone:
            kept &= [not name.startswith(PITCH_ERROR) for name in self.head.names]
        if not np.any(kept):
            return None
        inside, chosen = np.ix_(shown, shown), np.flatnonzero(kept)
        values = self.directions[:, shown] @ np.linalg.solve(gram[inside], towards[shown])
        inverse = np.linalg.inv(np.linalg.cholesky(whole[inside]))
        smallest = float(np.min(np.linalg.eigvalsh(inverse @ gram[inside] @ inverse.T)))
        wider = _COARSE ** np.ceil(-np.log(max(smallest, _NO_INFORMATION)) / np.log(_COARSE) - 0.3)
        return replace(
            self.head,
            names=tuple(self.head.names[k] for k in chosen),
            units=tuple(self.head.units[k] for k in chosen),
            values=values[chosen],
            covariance=self.head.covariance[np.ix_(chosen, chosen)] * wider,
        )


def _unit_fit(
    unit: Unit,
    causes: UnitCauses,
    signals: Sequence[SharedSignal],
    directions: Float[np.ndarray, "coefficients directions"],
    random_effects: Sequence[RandomEffect],
    levels: Sequence[str],
) -> tuple[NormalEquations, Callable[[Float[np.ndarray, " unknowns"]], Float[np.ndarray, " full"]]]:
    """Normal equations of a unit for the shared unknowns, its own parameters and causes eliminated where it is linearised; and
    its full vector by their solution.

    **Arguments:**

    - `causes`: also fitted, or undone.
    - `signals`, `directions`: the shared effects, and the directions of their coefficients (base units) that are fitted.
    - `random_effects`: effects whose amount differs between units. `levels`: names of all units' pitch errors.
    """
    at, model, fitted = unit.at, unit.at.model, [unit.pool.causes[k] for k in causes.members]
    problem, scales = at.problem, model.scales
    for cause in fitted:
        problem = cause.undone(problem)
    if problem is not at.problem:
        at = tangent(model, problem, at.vector)
    shared, count, first = np.zeros((len(scales), directions.shape[1] + len(levels))), directions.shape[1], 0
    for slot, signal in zip(slots_of(model, signals), signals, strict=True):
        last = first + len(signal.scales)
        # An effect that cannot act here changes nothing.
        if slot is not None:
            shared[list(slot.columns), :count] += directions[first:last]
        first = last
    names = levels_of(unit)
    pitch = [model.names.index(f"dbeta_{k}") for k in range(len(names))]
    shared[pitch, [count + levels.index(name) for name in names]] = _PITCH_SCALE
    # Its own unknowns (scaled): nominal parameters, coefficients of its causes, deviations; and the known precision of each.
    private = [k for k in range(model.nominal) if k not in pitch]
    blocks = [np.eye(len(scales))[:, private]]
    for cause in fitted:
        if cause.directions is not None:
            blocks.append(np.eye(len(scales))[:, list(cause.slot.columns)] @ cause.directions)
    precisions = [np.zeros(block.shape[1]) for block in blocks]
    slots = slots_of(model, [effect.signal for effect in random_effects])
    for slot, effect in zip(slots, random_effects, strict=True):
        if slot is not None:
            blocks.append(np.eye(len(scales))[:, list(slot.columns)])
            precisions.append(np.full(len(slot.columns), 1.0 / effect.tau))
    moves, prior = np.hstack(blocks), np.concatenate(precisions)
    weights = np.full(len(at.residual), 1.0 / unit.sigma)
    weights[: problem.readings.size] *= np.repeat(problem.takes_part, 3)
    jacobian = at.jacobian * weights[:, None]
    terms = [np.pad(term, (0, len(weights) - len(term))) * weights for cause in fitted for term in cause.terms]
    design, rows = np.column_stack([jacobian @ moves, *terms]), jacobian @ (shared / scales[:, None])
    # What is known of the deviations counts as readings of them.
    known = np.pad(np.diag(prior), ((0, 0), (0, len(terms))))[prior > 0]
    inverse = np.linalg.pinv(np.vstack([design, known]), rcond=_PRIVATE_ROUNDING)[:, : len(rows)]
    start = model.with_nominal(at.vector[: model.nominal])
    residual = at.residual * weights + jacobian[:, pitch] @ (start[pitch] / scales[pitch])
    start[pitch] = 0.0
    reduced = rows - design @ (inverse @ rows)

    def vector(solution: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " full"]:
        private = (inverse @ (residual - rows @ solution))[: moves.shape[1]]
        return start + shared @ solution + scales * (moves @ private)

    return NormalEquations(reduced.T @ rows, reduced.T @ residual), vector


def levels_of(unit: Unit) -> tuple[str, ...]:
    """Names of a unit's pitch errors; none where they are not free, or not one for each setting."""
    leaves = [leaf for leaf in unit.at.model.nominal_chain.free if leaf.name == "dbeta" and leaf.by == "pitch"]
    return pitch_names(leaves[0], unit.at.problem.where) if leaves else ()


def head_fit(
    batch: Batch, best: SharedExplanation, sources: Sequence[str], excluded: frozenset[int] = frozenset()
) -> HeadFit:
    """Fit the shared errors of one explanation, with the parameters and causes of each unit.

    **Arguments:**

    - `sources`: the units' files, for the record.
    - `excluded`: numbers of units whose separate estimates are reported nevertheless.
    """
    hypothesis, random_effects = best.hypothesis, best.hypothesis.random_effects
    # Each effect with orthonormal combinations of its scaled coefficients; means of the units' amounts are nothing of the head.
    axes = [hypothesis.search.pool.causes[k].directions for k in best.shared.members]
    pairs = zip(best.signals, axes, strict=True)
    shown = [(signal, np.linalg.qr(axes)[0]) for signal, axes in pairs if axes is not None]
    means = [effect.signal for effect in random_effects if effect.with_mean]
    fitted = [*shown, *((signal, hypothesis.mean_directions(signal)) for signal in means)]
    blocks = [axes * np.array(signal.scales)[:, None] for signal, axes in fitted]
    directions, signals = np.asarray(block_diag(np.zeros((0, 0)), *blocks)), [signal for signal, _ in shown]
    levels = sorted(
        {name for unit in batch.units for name in levels_of(unit)}, key=lambda name: float(name.partition("@")[2])
    )
    fits = []
    for number, (unit, causes) in enumerate(zip(batch.units, hypothesis.unit_causes, strict=True)):
        causes = unit.without_head(causes) if number in excluded else causes
        fits.append(_unit_fit(unit, causes, [*signals, *means], directions, random_effects, levels))
    counted = np.array([number not in excluded for number in range(len(fits))])
    of_shared, of_pitch = np.split(np.arange(directions.shape[1] + len(levels)), [directions.shape[1]])
    equations = NormalEquations.stacked([fit for fit, _ in fits])
    separate = equations.eliminated(of_pitch)
    common, solution = separate.of(of_shared).only(counted).total, np.zeros(equations.towards.shape)
    solution[:, of_shared] = np.linalg.solve(common.gram, common.towards)
    pitch_errors = equations.given(solution).of(of_pitch)
    solution[:, of_pitch] = pitch_errors.solved()
    pitch = pitch_settings(pitch_errors, counted, most_excluded(len(fits)) - len(excluded))
    seen = np.flatnonzero(pitch.seen) if pitch.common else np.zeros(0, int)
    # Of the settings of a unit with other pitch errors nothing is known.
    kept = [*of_shared, *of_pitch[seen]]
    alone = [*pitch.alone, *excluded] if pitch.common else [*range(len(fits))]
    joint = equations.of(kept)
    for whole, part in zip(joint[:2], separate.of(kept)[:2], strict=True):
        whole[alone] = part[alone]
    directions = directions[: sum(len(signal.scales) for signal in signals)]
    unit_values, unit_sd = _separate(separate.of(of_shared), directions)
    names = [*(name for signal in signals for name in signal.slot.names), *(levels[k] for k in seen)]
    bases = [*(base for signal in signals for base in signal.slot.units), *["rad"] * len(seen)]
    directions, head = np.asarray(block_diag(directions, _PITCH_SCALE * np.eye(len(seen)))), None
    if names:
        total = joint.only(counted).total
        covariance = directions @ np.linalg.inv(total.gram) @ directions.T
        hidden = [
            (np.eye(len(axes)) - axes @ axes.T) * np.outer(signal.scales, signal.scales) for signal, axes in shown
        ]
        covariance = covariance + _KEPT**2 * np.asarray(block_diag(*hidden, np.zeros((len(seen), len(seen)))))
        # head.toml is refused where rounding makes a covariance asymmetric.
        covariance = 0.5 * (covariance + covariance.T)
        head = MeasuredHead(
            tuple(signal.label for signal in signals),
            tuple(names),
            tuple(bases),
            directions @ np.linalg.solve(total.gram, total.towards),
            covariance,
            tuple(source for source, counts in zip(sources, counted.tolist(), strict=True) if counts),
        )
    vectors = tuple(vector(each) for (_, vector), each in zip(fits, solution, strict=True))
    return HeadFit(head, pitch, vectors, unit_values, unit_sd, directions, joint, excluded)


def _separate(
    equations: NormalEquations, directions: Float[np.ndarray, "coefficients directions"]
) -> tuple[Float[np.ndarray, "units coefficients"], Float[np.ndarray, "units coefficients"]]:
    """Estimate of the shared coefficients by every unit alone, and their sd, base units; nan where it shows nothing of one."""
    covariance = pseudo_inverse(equations.gram)
    values = np.matvec(directions, np.matvec(covariance, equations.towards))
    sd = np.sqrt(np.vecdot(directions @ covariance, directions))
    return np.where(sd > 0, values, np.nan), np.where(sd > 0, sd, np.nan)
