"""The search of a plan: criteria, the choice of positions, their order, bounds, and the trade-off against time."""

from dataclasses import dataclass, replace

import numpy as np

from tumblecal.chain.rig import Rig
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted, shortened
from tumblecal.ground.option_texts import faults_of
from tumblecal.plan.bounds import Bounds, best_plan
from tumblecal.plan.candidates import Candidates
from tumblecal.plan.criterion import Combine, Criterion, in_use, of_parameters, weighted
from tumblecal.plan.exchange import Term, exchange
from tumblecal.plan.information import LinearModel, one_visit
from tumblecal.plan.limits import Limits, most_visits
from tumblecal.plan.order import Ordered, best_order
from tumblecal.plan.request import COVARIANCE, Wanted
from tumblecal.plan.responses import Responses


# Numbers of positions, or minutes, of further plans of the trade-off, relative to those of the plan.
_TRADED = (0.5, 0.7, 1.4, 2.0, 3.0)
# The numbers of these criteria.
_COMBINED: dict[str, Combine] = {"worst": "largest", "mean": "mean", "volume": "volume"}


@dataclass(frozen=True)
class TradeOff:
    """A point of the trade-off: number of positions, minutes, and the criterion with slow noise known."""

    positions: int
    minutes: float
    value: float


@dataclass(frozen=True)
class Found:
    """A plan that was searched.

    - `criterion`: of the covariance. `ordered`: the positions, those measured already first.
    - `bounds`: None if the positions are chosen by other criteria too. `traded`: the trade-off, by increasing time.
    """

    criterion: Criterion
    ordered: Ordered
    bounds: Bounds | None
    traded: tuple[TradeOff, ...]


def searched(rig: Rig, candidates: Candidates, wanted: Wanted, entries: Catalogue) -> Found:
    """The wanted plan among the positions of a head.

    **Raises:** `InputError` for a parameter or an effect that no plan on this head determines, and for limits that are too
    tight or contradict each other.
    """
    measured, (before, visits) = candidates.measured, candidates.before
    responses = candidates.responses.chosen(np.arange(candidates.of_head + len(measured)))
    model, limits = one_visit(responses, measured), _limits(candidates, responses, wanted)
    terms, criterion = _criteria(rig, candidates, responses, model, limits, wanted, entries)
    found = None
    if {*wanted.criteria} <= {*COVARIANCE}:
        most = [now + number for now, number in zip(most_visits(limits), visits, strict=True)]
        several = one_visit(responses, measured, most=most)
        chosen, found = best_plan(model, several, criterion, limits, restarts=wanted.restarts, seed=wanted.seed)
    else:
        chosen = exchange(limits, terms, restarts=wanted.restarts, seed=wanted.seed).cells
    _require_determined(rig, model, wanted, chosen)
    minutes = None if wanted.minutes is None else wanted.minutes + before
    settings = {"minutes": minutes, "seed": wanted.seed, "kind": wanted.order, "measured": measured}
    ordered = best_order(candidates.responses, candidates.ability, criterion, chosen, **settings)
    traded = [TradeOff(len(chosen), ordered.schedule.minutes - before, ordered.drift_known)]
    # Plans for other numbers of positions, or other times, improved from the plan.
    for share in _TRADED:
        other = (
            {"positions": round(share * len(chosen))} if minutes is None else {"minutes": share * (wanted.minutes or 0)}
        )
        try:
            others = _limits(candidates, responses, replace(wanted, **{"positions": None} | other))
        except InputError:
            continue
        taken = exchange(others, terms, restarts=0, seed=wanted.seed, starts=[chosen]).cells
        if not model.undetermined(taken):
            value = float(criterion.of(model.covariance(taken)))
            traded.append(TradeOff(len(taken), candidates.scheduled(taken).minutes, value))
    return Found(criterion, ordered, found, tuple(sorted(traded, key=lambda each: each.minutes)))


def _limits(candidates: Candidates, responses: Responses, wanted: Wanted) -> Limits:
    """The limits of a plan; cells are measured again only if there are too few.

    **Raises:** `InputError` if no position fits.
    """
    times, measured, number = candidates.ability.times, candidates.measured, np.arange(len(responses.cells))
    count = np.inf if wanted.count is None else wanted.count
    seconds = np.inf if wanted.minutes is None else 60 * wanted.minutes
    repeats = np.ceil(min(count, seconds / (times.dwell_s + times.settle_s)) / candidates.of_head)
    allowed, present = number < candidates.of_head, int(measured[-1]) if len(measured) else None
    limits = Limits(responses.cells, times, allowed, count, seconds, max(1, int(repeats)), present)
    if not np.any(limits.fits(0 * number)):
        least = (times.dwell_s + times.settle_s) / 60
        raise InputError(f"no position fits; one takes {least:.3g} min, in an allowed setting")
    return limits


def _criteria(
    rig: Rig,
    candidates: Candidates,
    responses: Responses,
    model: LinearModel,
    limits: Limits,
    wanted: Wanted,
    entries: Catalogue,
) -> tuple[list[Term], Criterion]:
    """Terms of all criteria, for the choice, and the criterion of the covariance, for order, bounds and comparison; of several
    criteria each is relative to its own optimum."""
    terms, of_covariance, parameters = dict[str, Term](), dict[str, Criterion](), wanted.parameters_of(responses)
    with faults_of(rig.source):
        for name in wanted.criteria:
            if name in _COMBINED:
                of_covariance[name] = of_parameters(_COMBINED[name], responses, parameters)
            elif name in COVARIANCE:
                of_covariance[name] = in_use(candidates.use, "mean" if name == "in_use" else "largest")
        first = next(iter(of_covariance.values()), None) or of_parameters("largest", responses, parameters)
    terms |= {name: Term(((model, one),)) for name, one in of_covariance.items()}
    if len(of_covariance) < len(wanted.criteria):
        from tumblecal.plan.effect_criteria import EffectsOfCells, alias_term, naming_term

        effects = EffectsOfCells(rig, responses, candidates.measured, entries, wanted.minutes or 60.0)
        for name, term_of in (("naming", naming_term), ("alias", alias_term)):
            terms |= {name: term_of(effects, wanted.effects)} if name in wanted.criteria else {}
    if len(terms) == 1:
        return list(terms.values()), first
    share = {
        name: wanted.criteria[name] / exchange(limits, [term], restarts=1, seed=wanted.seed).value
        for name, term in terms.items()
    }
    if len(of_covariance) > 1:
        whole = sum(wanted.criteria[name] for name in of_covariance)
        first = weighted(list(of_covariance.values()), [share[name] / whole for name in of_covariance])
    return [term._replace(weight=share[name]) for name, term in terms.items()], first


def _require_determined(rig: Rig, model: LinearModel, wanted: Wanted, chosen: np.ndarray) -> None:
    """Reject a plan with fewer positions than wanted, and one that does not determine parameters which more positions would."""
    positions, minutes, count = wanted.positions, wanted.minutes, len(chosen)
    if positions is not None and minutes is not None and count < positions:
        raise InputError(
            f"{rig.source}: --positions {positions} and --minutes {minutes:g} contradict each other: at most {count} "
            "positions fit; allow more time, or give one of the two"
        )
    hopeless = model.undetermined()
    missing = [name for name in model.undetermined(chosen) if name not in hopeless]
    if missing:
        limit = "--minutes" if positions is None else "--positions"
        limit += ", or more --parameters" if wanted.parameters else ""
        raise InputError(
            f"{rig.source}: {counted(count, 'position')} cannot determine {shortened(missing, 9)} "
            f"({len(model.names)} parameters and the errors of the settings); give a larger {limit}"
        )
