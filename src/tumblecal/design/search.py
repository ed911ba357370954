"""The search of a plan: criteria, the choice of positions, their order, bounds, and the trade-off against time."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.chain.rig import Rig
from tumblecal.design.candidates import Candidates
from tumblecal.design.criteria.combined_measures import weighted_measures
from tumblecal.design.criteria.criterion import Criterion, in_use, mean, volume, worst
from tumblecal.design.criteria.measure import Measures, measures
from tumblecal.design.criteria.naming_measures import alias_measures, naming_measures
from tumblecal.design.criteria.weighted import Weighted
from tumblecal.design.model.limits import Limits, limits_of, most_visits
from tumblecal.design.model.one_visit import OneVisit, one_visit
from tumblecal.design.model.responses import Responses
from tumblecal.design.model.schedule import Schedule, schedule
from tumblecal.design.order.best_order import Ordered, best_order
from tumblecal.design.positions.bounded_search import best_plan
from tumblecal.design.positions.bounds import Bounds
from tumblecal.design.positions.exchange import exchange
from tumblecal.design.wanted import COVARIANCE, Wanted
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import faults_of


# Numbers of positions, or minutes, of further plans of the trade-off, relative to those of the plan.
_TRADED = (0.5, 0.7, 1.4, 2.0, 3.0)


class TradeOff(NamedTuple):
    """A point of the trade-off: number of positions, minutes, and the criterion with slow noise known."""

    positions: int
    minutes: float
    value: float


@dataclass(frozen=True)
class Search:
    """A search among the positions of a head.

    - `cells`: numbers, among the candidates, of the cells that the search is about. `responses`, `model`: of these. `allowed`:
      those that may be chosen. `kept`: positions that are measured already, numbers among these cells.
    - `criterion`: of the covariance, for order, bounds and comparison. `factory`: measures of all criteria, for the choice.
    """

    candidates: Candidates
    wanted: Wanted
    cells: Int[np.ndarray, " cells"]
    responses: Responses
    model: OneVisit
    allowed: Bool[np.ndarray, " cells"]
    kept: Int[np.ndarray, " measured"]
    criterion: Criterion | Weighted
    factory: Measures

    @classmethod
    def of(cls, rig: Rig, candidates: Candidates, wanted: Wanted, entries: Catalogue) -> "Search":
        """The search of a wanted plan.

        **Raises:** `InputError` for a parameter or an effect that no plan on this head determines.
        """
        cells, allowed = candidates.choices(candidates.measured)
        responses, kept = candidates.responses.chosen(cells), np.searchsorted(cells, candidates.measured)
        model = one_visit(responses, kept)
        made = partial(cls, candidates, wanted, cells, responses, model, allowed, kept)
        parameters = wanted.parameters_of(responses)
        builders = {
            "worst": lambda: worst(responses, parameters),
            "mean": lambda: mean(responses, parameters),
            "volume": lambda: volume(responses, parameters),
            "in_use": lambda: in_use(candidates.use, "average"),
            "in_use_largest": lambda: in_use(candidates.use, "largest"),
        }
        with faults_of(rig.source):
            criteria = {name: builders[name]() for name in COVARIANCE if name in wanted.criteria}
        factories = {name: measures(model, each) for name, each in criteria.items()}
        minutes = wanted.minutes or 60.0
        if "naming" in wanted.criteria:
            factories["naming"] = naming_measures(rig, responses, kept, wanted.effects, entries, minutes)
        if "alias" in wanted.criteria:
            factories["alias"] = alias_measures(rig, responses, kept, wanted.effects, entries, minutes)
        first = next(iter(criteria.values()), None) or worst(responses, parameters)
        if len(factories) == 1:
            return made(first, next(iter(factories.values())))
        # Each relative to its own optimum.
        alone = {
            name: made(first, factory).chosen(wanted.count, wanted.minutes, 1)[1] for name, factory in factories.items()
        }
        names = tuple(criteria)
        if len(criteria) > 1:
            first = Weighted(
                tuple(criteria.values()),
                tuple(wanted.criteria[name] for name in names),
                tuple(alone[name] for name in names),
            )
        if len(criteria) == len(factories):
            return made(first, measures(model, first))
        shares = [wanted.criteria[name] / alone[name] for name in factories]
        return made(first, weighted_measures(list(factories.values()), shares))

    def best(self) -> tuple[Int[np.ndarray, " new"], Bounds | None]:
        """The new positions of the wanted plan, numbers among the cells of the search; bounds of the criterion, or None if the
        positions are chosen by other criteria too."""
        wanted = self.wanted
        if set(wanted.criteria) - {*COVARIANCE}:
            return self.chosen(wanted.count, wanted.minutes, wanted.restarts)[0], None
        limits = self._limits(wanted.count, wanted.minutes)
        measured = 0 if self._done is None else 1 + int(self._done.pitch_visit[-1])
        visits = most_visits(limits)
        several = one_visit(self.responses, self.kept, visits=(visits[0] + measured, visits[1] + measured))
        found = best_plan(
            self.model, self.criterion, limits, restarts=wanted.restarts, seed=wanted.seed, several=several
        )
        return found.chosen.cells, found.bounds

    def chosen(self, count: int | None, minutes: float | None, restarts: int) -> tuple[Int[np.ndarray, " new"], float]:
        """Good new positions, numbers among the cells of the search, and their value."""
        found = exchange(self._limits(count, minutes), self.factory, restarts=restarts, seed=self.wanted.seed)
        return found.cells, found.value

    def _limits(self, count: int | None, minutes: float | None) -> Limits:
        """The limits of a plan; cells are measured again only if there are too few.

        **Raises:** `InputError` if no position fits.
        """
        ability, allowed = self.candidates.ability, self.allowed
        most = np.inf if minutes is None else 60 * minutes / (ability.times.dwell_s + ability.times.settle_s)
        most = most if count is None else min(most, count)
        repeats = max(1, int(np.ceil(most / np.sum(allowed))))
        cells = self.responses.cells
        last = int(self.kept[-1]) if len(self.kept) else None
        return limits_of(cells, ability, count=count, minutes=minutes, allowed=allowed, repeats=repeats, present=last)

    def ordered(self, taken: Int[np.ndarray, " new"]) -> Ordered:
        """New positions in the wanted order, after those measured already; the schedule has the numbers of the candidates."""
        wanted, candidates = self.wanted, self.candidates
        done = self._done
        return best_order(
            candidates.responses,
            candidates.ability,
            self.criterion,
            self.cells[taken],
            minutes=None if wanted.minutes is None else wanted.minutes + self.done_minutes,
            seed=wanted.seed,
            kind=wanted.order,
            after=done,
        )

    @property
    def _done(self) -> Schedule | None:
        """The schedule of the positions that are measured already."""
        candidates = self.candidates
        if not len(self.kept):
            return None
        return schedule(candidates.responses.cells, candidates.measured, candidates.ability.times)

    @property
    def done_minutes(self) -> float:
        """Its duration."""
        return 0.0 if self._done is None else self._done.minutes

    def traded(self, count: int) -> Iterator[TradeOff]:
        """Plans for other numbers of positions, or other times; `count`: number of the plan."""
        cells, times = self.responses.cells, self.candidates.ability.times
        for share in _TRADED:
            minutes = None if self.wanted.minutes is None else share * self.wanted.minutes
            number = None if minutes is not None else round(share * count)
            try:
                taken, _ = self.chosen(number, minutes, 1)
            except InputError:
                continue
            if not self.model.undetermined(taken):
                value = float(self.criterion.of(self.model.covariance(taken)))
                yield TradeOff(len(taken), schedule(cells, taken, times).minutes, value)
