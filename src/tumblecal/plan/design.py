"""The design of a measurement: positions, order, uncertainties, forecast of the diagnosis, comparison with common practice."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.nominal import UNIT_OF_LEAF, unit_of_parameter
from tumblecal.chain.rig import Rig
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.counted import counted, shortened
from tumblecal.ground.errors import InputError
from tumblecal.ground.record import rows, table
from tumblecal.plan.bounds import Bounds
from tumblecal.plan.candidates import Candidates, Evaluated, candidates_of
from tumblecal.plan.cells import Cells, cells_of
from tumblecal.plan.common_plans import Positions, common_plans
from tumblecal.plan.criterion import Criterion
from tumblecal.plan.forecast.effects_of_plan import EffectsOfPlan, effects_of_plan
from tumblecal.plan.forecast.naming import (
    NamingForecast,
    detectable,
    detection_limit,
    forecast,
    forecast_of_effect,
)
from tumblecal.plan.order import Ordered
from tumblecal.plan.planned_rig import planned_rig
from tumblecal.plan.request import Wanted, rig_positions
from tumblecal.plan.responses import Responses
from tumblecal.plan.schedule import schedule
from tumblecal.plan.search import Search, TradeOff, search_of


# Draws for each effect of a plan that is compared.
_DRAWS = 200


@dataclass(frozen=True)
class DesignedPlan:
    """A designed plan.

    - `rig`: with the positions of the plan. `ability`: of the head. `wanted`: the request.
    - `responses`: of all cells. `names`: of the positions of `after.schedule`; `measured`: so many are measured already.
    - `criterion`: of the covariance. `ordered`: the schedule with its value, also if the slow noise were known. `bounds`: of
      plans under white noise, if the criteria are those of the covariance.
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
    criterion: Criterion
    ordered: Ordered
    bounds: Bounds | None
    after: Evaluated
    before: Evaluated
    practice: tuple[Evaluated, ...]
    traded: tuple[TradeOff, ...]
    forecast: NamingForecast | None

    @cached_property
    def cells(self) -> Cells:
        """The cells of all positions, in measuring order."""
        return self.responses.cells.chosen(self.after.schedule.cells)

    @cached_property
    def positions(self) -> list[dict[str, Any]]:
        """Name, angles, mounting and temperature of each position, in measuring order, as in files."""
        degc, cells = self.cells.temperature_degc, self.cells
        columns = {"name": self.names, "alpha_deg": cells.alpha_deg, "beta_deg": cells.beta_deg, "mount": cells.mounts}
        columns |= {} if degc is None else {"temperature_degc": degc}
        rounded = {
            name: np.round(each, 9).tolist() if isinstance(each, np.ndarray) else each for name, each in columns.items()
        }
        return rows(**rounded)

    @property
    def scheduled(self) -> list[dict[str, Any]]:
        """The positions with the start of each dwell (s), and whether they are measured already."""
        times = rows(start_s=self.after.schedule.start_s, measured=np.arange(len(self.names)) < self.measured)
        return [position | time for position, time in zip(self.positions, times, strict=True)]

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Standard uncertainty with the plan (`u`) and without (`u_before`), and base unit, of each shared parameter."""
        before, after = self.before.uncertainties.sd.tolist(), self.after.uncertainties
        units = [unit_of_parameter(name, UNIT_OF_LEAF) or "1" for name in after.names]
        return table(after.names, u=after.sd.tolist(), u_before=before, unit=units)

    def ratio(self, other: Evaluated) -> float:
        """The largest standard uncertainty of another plan, relative to that of this plan."""
        scale_of = dict(zip(self.after.uncertainties.names, self.after.uncertainties.scales.tolist(), strict=True))
        worst, own = (plan.worst.u / scale_of[plan.worst.parameter] for plan in (other, self.after))
        return worst / own

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
    if "free_attitude" in rig.links:
        raise InputError(
            f"{rig.source}: chain.links: free_attitude: a plan is for a head with known angles; remove this link"
        )
    wanted.check_size(ability.times)
    common = (*common_plans(ability, rig.mounts, wanted.seed), *wanted.compared)
    if ability.temperatures_degc:
        # Functions of temperature are those over the range of the chamber, whichever temperatures the plan visits.
        rig = replace(rig, temperature=rig.temperature.stated_for(cells_of(ability).where))
        common = tuple(
            each.at_each(ability.temperatures_degc) if each.temperature_degc is None else each for each in common
        )
        if wanted.measured is not None and wanted.measured.temperature_degc is None:
            raise InputError(
                f"{wanted.measured.name}: no temperature_degc, but {rig.source} has a chamber ([head] temperatures_degc); "
                "add the temperature of each position"
            )
    others = {"rig": rig_positions(rig)} | {f"practice {k}": each for k, each in enumerate(common)}
    candidates = candidates_of(rig, ability, wanted.measured, others)
    search = search_of(rig, candidates, wanted, entries)
    taken, limit = search.best()
    _require_determined(rig, search, taken)
    ordered = search.ordered(taken)
    planned, done = ordered.schedule, candidates.done
    names = (
        *(f"measured-{k + 1}" for k in range(len(candidates.measured))),
        *(str(k + 1) for k in range(len(planned) - len(candidates.measured))),
    )
    after = candidates.evaluated(Positions("this plan", "", (), (), ()), planned)
    before = candidates.evaluated(
        wanted.measured or others["rig"],
        done or schedule(candidates.responses.cells, candidates.numbers["rig"], ability.times),
    )
    practice = [
        candidates.in_time(positions, candidates.numbers[f"practice {k}"], planned.minutes)
        for k, positions in enumerate(common)
    ]
    minutes = planned.minutes - (0.0 if done is None else done.minutes)
    traded = [TradeOff(len(taken), minutes, ordered.drift_known), *search.traded(len(taken))]
    made, predicted = planned_rig(rig, candidates.responses, planned, ability, names, wanted.seed), None
    if wanted.forecast:
        of = effects_of_plan(made, entries)
        predicted = forecast(made, of, wanted.effects, seed=wanted.seed)
        after = replace(after, effects=predicted.effects, undetectable=predicted.undetectable)
        before, *practice = (_with_effects(rig, candidates, each, wanted, of) for each in (before, *practice))
    found = after.uncertainties
    determined = tuple(name for name in found.names if name not in found.undetermined)
    after, before, *practice = (replace(each, compared=determined) for each in (after, before, *practice))
    return DesignedPlan(
        rig=made,
        ability=ability,
        wanted=wanted,
        responses=candidates.responses,
        names=names,
        measured=len(candidates.measured),
        criterion=search.criterion,
        ordered=ordered,
        bounds=limit,
        after=after,
        before=before,
        practice=tuple(practice),
        traded=tuple(sorted(traded, key=lambda each: each.minutes)),
        forecast=predicted,
    )


def _require_determined(rig: Rig, search: Search, taken: Int[np.ndarray, " new"]) -> None:
    """Reject a plan with fewer positions than wanted, and one that does not determine parameters which more positions would.

    **Raises:** `InputError` with these parameters.
    """
    positions, minutes = search.wanted.positions, search.wanted.minutes
    if positions is not None and minutes is not None and len(taken) < positions:
        raise InputError(
            f"{rig.source}: --positions {positions} and --minutes {minutes:g} contradict each other: at most {len(taken)} "
            "positions fit; allow more time, or give one of the two"
        )
    hopeless = search.model.undetermined()
    missing = [name for name in search.model.undetermined(taken) if name not in hopeless]
    if missing:
        limit = "--minutes" if positions is None else "--positions"
        limit += ", or more --parameters" if search.wanted.parameters else ""
        raise InputError(
            f"{rig.source}: {counted(len(taken), 'position')} cannot determine {shortened(missing, 9)} "
            f"({len(search.model.names)} parameters and the errors of the settings); give a larger {limit}"
        )


def _with_effects(rig: Rig, candidates: Candidates, plan: Evaluated, wanted: Wanted, like: EffectsOfPlan) -> Evaluated:
    """A plan with its forecasts; `like`: the effects of the designed plan."""
    names = tuple(map(str, range(len(plan.schedule))))
    made = planned_rig(rig, candidates.responses, plan.schedule, candidates.ability, names)
    of = effects_of_plan(made, like.entries, like.model)
    effects = tuple(
        forecast_of_effect(of, id, size, detection_limit(of, id, 1, wanted.seed), _DRAWS, wanted.seed)
        for id, size in wanted.effects.items()
    )
    return replace(plan, effects=effects, undetectable=tuple(id for id in of.ids if not detectable(of, id)))
