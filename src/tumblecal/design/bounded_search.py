"""The best plan by a criterion, and how close it is to the best possible one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.design.bounds import GOOD, Bounds, bounds
from tumblecal.design.criteria import CriterionOfCovariance
from tumblecal.design.exchange import Chosen, exchange
from tumblecal.design.limits import limits_of
from tumblecal.design.measure import measures
from tumblecal.design.one_visit import OneVisit, one_visit
from tumblecal.design.responses import Responses


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
    responses: Responses,
    ability: HeadAbility,
    criterion: CriterionOfCovariance,
    *,
    count: int | None = None,
    minutes: float | None = None,
    model: OneVisit | None = None,
    allowed: Bool[np.ndarray, " cells"] | None = None,
    repeats: int = 1,
    restarts: int = 2,
    seed: int = 0,
) -> Found:
    """Exchange, then bounds; then exchange from the rounded optima of the classes of plans that the bounds do not exclude.

    **Arguments:** as `exchange`; `model`: of the responses, with positions that are measured already.

    **Raises:** as `exchange`.
    """
    model = one_visit(responses) if model is None else model
    factory = measures(model, criterion)
    limits = limits_of(responses.cells, ability, count=count, minutes=minutes, allowed=allowed, repeats=repeats)

    def search(restarts: int, starts: Sequence[Sequence[int] | np.ndarray], seed: int) -> Chosen:
        return exchange(
            responses,
            ability,
            factory,
            count=count,
            minutes=minutes,
            allowed=allowed,
            repeats=repeats,
            restarts=restarts,
            seed=seed,
            starts=starts,
        )

    chosen = search(restarts, (), seed)
    limit = bounds(model, criterion, limits, chosen.cells)
    for number in range(1, _ROUNDS + 1):
        if limit.efficiency >= _CLOSE or not limit.rounded:
            break
        # A plan far from its bound gets new random starts too.
        far = limit.efficiency < GOOD
        other = search(restarts if far else 0, limit.rounded[:_CLASSES], seed + number)
        if other.value < chosen.value * (1 - 1e-6):
            chosen = other
            limit = bounds(model, criterion, limits, chosen.cells)
        elif not far:
            break
    return Found(chosen, limit)
