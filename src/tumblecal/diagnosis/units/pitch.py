"""Whether the errors of the pitch settings are the head's: units that measured on one setting of them agree to within noise."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammaincc

from tumblecal.diagnosis.priors import PITCH_COMMON, PITCH_SEPARATED
from tumblecal.diagnosis.units.amounts import LEAST_UNITS
from tumblecal.diagnosis.units.mixed_model import NormalEquations


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
        return self.p_value is not None and self.p_value > PITCH_COMMON


def pitch_settings(equations: NormalEquations, most_alone: int) -> PitchSettings:
    """Compare the pitch errors of the units, given the shared errors, by Cochran's Q.

    If they differ by more than the noise, those farthest from the others are excluded one by one, as long as the rest may then
    agree: one wrong label does not mean an axis that is set again for each unit. Otherwise they may have changed once.

    **Arguments:**

    - `equations` (units, settings): of the pitch errors; a setting that a unit lacks has no information.
    - `most_alone`: how many units may be excluded.
    """
    count = len(equations.towards)
    kept, numbers, changed = np.ones(count, bool), np.arange(count), None
    (statistic,), (dof,) = equations.heterogeneity(kept[None])
    everybody = statistic, dof
    while _p_value(statistic, dof) <= PITCH_COMMON and count - np.sum(kept) < most_alone:
        candidates = np.flatnonzero(kept)
        statistics, dofs = equations.heterogeneity(kept & (numbers != candidates[:, None]))
        farthest = np.argmin(statistics)
        if not _improved(statistic - statistics, dof - dofs)[farthest]:
            break
        kept[candidates[farthest]] = False
        statistic, dof = statistics[farthest], dofs[farthest]
    if _p_value(statistic, dof) <= PITCH_COMMON:
        kept[:], (statistic, dof) = True, everybody
        splits = np.arange(LEAST_UNITS, count - LEAST_UNITS + 1)
        before = numbers < splits[:, None]
        statistics, dofs = equations.heterogeneity(before, ~before)
        agree = (_p_value(statistics, dofs) > PITCH_COMMON) & _improved(statistic - statistics, dof - dofs)
        changed = int(splits[np.argmin(np.where(agree, statistics, np.inf))]) if np.any(agree) else None
    seen = np.any(np.diagonal(equations.gram[kept], axis1=1, axis2=2) > 0, axis=0)
    p_value = float(_p_value(statistic, dof)) if dof else None
    return PitchSettings(p_value, tuple(np.flatnonzero(~kept).tolist()), seen, changed)


def _p_value(statistic: Float[np.ndarray, " *n"], dof: Int[np.ndarray, " *n"]) -> np.ndarray:
    """Of Cochran's Q; 1 where nothing is to compare."""
    return np.where(dof > 0, gammaincc(np.maximum(dof, 1) / 2, statistic / 2), 1.0)


def _improved(decrease: Float[np.ndarray, " tried"], dof: Int[np.ndarray, " tried"]) -> Bool[np.ndarray, " tried"]:
    """Whether decreases of Q, of which the largest counts, are significant."""
    return len(dof) * _p_value(np.maximum(decrease, 0.0), dof) < PITCH_SEPARATED
