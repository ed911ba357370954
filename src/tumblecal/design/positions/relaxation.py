"""Fractions of positions: the least value of a criterion over the convex hull of many plans, with a duality gap.

Simplicial decomposition: a mixture of few plans is optimised by Newton steps with a barrier, then the plan that reduces the
value most is added (von Hohenbalken 1977, Mathematical Programming 13, 49). The logarithm of a criterion is convex in the
mixture, so its tangent is a lower bound for every plan: at any mixture, whether it is optimal or not.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.design.criteria.criterion import CriterionOfCovariance
from tumblecal.design.model.one_visit import OneVisit, inverse


# Power of the mean that stands for the largest variance.
POWER = 64.0
# Plans with less than this share leave a mixture. The barrier falls from the first to the last weight.
_LEAST = 1e-4
_BARRIER = (1e-2, 1e-5)
_NEWTON = 6

# Of the gain of each cell to the best plan (number of positions in each cell), and at least the sum of its gains.
Best = Callable[[Float[np.ndarray, " cells"]], tuple[np.ndarray, float]]


@dataclass(frozen=True)
class Tangent:
    """A lower bound of the logarithm of the criterion: `level` minus the sum of the `gain` of the positions."""

    level: float
    gain: Float[np.ndarray, " cells"]


@dataclass(frozen=True)
class Relaxed:
    """A mixture of plans: `fractions` of positions, the logarithm of the criterion, its lower bound and the tangent of it."""

    fractions: Float[np.ndarray, " cells"]
    log_value: float
    log_bound: float
    tangent: Tangent


def relaxed(
    model: OneVisit,
    criterion: CriterionOfCovariance,
    best: Best,
    starts: Sequence[np.ndarray],
    *,
    enough: float = np.inf,
    tolerance: float = 1e-3,
    steps: int = 120,
) -> Relaxed:
    """The least value over mixtures of plans, to a relative `tolerance`, or until the bound reaches the logarithm `enough`.

    **Arguments:** `best`: the best plan for gains. `starts`: plans to begin with (positions in each cell).
    """
    mixture = _Mixture(model, criterion, starts)
    found: Relaxed | None = None
    for step in range(steps):
        mixture.optimise(max(_BARRIER[1], _BARRIER[0] * 10 ** (-0.15 * step)))
        here, plan = mixture.bounded(best)
        if found is None or here.log_bound > found.log_bound:
            found = here
        if found.log_bound >= enough or here.log_value - found.log_bound < tolerance:
            break
        mixture.add(plan)
    assert found is not None
    return found


class _Mixture:
    """A mixture of plans and its information."""

    def __init__(self, model: OneVisit, criterion: CriterionOfCovariance, starts: Sequence[np.ndarray]) -> None:
        self._model, self._criterion = model, criterion
        self._flat = model.columns.reshape(-1, model.columns.shape[2])
        self._rows = np.zeros((len(criterion.rows), self._flat.shape[1]))
        self._rows[:, : len(model.names)] = criterion.rows
        self._plans = np.array(starts, float)
        self._parts = np.array([self._information(plan) for plan in self._plans])
        self._share = np.full(len(starts), 1 / len(starts))

    def _information(self, plan: np.ndarray) -> np.ndarray:
        taken = np.flatnonzero(plan)
        rows = self._model.columns[taken] * np.sqrt(plan[taken])[:, None, None]
        rows = rows.reshape(-1, rows.shape[2])
        return rows.T @ rows

    def add(self, plan: np.ndarray) -> None:
        """Add a plan, and remove those that hardly contribute."""
        kept = self._share > _LEAST
        self._plans = np.concatenate([self._plans[kept], plan[None]])
        self._parts = np.concatenate([self._parts[kept], self._information(plan)[None]])
        share = np.append(0.9 * self._share[kept], 0.1)
        self._share = share / share.sum()

    def _covariance(self, share: np.ndarray) -> np.ndarray:
        return inverse(self._model.information + np.tensordot(share, self._parts, 1))

    def _log(self, share: np.ndarray) -> float:
        return float(np.log(self._criterion.of_rows(self._rows @ self._covariance(share) @ self._rows.T)))

    def optimise(self, barrier: float) -> None:
        """Newton steps for the shares."""
        if len(self._share) == 1:
            return
        for _ in range(_NEWTON):
            share, covariance = self._share, self._covariance(self._share)
            first = covariance @ self._rows.T
            then = self._parts @ first
            of_rows = self._rows @ first
            root = self._criterion.support(of_rows)[1]
            through = (np.linalg.cholesky(covariance).T @ then @ root).reshape(len(share), -1)
            slope = -np.einsum("pr,npr->n", first @ root, then @ root) - barrier / share
            curve = (
                2 * through @ through.T + self._criterion.curvature(of_rows, first, then) + np.diag(barrier / share**2)
            )
            solved = np.linalg.solve(curve, np.stack([slope, np.ones(len(share))], axis=1))
            step = solved[:, 1] * (solved[:, 0].sum() / solved[:, 1].sum()) - solved[:, 0]
            decrease = -float(slope @ step)
            if not decrease > 0.3 * barrier * len(share):
                return
            falling = step < 0
            size = min(1.0, 0.95 * float(np.min(-share[falling] / step[falling], initial=np.inf)))
            now = np.log(self._criterion.of_rows(of_rows)) - barrier * np.log(share).sum()
            while size > 1e-6:
                next_share = share + size * step
                if self._log(next_share) - barrier * np.log(next_share).sum() <= now - 0.1 * size * decrease:
                    break
                size /= 2
            self._share = (share + size * step) / (share + size * step).sum()

    def bounded(self, best: Best) -> tuple[Relaxed, np.ndarray]:
        """The mixture with its lower bound, and the best plan for its gains."""
        fractions = self._share @ self._plans
        first = self._covariance(self._share) @ self._rows.T
        of_rows = self._rows @ first
        value, root = self._criterion.support(of_rows)
        gain = np.sum((self._flat @ (first @ root)).reshape(len(fractions), -1) ** 2, axis=1)
        plan, most = best(gain)
        level = float(np.log(value) + gain @ fractions)
        return Relaxed(
            fractions, float(np.log(self._criterion.of_rows(of_rows))), level - most, Tangent(level, gain)
        ), plan
