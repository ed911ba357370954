"""The design of a measurement: positions, order, uncertainties, forecast of the diagnosis, comparison with common practice."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted, shortened
from tumblecal.ground.option_texts import faults_of
from tumblecal.ground.precision import single_blas_thread
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC, soak_numbers
from tumblecal.plan.bound import best_plan
from tumblecal.plan.cells import Cells, Numbers, Positions, cells_of
from tumblecal.plan.common_plans import common_plans
from tumblecal.plan.criterion import Criterion, attitudes_in_use, in_use, of_parameters, weighted
from tumblecal.plan.designed_plan import DesignedPlan, Evaluated, Found, TradeOff
from tumblecal.plan.exchange import Term, exchange
from tumblecal.plan.information import one_visit, uncertainties
from tumblecal.plan.limits import Limits, Schedule, schedule
from tumblecal.plan.order import best_order
from tumblecal.plan.planned_rig import planned_rig
from tumblecal.plan.request import Wanted
from tumblecal.plan.responses import responses_of


# Numbers of positions, or minutes, of further plans of the trade-off, relative to those of the plan.
_TRADED = (0.5, 0.7, 1.4, 2.0, 3.0)


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
        return _Head(rig, ability, wanted, entries, common).designed()


class _Head:
    """A head with all positions of a design: those that it can measure, those measured already, those of plans to compare."""

    def __init__(
        self, rig: Rig, ability: HeadAbility, wanted: Wanted, entries: Catalogue, common: Sequence[Positions]
    ) -> None:
        self.rig, self.ability, self.wanted, self.entries, self.times = rig, ability, wanted, entries, ability.times
        there, of_head = rig.plan, cells_of(ability)
        listed = zip(there.alpha_deg, there.beta_deg, there.mounts, strict=True)
        present = Positions("plan of the rig file", "", Cells.listed(listed, there.temperature_degc))
        self.others = [wanted.measured or present, *common]
        parts = [of_head, *(_in_chamber(each.cells, ability) for each in self.others), attitudes_in_use(ability)]
        degc = (
            np.concatenate([np.asarray(part.temperature_degc) for part in parts]) if ability.temperatures_degc else None
        )
        try:
            every = responses_of(rig, Cells.listed(chain.from_iterable(part.rows for part in parts), degc))
        except InputError as error:
            if not (rig.effects or rig.temperature.leaves):
                raise
            raise InputError(
                f"{rig.source}: {str(error).removeprefix(f'{rig.source}: ')} (a plan is designed for settings without "
                "times): remove such effects from chain.effects, and state the temperatures of a chamber in [head] "
                "temperatures_degc"
            ) from error
        ends = np.cumsum([len(part) for part in parts])
        self.of_head, *self.once, used = np.split(np.arange(ends[-1]), ends[:-1])
        self.measured = self.once[0] if wanted.measured else self.of_head[:0]
        self.responses, self.use = every.chosen(np.arange(ends[-2])), every.chosen(used)
        # The cells of the search.
        self.some = every.chosen(np.arange(len(of_head) + len(self.measured)))
        self.model = one_visit(self.some, self.measured)
        # Duration of the positions that are measured already, min.
        self.before = self.scheduled(self.measured).minutes if len(self.measured) else 0.0

    def scheduled(self, order: Numbers) -> Schedule:
        """The schedule of some cells."""
        return schedule(self.responses.cells, order, self.times)

    def limits(self, positions: float | None, minutes: float | None) -> Limits:
        """The limits of a plan; cells are measured again only if there are too few.

        **Raises:** `InputError` if no position fits.
        """
        least = self.times.dwell_s + self.times.settle_s
        count, seconds = np.inf if positions is None else positions, np.inf if minutes is None else 60 * minutes
        repeats = max(1, int(np.ceil(min(count, seconds / least) / len(self.of_head))))
        allowed = np.arange(len(self.some.cells)) < len(self.of_head)
        present = int(self.measured[-1]) if len(self.measured) else None
        limits = Limits(self.some.cells, self.times, allowed, count, seconds, repeats, present)
        if not np.any(limits.fits([])):
            raise InputError(f"no position fits; one takes {least / 60:.3g} min, in an allowed setting")
        return limits

    def terms(self, limits: Limits) -> tuple[list[Term], Criterion]:
        """Terms of all criteria, for the choice, and the criterion of the covariance, for order, bounds and comparison. Each of
        several criteria is relative to its own optimum."""
        wanted, found = self.wanted, dict[str, Criterion]()
        parameters = wanted.parameters_of(self.some.names)
        with faults_of(self.rig.source):
            for name in wanted.criteria:
                if name in ("worst", "mean", "volume"):
                    found[name] = of_parameters("largest" if name == "worst" else name, self.some, parameters)
                elif name.startswith("in_use"):
                    found[name] = in_use(self.use, "mean" if name == "in_use" else "largest")
            first = next(iter(found.values()), None) or of_parameters("largest", self.some, parameters)
        terms = {name: Term(((self.model, one),)) for name, one in found.items()}
        if len(found) < len(wanted.criteria):
            from tumblecal.plan.effect_criteria import TERMS, effects_of_cells

            effects = effects_of_cells(self.rig, self.some.cells, self.entries, 60 * (wanted.minutes or 60.0))
            of_effects = {name: term for name, term in TERMS.items() if name in wanted.criteria}
            terms |= {
                name: term(effects, self.some, self.measured, wanted.effects) for name, term in of_effects.items()
            }
        if len(terms) == 1:
            return list(terms.values()), first
        share = {
            name: wanted.criteria[name] / exchange(limits, [term], restarts=1, seed=wanted.seed).value
            for name, term in terms.items()
        }
        if len(found) > 1:
            whole = sum(wanted.criteria[name] for name in found)
            first = weighted(list(found.values()), [share[name] / whole for name in found])
        return [term._replace(weight=share[name]) for name, term in terms.items()], first

    def found(self) -> Found:
        """The wanted plan.

        **Raises:** `InputError` for a parameter or an effect that no plan on this head determines, and for limits that are too
        tight or contradict each other.
        """
        wanted, model, minutes, bounds = self.wanted, self.model, self.wanted.minutes, None
        limits = self.limits(wanted.count, minutes)
        terms, criterion = self.terms(limits)
        restarts, seed = wanted.restarts, wanted.seed
        if {"naming", "alias"} & {*wanted.criteria}:
            chosen = np.array(exchange(limits, terms, restarts=restarts, seed=seed).cells)
        else:
            done = self.scheduled(self.measured) if len(self.measured) else None
            visits = (0, 0) if done is None else (1 + int(done.pitch_visit[-1]), 1 + int(done.mount_visit[-1]))
            most = [now + number for now, number in zip(limits.most_visits, visits, strict=True)]
            several = one_visit(self.some, self.measured, most=most)
            chosen, bounds = best_plan(model, several, criterion, limits, restarts=restarts, seed=seed)
        self._require_determined(chosen)
        allowed = None if minutes is None else minutes + self.before
        given = {"minutes": allowed, "seed": seed, "kind": wanted.order, "measured": self.measured}
        ordered = best_order(self.some, self.ability, criterion, chosen, **given)
        traded = [TradeOff(len(chosen), ordered.schedule.minutes - self.before, ordered.drift_known)]
        # Plans for other numbers of positions, or other times, improved from the plan.
        for share in _TRADED:
            try:
                other = (round(share * len(chosen)), None) if minutes is None else (None, share * minutes)
                within = self.limits(*other)
            except InputError:
                continue
            taken = exchange(within, terms, restarts=0, seed=seed, starts=[chosen]).cells
            if not model.undetermined(taken):
                value = float(criterion.of(model.covariance(taken)))
                traded.append(TradeOff(len(taken), self.scheduled(np.array(taken)).minutes, value))
        return Found(criterion, ordered, bounds, tuple(sorted(traded, key=lambda each: each.minutes)))

    def _require_determined(self, chosen: Numbers) -> None:
        """Reject a plan with fewer positions than wanted, and one that does not determine parameters that more would."""
        positions, minutes, count = self.wanted.positions, self.wanted.minutes, len(chosen)
        if positions is not None and minutes is not None and count < positions:
            raise InputError(
                f"{self.rig.source}: --positions {positions} and --minutes {minutes:g} contradict each other: at most {count} "
                "positions fit; allow more time, or give one of the two"
            )
        hopeless, names = self.model.undetermined(), self.model.names
        if missing := [name for name in self.model.undetermined(chosen) if name not in hopeless]:
            limit = "--minutes" if positions is None else "--positions"
            limit += ", or more --parameters" if self.wanted.parameters else ""
            raise InputError(
                f"{self.rig.source}: {counted(count, 'position')} cannot determine {shortened(missing, 9)} "
                f"({len(names)} parameters and the errors of the settings); give a larger {limit}"
            )

    def in_time(self, once: Numbers, limit_s: float) -> Schedule:
        """Positions of each mounting and temperature repeated, without remounting, until the time is used: the last mounting
        gets the rest."""
        blocks = np.split(once, 1 + np.flatnonzero(np.diff(self.responses.cells.sitting[once])))
        passes = 1

        def repeated(passes: int, of_last: int = 0) -> Schedule:
            last = np.tile(blocks[-1], of_last)
            return self.scheduled(np.concatenate([*(np.tile(block, passes) for block in blocks), last]))

        while repeated(passes + 1).end_s <= limit_s:
            passes += 1
        longer = repeated(passes, passes + len(once))
        count = np.count_nonzero(longer.start_s + self.times.dwell_s <= limit_s)
        return self.scheduled(longer.cells[: max(count, passes * len(once))])

    def designed(self) -> DesignedPlan:
        """The plan of the request, and plans to compare."""
        found, wanted = self.found(), self.wanted
        planned, done = found.ordered.schedule, len(self.measured)
        limit_s = float(planned.end_s) + 1e-6
        names = (*(f"measured-{k + 1}" for k in range(done)), *map(str, range(1, 1 + len(planned) - done)))
        schedules = [planned, self.scheduled(self.once[0]), *(self.in_time(one, limit_s) for one in self.once[1:])]
        listed = [Positions("this plan", "", self.responses.cells.chosen(planned.cells)), *self.others]
        rigs = [planned_rig(self.rig, self.responses, planned, self.ability, names, wanted.seed)]
        forecast, effects = None, list[dict[str, Any]]([{}] * len(listed))
        if wanted.forecast:
            from tumblecal.plan.forecast.naming import forecasts

            for each in schedules[1:]:
                numbers = tuple(map(str, range(len(each))))
                rigs.append(planned_rig(self.rig, self.responses, each, self.ability, numbers))
            forecast, others = forecasts(rigs[0], rigs[1:], self.entries, wanted.effects, wanted.seed)
            own = forecast.effects, forecast.undetectable
            effects = [{"effects": one, "undetectable": other} for one, other in (own, *others)]
        every = [uncertainties(self.responses, each, self.ability) for each in schedules]
        after, before, *practice = (
            Evaluated(
                positions,
                each,
                own,
                np.sqrt(np.vecdot(self.use.columns @ own.covariance, self.use.columns)),
                fits=bool(each.end_s <= limit_s) or positions is self.others[0],
                compared=every[0].determined,
                **more,
            )
            for positions, each, own, more in zip(listed, schedules, every, effects, strict=True)
        )
        plans = after, before, tuple(practice)
        return DesignedPlan(rigs[0], self.ability, wanted, self.responses, names, done, found, *plans, forecast)


def _in_chamber(cells: Cells, ability: HeadAbility) -> Cells:
    """Cells at the temperatures of the chamber: the mean of each soak, or the temperature of the chamber that it is equal to;
    its middle one if no temperature is stated."""
    chamber, degc = np.array(ability.temperatures_degc), cells.temperature_degc
    if not len(chamber):
        return replace(cells, temperature_degc=None)
    if degc is None:
        return replace(cells, temperature_degc=np.full(len(cells), float(np.median(chamber))))
    if (number := soak_numbers(degc)) is not None:
        degc = (np.bincount(number, degc) / np.bincount(number))[number]
    nearest = chamber[np.argmin(np.abs(degc[:, None] - chamber), axis=1)]
    return replace(cells, temperature_degc=np.where(np.abs(degc - nearest) <= ONE_TEMPERATURE_DEGC, nearest, degc))
