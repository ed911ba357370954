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
    number = len(equations.towards)
    kept, numbers, changed = np.ones(number, bool), np.arange(number), None
    first = statistic, dof = _single(equations, kept)
    while dof and _p_value(statistic, dof) <= PITCH_COMMON and number - np.sum(kept) < most_alone:
        candidates = np.flatnonzero(kept)
        without = equations.heterogeneity(kept & (numbers != candidates[:, None]))
        farthest = int(np.argmin(without[0]))
        rest, rest_dof = float(without[0][farthest]), int(without[1][farthest])
        if not _improved(statistic - rest, np.array(dof - rest_dof), len(candidates)):
            break
        kept[candidates[farthest]] = False
        statistic, dof = rest, rest_dof
    if dof and _p_value(statistic, dof) <= PITCH_COMMON:
        kept[:], (statistic, dof) = True, first
        splits = np.arange(LEAST_UNITS, number - LEAST_UNITS + 1)
        before = numbers < splits[:, None]
        squares, free = equations.heterogeneity(before, ~before)
        agree = (_p_value(squares, free) > PITCH_COMMON) & _improved(statistic - squares, dof - free, len(splits))
        changed = int(splits[np.argmin(np.where(agree, squares, np.inf))]) if np.any(agree) else None
    seen = np.any(np.diagonal(equations.gram[kept], axis1=1, axis2=2) > 0, axis=0)
    p_value = float(_p_value(statistic, dof)) if dof else None
    return PitchSettings(p_value, tuple(np.flatnonzero(~kept).tolist()), seen, changed)


def _single(equations: NormalEquations, kept: Bool[np.ndarray, " units"]) -> tuple[float, int]:
    (statistic,), (dof,) = equations.heterogeneity(kept[None])
    return float(statistic), int(dof)


def _p_value(statistic: float | Float[np.ndarray, " n"], dof: int | Int[np.ndarray, " n"]) -> np.ndarray:
    """Of Cochran's Q; 1 where nothing is to compare."""
    return np.where(np.equal(dof, 0), 1.0, gammaincc(np.maximum(dof, 1) / 2, np.divide(statistic, 2)))


def _improved(
    decrease: float | Float[np.ndarray, " n"], dof: Int[np.ndarray, " *n"], tried: int
) -> Bool[np.ndarray, " *n"]:
    """Whether a decrease of Q, the largest of so many tried, is significant."""
    return (dof > 0) & (tried * gammaincc(np.maximum(dof, 1) / 2, np.maximum(decrease, 0.0) / 2) < PITCH_SEPARATED)
