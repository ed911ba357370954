"""The measured head: joint fit of the shared errors with the parameters and causes of every unit.

In every unit its own unknowns (nominal parameters, causes, deviations) are eliminated; the sum over the units determines the
shared ones. Pitch errors are shared only where they agree (`amounts`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag, eigh

from tumblecal.chain.head_file import MeasuredHead
from tumblecal.chain.nominal import PITCH_ERROR
from tumblecal.diagnosis.priors import UNITS_FOR_EACH_EXCLUDED
from tumblecal.diagnosis.units.amounts import PitchSettings, pitch_settings
from tumblecal.diagnosis.units.hypotheses import embedded
from tumblecal.diagnosis.units.mixed_model import NormalEquations, chi2_p_value, explained, pseudo_inverse, rounding_of
from tumblecal.diagnosis.units.search import SharedExplanation
from tumblecal.diagnosis.units.unit import TERM_SCALE, Batch


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
    - `unit_values`, `unit_sd` (units, coefficients): separate estimate of the shared coefficients by every unit, base units;
      nan if it does not determine one.
    - `directions`: from the estimated values to the errors of the head. `equations`: of every unit for them. `excluded`:
      numbers of the excluded units.
    """

    head: MeasuredHead | None
    pitch: PitchSettings
    unit_values: Float[np.ndarray, "units coefficients"]
    unit_sd: Float[np.ndarray, "units coefficients"]
    directions: Float[np.ndarray, "errors unknowns"]
    equations: NormalEquations
    excluded: frozenset[int]

    @property
    def _others(self) -> NormalEquations:
        """For every unit the sum over the other units that count."""
        gram, towards, _ = self.equations
        counts = np.array([number not in self.excluded for number in range(len(gram))], float)
        others = counts - np.diag(counts)
        return NormalEquations(np.tensordot(others, gram, 1), others @ towards, np.zeros(len(gram)))

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
        if self.head is None or len(self.unit_sd) - len(self.excluded) < 2:
            return None
        others = self._others.only(np.array(number))
        whole = others.gram + self.equations.gram[number]
        shown = np.flatnonzero(np.diag(others.gram) > _NO_INFORMATION * np.diag(whole))
        # The others know nothing of a pitch setting of this unit alone.
        kept = ~np.any(np.delete(self.directions, shown, axis=1) != 0, axis=1)
        if number in self.pitch.alone:
            kept &= [not name.startswith(PITCH_ERROR) for name in self.head.names]
        if not np.any(kept):
            return None
        chosen, others = np.flatnonzero(kept), others.of(shown)
        smallest = float(eigh(others.gram, whole[np.ix_(shown, shown)], eigvals_only=True)[0])
        wider = _COARSE ** np.ceil(-np.log(max(smallest, _NO_INFORMATION)) / np.log(_COARSE) - 0.3)
        return replace(
            self.head,
            names=tuple(self.head.names[k] for k in chosen),
            units=tuple(self.head.units[k] for k in chosen),
            values=self.directions[np.ix_(chosen, shown)] @ others.solved(),
            covariance=self.head.covariance[np.ix_(chosen, chosen)] * wider,
        )


def head_fit(
    batch: Batch, best: SharedExplanation, sources: Sequence[str], excluded: frozenset[int] = frozenset()
) -> HeadFit:
    """Fit the shared errors of one explanation, with the parameters and causes of each unit.

    **Arguments:**

    - `sources`: the units' files, for the record.
    - `excluded`: numbers of units whose separate estimates are reported nevertheless.
    """
    hypothesis, width = best.hypothesis, len(best.hypothesis.total.towards)
    shown = [(signal, axes) for signal, axes in hypothesis.axes(best.shared.members) if signal.is_effect]
    settings = {name for unit in batch.units for name in unit.levels}
    levels = sorted(settings, key=lambda name: float(name.partition("@")[2]))
    pairs = enumerate(zip(batch.units, hypothesis.unit_causes, strict=True))
    causes = ((unit, unit.without_head(own) if number in excluded else own) for number, (unit, own) in pairs)
    equations = NormalEquations.stacked([unit.with_pitch(own, levels) for unit, own in causes])
    for effect in hypothesis.random_effects:
        equations = equations.marginal(*effect.law)
    # Means of the units' amounts are fitted too, but are nothing of the head.
    axes = np.asarray(block_diag(embedded([*shown, *hypothesis.means], width), np.eye(len(levels))))
    equations, count = equations.along(axes), axes.shape[1] - len(levels)
    counted = np.array([number not in excluded for number in range(len(batch.units))])
    of_shared, of_pitch = np.split(np.arange(axes.shape[1]), [count])
    separate = equations.eliminated(of_pitch)
    common, solution = separate.of(of_shared).only(counted).total, np.zeros(axes.shape[1])
    solution[of_shared] = np.linalg.solve(common.gram, common.towards)
    most_alone = most_excluded(len(counted)) - len(excluded)
    pitch = pitch_settings(equations.given(solution).of(of_pitch), counted, most_alone)
    # Of the settings of a unit with other pitch errors nothing is known.
    seen = np.flatnonzero(pitch.seen) if pitch.common else np.zeros(0, int)
    kept, alone = [*of_shared, *of_pitch[seen]], [*pitch.alone, *excluded] if pitch.common else [*range(len(counted))]
    joint, own = equations.of(kept), separate.of(kept)
    joint.gram[alone], joint.towards[alone] = own.gram[alone], own.towards[alone]
    scales = np.concatenate([np.zeros(0), *(signal.scales for signal, _ in shown)])
    to_head = scales[:, None] * np.asarray(block_diag(np.zeros((0, 0)), *(axes for _, axes in shown)))
    to_head = np.pad(to_head, ((0, 0), (0, count - to_head.shape[1])))
    names = [*(name for signal, _ in shown for name in signal.slot.names), *(levels[k] for k in seen)]
    bases = [*(base for signal, _ in shown for base in signal.slot.units), *["rad"] * len(seen)]
    directions, head = np.asarray(block_diag(to_head, TERM_SCALE * np.eye(len(seen)))), None
    if names:
        total = joint.only(counted).total
        hidden = [(np.eye(len(q)) - q @ q.T) * np.outer(signal.scales, signal.scales) for signal, q in shown]
        covariance = directions @ np.linalg.inv(total.gram) @ directions.T
        covariance += _KEPT**2 * np.asarray(block_diag(*hidden, np.zeros((len(seen), len(seen)))))
        head = MeasuredHead(
            tuple(signal.label for signal, _ in shown),
            tuple(names),
            tuple(bases),
            directions @ np.linalg.solve(total.gram, total.towards),
            # head.toml is refused where rounding makes a covariance asymmetric.
            0.5 * (covariance + covariance.T),
            tuple(source for source, counts in zip(sources, counted.tolist(), strict=True) if counts),
        )
    # The estimate of the shared coefficients by every unit alone; nan where it shows nothing of one.
    covariances = pseudo_inverse(separate.of(of_shared).gram)
    values = np.matvec(to_head @ covariances, separate.of(of_shared).towards)
    sd = np.sqrt(np.vecdot(to_head @ covariances, to_head))
    values, sd = (np.where(sd > 0, part, np.nan) for part in (values, sd))
    return HeadFit(head, pitch, values, sd, directions, joint, excluded)
