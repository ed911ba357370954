"""Positions that all others contradict: single outliers, and two rows that appear exchanged.

A position is excluded by a free shift of each of its readings (the mean-shift model; Cook and Weisberg 1982, section
2.2). Let Q be a basis of the column space of the parameters in the white rows r, R = I - Q Q', and D the white rows
of these shifts. The sum of squares decreases by `t = r'D (D'R D)^+ D'r`, with as many degrees of freedom as the rank
of D'R D: three for a position of known angles, one for an unknown attitude. For two positions D has the shifts of
both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import special

from tumblecal.estimation import exact
from tumblecal.estimation.contradicted import column_space
from tumblecal.estimation.fit import Fit
from tumblecal.ground.axes import AXES


# Family-wise false alarms on clean data: half of them for the single positions, half for the pairs.
FALSE_ALARMS = 1e-3
# A direction of the shifts of which less than this share remains is absorbed by the parameters.
_ABSORBED = 1e-6
# Degrees of freedom that must remain; largest number of outliers; pairs compared exactly; positions among which pairs are
# searched (those with the largest reduction of the sum of squares).
_LEAST_DOF, _MOST_OUTLIERS, _MOST_PAIRS, _MOST_PAIRED = 3, 5, 5, 60
# Replaced readings have converged if they change by less than this share of the sd; largest number of fits.
_SETTLED_SD, _MOST_STEPS = 1e-2, 8
# Largest p-value at which an exchange fits worse than the exclusion of both positions and is rejected.
_AS_GOOD = 1e-3


@dataclass(frozen=True)
class Contradicted:
    """An outlier position, or two exchanged positions.

    - `positions`: one name, or the two that appear exchanged. `axis`: the reading that differs most from the prediction by the
      other positions.
    - `sds`: difference of the positions from the prediction, in its standard uncertainty; `p_value`: probability that any
      position differs as much by chance.
    - `difference_g`: of that reading, measured minus predicted.
    - `fit`: without the positions, or with the two exchanged back. `moved`: the largest change of a parameter between this
      and the fit of all, in its sd.
    """

    positions: tuple[str, ...]
    axis: str
    sds: float
    p_value: float
    difference_g: float
    fit: Fit
    moved: float

    @property
    def exchanged(self) -> bool:
        """Whether these are two rows that appear exchanged."""
        return len(self.positions) == 2


class _LeftOut(NamedTuple):
    """Reduction of the sum of squares by the exclusion of positions, its degrees of freedom, and the equivalent shifts (g)."""

    square: float
    dof: int
    shifts: Float[np.ndarray, " shifts"]


class _Shifts:
    """Shifts of every reading of a fit, in its sd, and their projections on the fit.

    - `already`: positions excluded before; `fit` no longer includes their degrees of freedom.
    """

    def __init__(self, fit: Fit, already: Sequence[int] = ()):
        problem, count = fit.problem, fit.problem.readings.size
        self.fit, self.sd = fit, problem.sd.ravel()
        # White rows of the shifts; for independent readings these are unit vectors and not stored.
        self._white = None
        if problem.correlated:
            self._white = np.zeros((len(fit.rows), count))
            self._white[:count] = problem.whitening_matrix * self.sd
        design = fit.jacobian
        if already:
            here = _readings_of(already)
            design = np.hstack(
                [design, np.eye(len(fit.rows))[:, here] if self._white is None else self._white[:, here]]
            )
        self.column_space = column_space(design)
        self._projected = self.column_space[:count] if self._white is None else self._white.T @ self.column_space
        self._along = fit.rows[:count] if self._white is None else fit.rows @ self._white

    def of_each(self, groups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reduction of the sum of squares, and its degrees of freedom, by the exclusion of each group (groups, positions)."""
        values, along, free, _ = self._turned(groups)
        return np.sum(np.where(free, along**2 / np.where(free, values, 1.0), 0.0), axis=1), np.sum(free, axis=1)

    def of(self, positions: Sequence[int]) -> _LeftOut:
        """The effect of excluding these positions together."""
        values, along, free, vectors = (part[0] for part in self._turned(np.array([positions])))
        along, values = along[free], values[free]
        shifts = vectors[:, free] @ (along / values) * self.sd[_readings_of(positions)]
        return _LeftOut(float(np.sum(along**2 / values)), int(np.sum(free)), shifts)

    def _turned(self, groups: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Eigenvalues of D'R D for each group, r'D along its eigenvectors, which of them are not absorbed, and the vectors."""
        here = (3 * groups[:, :, None] + np.arange(3)).reshape(len(groups), -1)
        projected = self._projected[here]
        if self._white is None:
            gram = np.broadcast_to(np.eye(here.shape[1]), (len(groups), here.shape[1], here.shape[1]))
        else:
            white = self._white.T[here]
            gram = white @ white.transpose(0, 2, 1)
        values, vectors = np.linalg.eigh(gram - projected @ projected.transpose(0, 2, 1))
        free = values > _ABSORBED * np.trace(gram, axis1=1, axis2=2)[:, None] / here.shape[1]
        return values, np.einsum("gkv,gk->gv", vectors, self._along[here]), free, vectors

    def variance(self, square: np.ndarray, dof: np.ndarray) -> np.ndarray:
        """Variance of the white rows, estimated from the other positions; for stated noise at least 1."""
        remaining_dof = self.fit.dof - dof
        rest = np.maximum(self.fit.chi2 - square, 1e-12 * self.fit.chi2) / np.maximum(remaining_dof, 1)
        return np.maximum(1.0, rest) if self.fit.problem.known else rest

    def p_values(self, square: np.ndarray, dof: np.ndarray) -> np.ndarray:
        """Probability of such a reduction of the sum of squares for positions chosen in advance."""
        remaining_dof, ratio = self.fit.dof - dof, square / self.variance(square, dof)
        terms = np.maximum(dof, 1)
        tail = (
            special.chdtrc(terms, ratio)
            if self.fit.problem.known
            else special.fdtrc(terms, np.maximum(remaining_dof, 1), ratio / terms)
        )
        return np.where((dof > 0) & (remaining_dof >= _LEAST_DOF), tail, 1.0)


def contradicted(fit: Fit, false_alarms: float = FALSE_ALARMS) -> tuple[Contradicted, ...]:
    """Two positions that appear exchanged, then single outliers, the largest first; each is excluded before the next search.

    **Arguments:**

    - `fit`: an exact fit. `false_alarms`: largest share of clean data sets (Gaussian noise) in which anything is found.
    """
    if not fit.code.good or len(fit.rows) < fit.problem.readings.size or fit.computed:
        return ()
    found, already = list[Contradicted](), list[int]()
    if (pair := _exchanged(fit, 0.5 * false_alarms)) is not None:
        found.append(pair)
    last = found[-1].fit if found else fit
    retained = np.flatnonzero(fit.retained).tolist()
    while retained and len(found) < _MOST_OUTLIERS:
        shifts = _Shifts(last, already)
        candidates = [k for k in retained if k not in already]
        p_values = len(candidates) * shifts.p_values(*shifts.of_each(np.array(candidates)[:, None]))
        position, p_value = candidates[int(np.argmin(p_values))], float(np.min(p_values))
        removed = shifts.of([position])
        without = _without(last, [*already, position], removed.dof) if p_value <= 0.5 * false_alarms else None
        if without is None:
            break
        already.append(position)
        found.append(_contradicted(fit, without, (position,), removed, shifts, 2.0 * p_value))
        last = without
    return tuple(found)


def _exchanged(fit: Fit, false_alarms: float) -> Contradicted | None:
    """The two positions of known angles that all others contradict, and whose exchanged readings agree with the others."""
    if fit.data.hand_held or fit.problem.correlated or fit.dof < 6 + _LEAST_DOF:
        return None
    shifts, retained, readings = _Shifts(fit), np.flatnonzero(fit.retained), np.asarray(fit.problem.readings)
    pairs = len(retained) * (len(retained) - 1) // 2
    if len(retained) > _MOST_PAIRED:
        retained = np.sort(retained[np.argsort(shifts.of_each(retained[:, None])[0])[-_MOST_PAIRED:]])
    listed = np.array([*combinations(retained.tolist(), 2)])
    square, dof = shifts.of_each(listed)
    candidates = []
    for first, second in listed[(dof == 6) & (pairs * shifts.p_values(square, dof) <= false_alarms)].tolist():
        rows = fit.rows.copy()
        rows[: readings.size] += fit.problem.rows(_with_exchanged(readings, first, second) - readings)
        rest = rows - shifts.column_space @ (shifts.column_space.T @ rows)
        candidates.append((float(rest @ rest), first, second))
    candidates.sort()
    for _, first, second in candidates[:_MOST_PAIRS]:
        removed = shifts.of([first, second])
        exchanged = replace(fit.problem, readings=_with_exchanged(readings, first, second))
        back, without = exact.fit(exchanged), _without(fit, [first, second], removed.dof)
        if without is None or not back.code.good:
            continue
        level = without.chi2 / without.dof
        variance = max(1.0, level) if fit.problem.known else level
        more, fewer = max(back.chi2 - without.chi2, 0.0) / 6, (fit.chi2 - without.chi2) / 6
        p_value = pairs * float(special.fdtrc(6, without.dof, fewer / variance))
        if p_value <= false_alarms and special.fdtrc(6, without.dof, more / variance) > _AS_GOOD:
            return _contradicted(fit, back, (first, second), removed, shifts, 2.0 * p_value)
    return None


def _with_exchanged(readings: Float[np.ndarray, "positions 3"], first: int, second: int) -> np.ndarray:
    swapped = np.array(readings)
    swapped[[first, second]] = readings[[second, first]]
    return swapped


def _readings_of(positions: Sequence[int]) -> np.ndarray:
    """Indices of the readings of some positions among all readings."""
    return np.concatenate([np.arange(3 * k, 3 * k + 3) for k in positions])


def _without(fit: Fit, positions: Sequence[int], dof: int) -> Fit | None:
    """The exact fit without some positions, with `dof` fewer degrees of freedom; None if it does not converge.

    Their readings are replaced by the predictions of the others (Yates 1933). This gives the same estimate, and an unknown
    attitude of an excluded position stays determined.
    """
    readings, refitted = np.array(fit.problem.readings), fit
    for _ in range(_MOST_STEPS):
        shifts = _Shifts(refitted).of(positions).shifts.reshape(-1, 3)
        readings[list(positions)] -= shifts
        refitted = exact.fit(replace(fit.problem, readings=readings), refitted.vector)
        if not refitted.code.good:
            return None
        if np.max(np.abs(shifts)) < _SETTLED_SD * np.min(fit.problem.sd if fit.problem.known else refitted.sigma):
            break
    ratio = 1.0 if fit.problem.known or refitted.dof <= dof else refitted.dof / (refitted.dof - dof)
    # `fit` already excludes the degrees of freedom of positions excluded before.
    before = fit.dof - dof
    return replace(refitted, dof=before, covariance=refitted.covariance * ratio) if before >= _LEAST_DOF else None


def _contradicted(
    fit: Fit, other: Fit, positions: tuple[int, ...], removed: _LeftOut, shifts: _Shifts, p_value: float
) -> Contradicted:
    farthest = int(np.argmax(np.abs(removed.shifts)))
    moved = (abs(fit.values[k] - other.values[k]) / other.sd[k] for k in fit.shared if other.sd[k] > 0)
    return Contradicted(
        positions=tuple(fit.data.names[k] for k in positions),
        axis=AXES[farthest % 3],
        sds=float(np.sqrt(removed.square / shifts.variance(np.array([removed.square]), np.array([removed.dof]))[0])),
        p_value=min(1.0, p_value),
        difference_g=float(removed.shifts[farthest]),
        fit=other,
        moved=float(max(moved, default=0.0)),
    )
