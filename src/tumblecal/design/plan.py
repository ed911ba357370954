"""The design of a measurement: positions, order, uncertainties, forecast of the diagnosis, comparison with common practice."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.design.candidates import Candidates, Evaluated
from tumblecal.design.cells import Cells
from tumblecal.design.common_plans import Positions, common_plans
from tumblecal.design.criteria import Criterion
from tumblecal.design.effects_of_plan import effects_of_plan
from tumblecal.design.exchange import exchange
from tumblecal.design.measure import measures
from tumblecal.design.naming import NamingForecast, detection_limit, forecast, forecast_of_effect
from tumblecal.design.one_visit import one_visit
from tumblecal.design.order import best_order
from tumblecal.design.planned_rig import planned_rig
from tumblecal.design.responses import Responses
from tumblecal.design.schedule import Schedule, schedule
from tumblecal.design.wanted import Wanted, criterion_of, rig_positions
from tumblecal.design.weighted import Weighted
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.errors import InputError


# Numbers of positions, or minutes, of the trade-off, relative to those of the plan.
_TRADED = (0.5, 0.7, 1.0, 1.4, 2.0, 3.0)
# Draws for each effect of a plan that is compared.
_DRAWS = 200


class TradeOff(NamedTuple):
    """A point of the trade-off: number of positions, minutes, and the criterion."""

    positions: int
    minutes: float
    value: float


@dataclass(frozen=True)
class DesignedPlan:
    """A designed plan.

    - `rig`: with the positions of the plan. `ability`: of the head. `wanted`: the request.
    - `responses`: of all cells. `names`: of the positions of `after.schedule`; `measured`: so many are measured already.
    - `criterion`: with its `value`, and `drift_known`, the value if the slow noise were known.
    - `after`: the plan. `before`: the positions that are measured already, otherwise the plan of the rig file.
    - `practice`: common practice, and plans to compare, in the same time.
    - `traded`: the trade-off between time and criterion. `forecast`: of the diagnosis.
    """

    rig: Rig
    ability: HeadAbility
    wanted: Wanted
    responses: Responses
    names: tuple[str, ...]
    measured: int
    criterion: Criterion | Weighted
    value: float
    drift_known: float
    after: Evaluated
    before: Evaluated
    practice: tuple[Evaluated, ...]
    traded: tuple[TradeOff, ...]
    forecast: NamingForecast | None

    @cached_property
    def cells(self) -> Cells:
        """The cells of all positions, in measuring order."""
        return self.responses.cells.chosen(self.after.schedule.cells)

    @property
    def minutes(self) -> float:
        """Time of the new positions."""
        start = self.after.schedule.start_s[self.measured] if self.measured else 0.0
        return float(self.after.schedule.end_s - start) / 60


def design_plan(rig: Rig, wanted: Wanted, entries: Catalogue) -> DesignedPlan:
    """Design a plan.

    **Arguments:**

    - `rig`: with what its head can do (`rig.ability`). `wanted`: the request. `entries`: the catalogue of effects.

    **Raises:** `InputError` for a request that the head cannot meet.
    """
    ability = rig.ability
    if ability is None:
        raise InputError(
            f"{rig.source}: no table [head]; state what the head can do, for example [head.times] dwell_s = 60"
        )
    common = (*common_plans(ability, rig.mounts, wanted.seed), *wanted.compared)
    others = {"rig": rig_positions(rig)} | {f"practice {k}": each for k, each in enumerate(common)}
    if wanted.measured is not None:
        others["measured"] = wanted.measured
    candidates = Candidates.of(rig, ability, others)
    search = _Search.of(candidates, wanted)
    planned, value, known = search.planned()
    names = _names(wanted.measured, len(planned))
    after = candidates.evaluated(Positions("this plan", "", (), (), ()), planned)
    before_of = candidates.numbers["rig" if wanted.measured is None else "measured"]
    before = candidates.evaluated(
        wanted.measured or others["rig"], schedule(candidates.responses.cells, before_of, ability.times)
    )
    practice = [
        candidates.in_time(positions, candidates.numbers[f"practice {k}"], planned.minutes)
        for k, positions in enumerate(common)
    ]
    made = planned_rig(rig, candidates.responses, planned, ability, names, wanted.seed)
    predicted = None
    if wanted.forecast:
        predicted = forecast(made, wanted.effects, entries, seed=wanted.seed)
        after = replace(after, effects=predicted.effects, undetectable=predicted.undetectable)
        before, *practice = (_with_effects(rig, candidates, each, wanted, entries) for each in (before, *practice))
    return DesignedPlan(
        rig=made,
        ability=ability,
        wanted=wanted,
        responses=candidates.responses,
        names=names,
        measured=len(search.measured),
        criterion=search.criterion,
        value=value,
        drift_known=known,
        after=after,
        before=before,
        practice=tuple(practice),
        traded=tuple(search.traded(len(planned) - len(search.measured))),
        forecast=predicted,
    )


@dataclass(frozen=True)
class _Search:
    """A search among the positions of a head: `cells` are their numbers among the candidates, `responses` those of these cells;
    `allowed`: those that may be chosen; `measured`: numbers, among the candidates, of positions that are measured already."""

    candidates: Candidates
    wanted: Wanted
    cells: Int[np.ndarray, " cells"]
    responses: Responses
    allowed: np.ndarray
    measured: Int[np.ndarray, " measured"]
    criterion: Criterion | Weighted

    @classmethod
    def of(cls, candidates: Candidates, wanted: Wanted) -> "_Search":
        measured = candidates.numbers.get("measured", np.zeros(0, int))
        cells, allowed = candidates.choices(measured)
        responses = candidates.responses.chosen(cells)
        criterion = criterion_of(wanted, responses, candidates.use, candidates.ability, allowed)
        return cls(candidates, wanted, cells, responses, allowed, measured, criterion)

    def chosen(self, *, count: int | None, minutes: float | None, restarts: int) -> Int[np.ndarray, " new"]:
        """Numbers of the best cells among the candidates."""
        kept = np.searchsorted(self.cells, self.measured)
        times = self.candidates.ability.times
        most = np.inf if minutes is None else 60 * minutes / (times.dwell_s + times.settle_s)
        most = most if count is None else min(most, count)
        found = exchange(
            self.responses,
            self.candidates.ability,
            measures(one_visit(self.responses, kept), self.criterion),
            count=count,
            minutes=minutes,
            allowed=self.allowed,
            # Cells are measured again only if there are too few.
            repeats=int(np.ceil(most / np.sum(self.allowed))),
            restarts=restarts,
            seed=self.wanted.seed,
        )
        return self.cells[found.cells]

    def planned(self) -> tuple[Schedule, float, float]:
        """The schedule, its criterion, and the criterion if the slow noise were known."""
        wanted, candidates = self.wanted, self.candidates
        cells, times = candidates.responses.cells, candidates.ability.times
        taken = self.chosen(count=wanted.count, minutes=wanted.minutes, restarts=wanted.restarts)
        after = schedule(cells, self.measured, times) if len(self.measured) else None
        limit = None if wanted.minutes is None else wanted.minutes + (0.0 if after is None else after.minutes)
        ordered = best_order(
            candidates.responses,
            candidates.ability,
            self.criterion,
            taken,
            minutes=limit,
            seed=wanted.seed,
            kind=wanted.order,
            after=after,
        )
        return ordered.schedule, ordered.value, ordered.drift_known

    def traded(self, count: int) -> Iterator[TradeOff]:
        """Plans for other numbers of positions, or other times."""
        cells, times = self.responses.cells, self.candidates.ability.times
        kept = np.searchsorted(self.cells, self.measured)
        model = one_visit(self.responses, kept)
        for share in _TRADED:
            minutes = None if self.wanted.minutes is None else share * self.wanted.minutes
            number = None if minutes is not None else round(share * count)
            try:
                taken = np.searchsorted(self.cells, self.chosen(count=number, minutes=minutes, restarts=1))
            except InputError:
                continue
            value = float(self.criterion.of(model.covariance(taken)))
            yield TradeOff(len(taken), schedule(cells, taken, times).minutes, value)


def _with_effects(rig: Rig, candidates: Candidates, plan: Evaluated, wanted: Wanted, entries: Catalogue) -> Evaluated:
    """A plan with its forecasts."""
    names = tuple(map(str, range(len(plan.schedule))))
    of = effects_of_plan(planned_rig(rig, candidates.responses, plan.schedule, candidates.ability, names), entries)
    limits = {id: detection_limit(of, id, 1, wanted.seed) for id in of.ids}
    effects = tuple(
        forecast_of_effect(of, id, size, limits[id], _DRAWS, wanted.seed) for id, size in wanted.effects.items()
    )
    return replace(plan, effects=effects, undetectable=tuple(id for id, limit in limits.items() if limit is None))


def _names(measured: Positions | None, count: int) -> tuple[str, ...]:
    """Names of all positions: those measured already, then numbers."""
    done = 0 if measured is None else len(measured)
    return (*(f"measured-{k + 1}" for k in range(done)), *(str(k + 1) for k in range(count - done)))
