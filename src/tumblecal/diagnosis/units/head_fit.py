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
    shared_axes = embedded([*shown, *hypothesis.means], width)
    equations, count = equations.along(np.asarray(block_diag(shared_axes, np.eye(len(levels))))), shared_axes.shape[1]
    of_pitch, counted = range(count, count + len(levels)), np.isin(range(len(batch.units)), [*excluded], invert=True)
    separate = equations.eliminated(of_pitch)
    own = separate.of(range(count))
    common = own.only(counted).total
    solution = np.pad(np.linalg.solve(common.gram, common.towards), (0, len(levels)))
    most_alone = most_excluded(len(counted)) - len(excluded)
    pitch = pitch_settings(equations.given(solution).of(of_pitch), counted, most_alone)
    # Of the settings of a unit with other pitch errors nothing is known.
    seen = np.flatnonzero(pitch.seen) if pitch.common else np.zeros(0, int)
    alone = [*pitch.alone, *excluded] if pitch.common else [*range(len(counted))]
    kept = [*range(count), *(count + seen)]
    joint, of_unit = equations.of(kept), separate.of(kept)
    joint.gram[alone], joint.towards[alone] = of_unit.gram[alone], of_unit.towards[alone]
    # Names, units, directions and covariances of combinations that no unit shows, of each error of the head.
    to_head = np.zeros((sum(len(axes) for _, axes in shown), count))
    to_head[:, : sum(axes.shape[1] for _, axes in shown)] = block_diag(
        np.zeros((0, 0)), *(np.array(signal.scales)[:, None] * axes for signal, axes in shown)
    )
    hidden = [(np.eye(len(q)) - q @ q.T) * np.outer(signal.scales, signal.scales) for signal, q in shown]
    names = [*(name for signal, _ in shown for name in signal.slot.names), *(levels[k] for k in seen)]
    bases = [*(base for signal, _ in shown for base in signal.slot.units), *["rad"] * len(seen)]
    directions, head = np.asarray(block_diag(to_head, TERM_SCALE * np.eye(len(seen)))), None
    if names:
        total = joint.only(counted).total
        covariance = directions @ np.linalg.inv(total.gram) @ directions.T
        covariance += _KEPT**2 * np.asarray(block_diag(np.zeros((0, 0)), *hidden, np.zeros((len(seen), len(seen)))))
        head = MeasuredHead(
            tuple(signal.label for signal, _ in shown),
            tuple(names),
            tuple(bases),
            directions @ np.linalg.solve(total.gram, total.towards),
            # head.toml is refused where rounding makes a covariance asymmetric.
            0.5 * (covariance + covariance.T),
            tuple(np.array(sources, object)[counted].tolist()),
        )
    # The estimate of the shared coefficients by every unit alone; nan where it shows nothing of one.
    covariances = pseudo_inverse(own.gram)
    sd = np.sqrt(np.vecdot(to_head @ covariances, to_head))
    values = np.where(sd > 0, np.matvec(to_head @ covariances, own.towards), np.nan)
    return HeadFit(head, pitch, values, np.where(sd > 0, sd, np.nan), directions, joint, excluded)
