"""The best plan by a criterion, and how close it is to the best possible one."""

from dataclasses import dataclass, replace

from tumblecal.design.criteria.criterion import CriterionOfCovariance
from tumblecal.design.criteria.measure import measures
from tumblecal.design.model.limits import Limits
from tumblecal.design.model.one_visit import OneVisit
from tumblecal.design.positions.bounds import GOOD, Bounds, bounds
from tumblecal.design.positions.exchange import Chosen, exchange


# A plan this close to its bound is not searched further; the most promising classes of plans are searched in each round.
_CLOSE = 0.99
_ROUNDS = 3
_CLASSES = 4


@dataclass(frozen=True)
class Found:
    """A plan and its bounds."""

    chosen: Chosen
    bounds: Bounds


def best_plan(
    model: OneVisit,
    criterion: CriterionOfCovariance,
    limits: Limits,
    *,
    restarts: int = 2,
    seed: int = 0,
    several: OneVisit | None = None,
) -> Found:
    """Exchange, then bounds; then exchange from the rounded optima of the classes of plans that the bounds do not exclude.

    **Arguments:**

    - `model`: of the cells, with positions that are measured already. `limits`: of the plan.
    - `restarts`, `seed`: as of `exchange`. `several`: model of several visits of the settings, for the bound of any plan; None:
      not computed.
    """
    factory = measures(model, criterion)
    chosen = exchange(limits, factory, restarts=restarts, seed=seed)
    limit = bounds(model, criterion, limits, chosen.cells)
    for number in range(1, _ROUNDS + 1):
        if limit.efficiency >= _CLOSE or not limit.rounded:
            break
        # A plan far from its bound gets new random starts too.
        far = limit.efficiency < GOOD
        starts = limit.rounded[:_CLASSES]
        other = exchange(limits, factory, restarts=restarts if far else 0, seed=seed + number, starts=starts)
        if other.value < chosen.value * (1 - 1e-6):
            chosen = other
            limit = bounds(model, criterion, limits, chosen.cells)
        elif not far:
            break
    if several is not None:
        limit = replace(limit, repeated=min(bounds(several, criterion, limits, chosen.cells).white, limit.white))
    return Found(chosen, limit)
