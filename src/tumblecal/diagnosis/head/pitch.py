"""Whether the errors of the pitch settings are the head's: units that measured on one setting of them agree to within noise."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaincc

from tumblecal.diagnosis.head.unit_fit import Information, UnitFit


# Pitch errors are the head's where the units' own estimates scatter no more than their noise does: not less probable.
COMMON = 0.01


class PitchSettings(NamedTuple):
    """What the units say of the pitch settings' errors together.

    - `p_value`: that they scatter so much by their noise alone; None where nothing is to compare.
    - `alone`: numbers of the units left out of that, because theirs alone are others.
    - `seen`: which of the settings the rest were measured at.
    """

    p_value: float | None
    alone: tuple[int, ...]
    seen: Bool[np.ndarray, " settings"]

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
    kept = list(range(len(parts)))
    first = best = _scatter(parts)
    while best is not None and best <= COMMON and len(parts) - len(kept) < most_alone:
        without = {k: _scatter([parts[other] for other in kept if other != k]) for k in kept}
        compared = {k: p for k, p in without.items() if p is not None}
        if not compared:
            break
        worst = max(compared, key=lambda k: compared[k])
        kept.remove(worst)
        best = compared[worst]
    if best is None or best <= COMMON:
        kept, best = list(range(len(parts))), first
    seen = np.any([np.diag(parts[k].matrix) > 0 for k in kept], axis=0)
    return PitchSettings(best, tuple(k for k in range(len(parts)) if k not in kept), seen)


def _scatter(parts: Sequence[Information]) -> float | None:
    """That the errors are the same: chi-square of their scatter."""
    matrix = np.sum([part.matrix for part in parts], axis=0)
    met = np.diag(matrix) > 0
    estimated = sum(int(np.sum(np.diag(part.matrix) > 0)) for part in parts)
    if estimated <= np.sum(met):
        return None
    mean = np.zeros(len(met))
    mean[met] = np.linalg.solve(matrix[np.ix_(met, met)], np.sum([part.towards for part in parts], axis=0)[met])
    chi2 = 0.0
    for part in parts:
        seen = np.diag(part.matrix) > 0
        inside = part.matrix[np.ix_(seen, seen)]
        off = np.linalg.solve(inside, part.towards[seen]) - mean[seen]
        chi2 += float(off @ inside @ off)
    return float(gammaincc((estimated - np.sum(met)) / 2, chi2 / 2))
