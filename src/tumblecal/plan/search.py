"""The search of a plan: criteria, the choice of positions, their order, bounds, and the trade-off against time."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from tumblecal.chain.rig import Rig
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import faults_of
from tumblecal.plan.bounds import Bounds, best_plan
from tumblecal.plan.candidates import Candidates
from tumblecal.plan.criterion import Combine, Criterion, in_use, of_parameters, weighted
from tumblecal.plan.effect_criteria import EffectsOfCells, alias_term, naming_term
from tumblecal.plan.exchange import Chosen, exchange
from tumblecal.plan.limits import Limits, limits_of, most_visits
from tumblecal.plan.linear_model import LinearModel, one_visit
from tumblecal.plan.order import Ordered, best_order
from tumblecal.plan.request import COVARIANCE, Wanted
from tumblecal.plan.responses import Responses
from tumblecal.plan.schedule import schedule
from tumblecal.plan.set_value import Term


# Numbers of positions, or minutes, of further plans of the trade-off, relative to those of the plan.
_TRADED = (0.5, 0.7, 1.4, 2.0, 3.0)


@dataclass(frozen=True)
class TradeOff:
    """A point of the trade-off: number of positions, minutes, and the criterion with slow noise known."""

    positions: int
    minutes: float
    value: float


@dataclass(frozen=True)
class Search:
    """A search among the positions of a head.

    - `responses`, `model`: of the cells of the head and of those measured already, the first ones of the candidates.
    - `terms`: of all criteria, for the choice. `criterion`: of the covariance, for order, bounds and comparison.
    """

    candidates: Candidates
    wanted: Wanted
    responses: Responses
    model: LinearModel
    terms: tuple[Term, ...]
    criterion: Criterion

    def best(self) -> tuple[Int[np.ndarray, " new"], Bounds | None]:
        """The new positions of the wanted plan; bounds of the criterion, or None if the positions are chosen by other criteria
        too."""
        wanted, done = self.wanted, self.candidates.done
        if set(wanted.criteria) - {*COVARIANCE}:
            return self.chosen(wanted.count, wanted.minutes, wanted.restarts).cells, None
        limits = self._limits(wanted.count, wanted.minutes)
        measured = 0 if done is None else 1 + int(done.pitch_visit[-1])
        pitch, mount = most_visits(limits)
        several = one_visit(self.responses, self.candidates.measured, most=(pitch + measured, mount + measured))
        found = best_plan(
            self.model, self.criterion, limits, restarts=wanted.restarts, seed=wanted.seed, several=several
        )
        return found[0].cells, found[1]

    def chosen(self, count: int | None, minutes: float | None, restarts: int) -> Chosen:
        """Good new positions and their value."""
        return exchange(self._limits(count, minutes), self.terms, restarts=restarts, seed=self.wanted.seed)

    def _limits(self, count: int | None, minutes: float | None) -> Limits:
        """The limits of a plan; cells are measured again only if there are too few.

        **Raises:** `InputError` if no position fits.
        """
        ability, cells, measured = self.candidates.ability, self.responses.cells, self.candidates.measured
        most = np.inf if minutes is None else 60 * minutes / (ability.times.dwell_s + ability.times.settle_s)
        most = most if count is None else min(most, count)
        return limits_of(
            cells,
            ability,
            count=count,
            minutes=minutes,
            allowed=np.arange(len(cells)) < self.candidates.of_head,
            repeats=max(1, int(np.ceil(most / self.candidates.of_head))),
            present=int(measured[-1]) if len(measured) else None,
        )

    def ordered(self, taken: Int[np.ndarray, " new"]) -> Ordered:
        """New positions in the wanted order, after those measured already."""
        wanted, candidates, done = self.wanted, self.candidates, self.candidates.done
        return best_order(
            candidates.responses,
            candidates.ability,
            self.criterion,
            taken,
            minutes=None if wanted.minutes is None else wanted.minutes + (0.0 if done is None else done.minutes),
            seed=wanted.seed,
            kind=wanted.order,
            after=done,
        )

    def traded(self, count: int) -> Iterator[TradeOff]:
        """Plans for other numbers of positions, or other times; `count`: number of the plan."""
        for share in _TRADED:
            minutes = None if self.wanted.minutes is None else share * self.wanted.minutes
            try:
                taken = self.chosen(round(share * count) if minutes is None else None, minutes, 1).cells
            except InputError:
                continue
            if not self.model.undetermined(taken):
                value = float(self.criterion.of(self.model.covariance(taken)))
                planned = schedule(self.responses.cells, taken, self.candidates.ability.times)
                yield TradeOff(len(taken), planned.minutes, value)


def search_of(rig: Rig, candidates: Candidates, wanted: Wanted, entries: Catalogue) -> Search:
    """The search of a wanted plan; of several criteria each is relative to its own optimum.

    **Raises:** `InputError` for a parameter or an effect that no plan on this head determines.
    """
    measured = candidates.measured
    responses = candidates.responses.chosen(np.arange(max(candidates.of_head, 1 + int(measured.max(initial=-1)))))
    model, parameters = one_visit(responses, measured), wanted.parameters_of(responses)
    with faults_of(rig.source):
        criteria = {
            name: _criterion(name, candidates, responses, parameters) for name in wanted.criteria if name in COVARIANCE
        }
    terms = {name: Term(((model, one),)) for name, one in criteria.items()}
    effects = EffectsOfCells(rig, responses, measured, entries, wanted.minutes or 60.0)
    if "naming" in wanted.criteria:
        terms["naming"] = naming_term(effects, wanted.effects)
    if "alias" in wanted.criteria:
        terms["alias"] = alias_term(effects, wanted.effects)
    first = next(iter(criteria.values()), None) or of_parameters("largest", responses, parameters)
    search = Search(candidates, wanted, responses, model, tuple(terms.values()), first)
    if len(terms) == 1:
        return search
    shares: Mapping[str, float] = {
        name: wanted.criteria[name] / replace(search, terms=(term,)).chosen(wanted.count, wanted.minutes, 1).value
        for name, term in terms.items()
    }
    whole = sum(wanted.criteria[name] for name in criteria) or 1.0
    if len(criteria) > 1:
        first = weighted(list(criteria.values()), [shares[name] / whole for name in criteria])
    every = tuple(Term(term.criteria, shares[name]) for name, term in terms.items())
    return replace(search, terms=every if len(criteria) < len(terms) else (Term(((model, first),)),), criterion=first)


def _criterion(
    name: str, candidates: Candidates, responses: Responses, parameters: tuple[str, ...] | None
) -> Criterion:
    """A criterion of the covariance by its name."""
    if name.startswith("in_use"):
        return in_use(candidates.use, "mean" if name == "in_use" else "largest")
    combine: dict[str, Combine] = {"worst": "largest", "mean": "mean", "volume": "volume"}
    return of_parameters(combine[name], responses, parameters)
