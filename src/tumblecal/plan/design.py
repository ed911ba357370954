"""The design of a measurement: positions, order, uncertainties, forecast of the diagnosis, comparison with common practice."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.nominal import UNIT_OF_LEAF, unit_of_parameter
from tumblecal.chain.rig import Rig
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.errors import InputError
from tumblecal.ground.precision import single_blas_thread
from tumblecal.ground.record import rows, table
from tumblecal.plan.candidates import Evaluated, candidates_of
from tumblecal.plan.cells import Cells, Positions, cells_of
from tumblecal.plan.common_plans import common_plans
from tumblecal.plan.forecast.record import NamingForecast
from tumblecal.plan.planned_rig import planned_rig
from tumblecal.plan.request import Wanted
from tumblecal.plan.responses import Responses
from tumblecal.plan.search import Found, searched


@dataclass(frozen=True)
class DesignedPlan:
    """A designed plan.

    - `rig`: with the positions of the plan. `ability`: of the head. `wanted`: the request.
    - `responses`: of all cells. `names`: of the positions of `after.schedule`; `measured`: so many are measured already.
    - `found`: criterion, order, bounds and trade-off.
    - `after`: the plan. `before`: the positions that are measured already, otherwise the plan of the rig file.
    - `practice`: common practice, and plans to compare, in the same time.
    - `forecast`: of the diagnosis.
    """

    rig: Rig
    ability: HeadAbility
    wanted: Wanted
    responses: Responses
    names: tuple[str, ...]
    measured: int
    found: Found
    after: Evaluated
    before: Evaluated
    practice: tuple[Evaluated, ...]
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
    if degc := ability.temperatures_degc:
        # Functions of temperature are those over the range of the chamber, whichever temperatures the plan visits.
        rig = replace(rig, temperature=rig.temperature.stated_for(cells_of(ability).where))
        common = tuple(each.at_each(degc) if each.cells.temperature_degc is None else each for each in common)
        if wanted.measured is not None and wanted.measured.cells.temperature_degc is None:
            raise InputError(
                f"{wanted.measured.name}: no temperature_degc, but {rig.source} has a chamber ([head] temperatures_degc); "
                "add the temperature of each position"
            )
    with single_blas_thread():
        return _designed(rig, wanted, entries, ability, common)


def _designed(
    rig: Rig, wanted: Wanted, entries: Catalogue, ability: HeadAbility, common: tuple[Positions, ...]
) -> DesignedPlan:
    """The plan of a request that is checked, and plans to compare."""
    there = rig.plan
    rows = list(zip(there.alpha_deg, there.beta_deg, there.mounts, strict=True))
    present = Positions("plan of the rig file", "", Cells.listed(rows, there.temperature_degc))
    candidates = candidates_of(rig, ability, wanted.measured, [present, *common])
    found = searched(rig, candidates, wanted, entries)
    planned, measured = found.ordered.schedule, candidates.measured
    new = range(1, 1 + len(planned) - len(measured))
    names = (*(f"measured-{k + 1}" for k in range(len(measured))), *map(str, new))
    before = candidates.scheduled(measured if len(measured) else candidates.others[0])
    after = candidates.evaluated(Positions("this plan", "", candidates.responses.cells.chosen(planned.cells)), planned)
    others = [candidates.evaluated(wanted.measured or present, before)]
    for positions, once in zip(common, candidates.others[1:], strict=True):
        others.append(candidates.in_time(positions, once, planned.minutes))
    made, predicted = planned_rig(rig, candidates.responses, planned, ability, names, wanted.seed), None
    if wanted.forecast:
        from tumblecal.plan.forecast.naming import forecasts

        rigs = [
            planned_rig(rig, candidates.responses, each.schedule, ability, tuple(map(str, range(len(each.schedule)))))
            for each in others
        ]
        predicted, compared = forecasts(made, rigs, entries, wanted.effects, wanted.seed)
        after = replace(after, effects=predicted.effects, undetectable=predicted.undetectable)
        others = [
            replace(each, effects=effects, undetectable=undetectable)
            for each, (effects, undetectable) in zip(others, compared, strict=True)
        ]
    after, *others = (replace(each, compared=after.uncertainties.determined) for each in (after, *others))
    return DesignedPlan(
        rig=made,
        ability=ability,
        wanted=wanted,
        responses=candidates.responses,
        names=names,
        measured=len(measured),
        found=found,
        after=after,
        before=others[0],
        practice=tuple(others[1:]),
        forecast=predicted,
    )
