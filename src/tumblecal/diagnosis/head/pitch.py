"""Whether the errors of the pitch settings are the head's: units that measured on one setting of them agree to within noise."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaincc

from tumblecal.diagnosis.head.unit_fit import Information, UnitFit


# Pitch errors are the head's where the units' own estimates scatter no more than their noise does: not less probable.
COMMON = 0.01
# A unit, or a change between two, is told apart where its part of the scatter is by chance less often than this.
_STRONG = 1e-3
# Of one unit alone nobody knows that the next ones would be like it.
_LEAST_UNITS = 2


class PitchSettings(NamedTuple):
    """What the units say of the pitch settings' errors together.

    - `p_value`: that they scatter so much by their noise alone; None where nothing is to compare.
    - `alone`: numbers of the units left out of that, because theirs alone are others.
    - `seen`: which of the settings the rest were measured at.
    - `changed`: number of the first unit from which on they are others, the same again, where they are not the same in all.
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
    """Compare the units' pitch errors, what is shared taken as found.

    Where they scatter more than noise, those farthest from the others are left out one by one, as long as the rest may then
    agree: one label that is wrong makes no axis that is set anew each time.

    **Arguments:**

    - `most_alone`: how many units may be left out.
    """
    count = len(shared)
    parts = [
        Information(
            fit.information.matrix[count:, count:],
            fit.information.towards[count:] - fit.information.matrix[count:, :count] @ shared,
        )
        for fit in fits
    ]
    kept, changed = list(range(len(parts))), None
    first = best = _scatter(parts)
    while best.dof and best.p_value <= COMMON and len(parts) - len(kept) < most_alone:
        without = {k: _scatter([parts[other] for other in kept if other != k]) for k in kept}
        farthest = min(without, key=lambda k: without[k].chi2)
        if not best.much_above(without[farthest], len(kept)):
            break
        kept.remove(farthest)
        best = without[farthest]
    if best.p_value <= COMMON:
        kept, best = list(range(len(parts))), first
        splits = range(_LEAST_UNITS, len(parts) - _LEAST_UNITS + 1)
        in_two = {k: _scatter(parts[:k], parts[k:]) for k in splits}
        good = [k for k, own in in_two.items() if own.p_value > COMMON and first.much_above(own, len(splits))]
        changed = min(good, key=lambda k: in_two[k].chi2, default=None)
    seen = np.any([np.diag(parts[k].matrix) > 0 for k in kept], axis=0)
    p_value = best.p_value if best.dof else None
    return PitchSettings(p_value, tuple(k for k in range(len(parts)) if k not in kept), seen, changed)


class _Scatter(NamedTuple):
    """Chi-square of estimates about the same errors, and its degrees of freedom; 0 where nothing is to compare."""

    chi2: float
    dof: int

    @property
    def p_value(self) -> float:
        return float(gammaincc(self.dof / 2, self.chi2 / 2)) if self.dof else 1.0

    def much_above(self, other: "_Scatter", tried: int) -> bool:
        """Whether what explains it but for `other` is no chance, the best of so many."""
        dof = self.dof - other.dof
        return dof > 0 and tried * float(gammaincc(dof / 2, (self.chi2 - other.chi2) / 2)) < _STRONG


def _scatter(*groups: Sequence[Information]) -> _Scatter:
    """Of the units of each group about errors that are the same for all of it."""
    chi2, dof = 0.0, 0
    for parts in groups:
        matrix = np.sum([part.matrix for part in parts], axis=0)
        met = np.diag(matrix) > 0
        mean = np.zeros(len(met))
        mean[met] = np.linalg.solve(matrix[np.ix_(met, met)], np.sum([part.towards for part in parts], axis=0)[met])
        dof -= int(np.sum(met))
        for part in parts:
            seen = np.diag(part.matrix) > 0
            inside = part.matrix[np.ix_(seen, seen)]
            off = np.linalg.solve(inside, part.towards[seen]) - mean[seen]
            chi2 += float(off @ inside @ off)
            dof += int(np.sum(seen))
    return _Scatter(chi2, dof)
