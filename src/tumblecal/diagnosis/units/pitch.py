"""Whether the errors of the pitch settings are the head's: units that measured on one setting of them agree to within noise."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaincc

from tumblecal.diagnosis.units.unit_fit import UnitFit


# Pitch errors are the head's where the units' own estimates scatter no more than their noise does: not less probable.
COMMON = 0.01
# A unit, or a change between two, is separated if chance causes its part of the dispersion less often than this.
_STRONG = 1e-3
# Of one unit alone nobody knows that the next ones would be like it.
_LEAST_UNITS = 2


class PitchSettings(NamedTuple):
    """Errors of the pitch settings by all units together.

    - `p_value`: probability of so much dispersion by noise alone; None if there is nothing to compare.
    - `alone`: numbers of the units excluded from that, because only theirs differ.
    - `seen`: the settings at which the rest were measured.
    - `changed`: number of the first unit from which on they are different (and equal again), if they are not equal in all.
    """

    p_value: float | None
    alone: tuple[int, ...]
    seen: Bool[np.ndarray, " settings"]
    changed: int | None = None

    @property
    def common(self) -> bool:
        """Whether they are the head's."""
        return self.p_value is not None and self.p_value > COMMON


def pitch_settings(fits: Sequence[UnitFit], shared: Float[np.ndarray, " directions"], most_alone: int) -> PitchSettings:
    """Compare the pitch errors of the units, given the shared errors.

    If they differ by more than the noise, those farthest from the others are excluded one by one, as long as the rest may then
    agree. One wrong label does not mean an axis that is set again for each unit.

    **Arguments:**

    - `most_alone`: how many units may be excluded.
    """
    units, number = _estimates(fits, shared), len(fits)
    kept, changed = np.ones(number, bool), None
    (first,) = (best,) = _scatter(units, kept[None])
    while best.dof and best.p_value <= COMMON and number - np.sum(kept) < most_alone:
        candidates = np.flatnonzero(kept)
        without = _scatter(units, kept & (np.arange(number) != candidates[:, None]))
        farthest = min(range(len(candidates)), key=lambda k: without[k].chi2)
        if not best.much_above(without[farthest], len(candidates)):
            break
        kept[candidates[farthest]] = False
        best = without[farthest]
    if best.p_value <= COMMON:
        kept[:], best = True, first
        splits = np.arange(_LEAST_UNITS, number - _LEAST_UNITS + 1)
        before = np.arange(number) < splits[:, None]
        in_two = _scatter(units, before, ~before)
        good = [k for k, own in enumerate(in_two) if own.p_value > COMMON and first.much_above(own, len(splits))]
        changed = int(splits[min(good, key=lambda k: in_two[k].chi2)]) if good else None
    p_value = best.p_value if best.dof else None
    return PitchSettings(p_value, tuple(np.flatnonzero(~kept).tolist()), np.any(units.seen[kept], axis=0), changed)


class _Estimates(NamedTuple):
    """The units' own estimates of the settings' errors, counted from their mean over all units.

    - `matrix`, `towards`: information of each, and its product with the estimate. `own`: the estimate's square in that.
    - `seen`: which settings each was measured at.
    """

    matrix: Float[np.ndarray, "units settings settings"]
    towards: Float[np.ndarray, "units settings"]
    own: Float[np.ndarray, " units"]
    seen: Bool[np.ndarray, "units settings"]


def _estimates(fits: Sequence[UnitFit], shared: Float[np.ndarray, " directions"]) -> _Estimates:
    count, each = len(shared), [fit.information for fit in fits]
    matrix = np.stack([own.matrix[count:, count:] for own in each])
    towards = np.stack([own.towards[count:] - own.matrix[count:, :count] @ shared for own in each])
    seen = np.diagonal(matrix, axis1=1, axis2=2) > 0
    towards = (towards - matrix @ _solved(np.sum(matrix, axis=0), np.sum(towards, axis=0))) * seen
    return _Estimates(matrix, towards, np.einsum("us,us->u", _solved(matrix, towards), towards), seen)


def _solved(
    matrix: Float[np.ndarray, "*sums settings settings"], towards: Float[np.ndarray, "*sums settings"]
) -> Float[np.ndarray, "*sums settings"]:
    """Estimates of the settings that were met, 0 for the others."""
    met = np.diagonal(matrix, axis1=-2, axis2=-1) > 0
    filled = np.where(met[..., None] & met[..., None, :], matrix, np.eye(met.shape[-1]))
    return np.linalg.solve(filled, (towards * met)[..., None])[..., 0]


class _Scatter(NamedTuple):
    """Chi-square of estimates about the same errors, and its degrees of freedom; 0 where nothing is to compare."""

    chi2: float
    dof: int

    @property
    def p_value(self) -> float:
        return float(gammaincc(self.dof / 2, self.chi2 / 2)) if self.dof else 1.0

    def much_above(self, other: "_Scatter", tried: int) -> bool:
        """Whether an improvement over `other`, the best of so many, is significant."""
        dof = self.dof - other.dof
        return dof > 0 and tried * float(gammaincc(dof / 2, (self.chi2 - other.chi2) / 2)) < _STRONG


def _scatter(units: _Estimates, *groups: Bool[np.ndarray, "choices units"]) -> list[_Scatter]:
    """Of the units of each group about errors that are the same for all of it, for each choice of such groups."""
    chi2, dof = np.zeros(len(groups[0])), np.zeros(len(groups[0]), int)
    for group in groups:
        matrix, towards = np.tensordot(group, units.matrix, 1), group @ units.towards
        met = np.diagonal(matrix, axis1=1, axis2=2) > 0
        chi2 += group @ units.own - np.einsum("cs,cs->c", _solved(matrix, towards), towards * met)
        dof += group @ np.sum(units.seen, axis=1) - np.sum(met, axis=1)
    return [_Scatter(max(own, 0.0), int(free)) for own, free in zip(chi2.tolist(), dof, strict=True)]
