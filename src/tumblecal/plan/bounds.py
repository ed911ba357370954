"""The least value of a criterion that any plan within limits can have under white noise, and the reason for the distance to it.

The logarithm of a criterion is convex in the information, so its tangent at any mixture of plans is a bound of every plan:

    log(value of a plan) >= log(value of the mixture) + gains of its positions - gains of the positions of the plan

The gains of a plan are at most those of the best positions in the best pitch settings. Plans are divided into classes, each
with a number of pitch settings and the number of positions that then fit; a class with a low bound gets a mixture of its own.
Settings are visited once each. A second visit of a setting is of use if its error is drawn again (`[head.repeatability]`): the
same bound in the model of several visits (`one_visit`) is one for every plan.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from tumblecal.plan.criterion import Criterion
from tumblecal.plan.exchange import Chosen, exchange
from tumblecal.plan.limits import Limits
from tumblecal.plan.linear_model import LinearModel, shared_covariance
from tumblecal.plan.set_value import Term


# An efficiency that needs no reason; classes above the next one are not searched, and those above the last one not divided.
GOOD, _CLOSE, _DIVIDED = 0.95, 0.995, 0.975
# Sets of mountings and temperatures are listed up to this number; more are bounded by their size.
_LISTED = 127
_SEARCHES, _MIXED, _PATIENCE, _BISECTIONS = 100, 120, 10, 30
# Power of the mean that replaces the largest variance; duality gap of a mixture; least share of a plan in it.
_POWER, _GAP, _LEAST = 64.0, 1e-3, 1e-4
# Share of all cells together in every mixture.
_FLOOR = 3e-4
# A pitch setting is used, or not, if the fraction is this close to 1 or 0.
_WHOLE = 0.02
# A plan this close to its bound is not searched further; the most promising classes are searched in each round.
_ENOUGH, _ROUNDS, _CLASSES = 0.99, 3, 4


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of a criterion under white noise.

    - `white`: of every plan within the limits that visits each setting once. `own`: of such plans with the number of positions
      of this plan, in its settings. `repeated`: of every plan within the limits, with any number of visits.
    - `value`: of the plan. `rounded`: whole positions near the best mixtures of the classes in which a better plan is not
      excluded, the most promising class first.
    - `reason`: for the distance to the bound.
    """

    white: float
    own: float
    value: float
    rounded: tuple[Int[np.ndarray, " positions"], ...]
    reason: str
    repeated: float

    @property
    def efficiency(self) -> float:
        """Bound of plans that visit each setting once, over value."""
        return self.white / self.value


class Class(NamedTuple):
    """Plans with at most so many positions at so many pitch settings, in some cells; all use the settings `used`."""

    cells: Int[np.ndarray, " allowed"]
    groups: int
    positions: int
    used: tuple[int, ...] = ()


class Mixture(NamedTuple):
    """Fractions of positions in each cell, and the tangent there: `level` minus the `gain` of the positions of a plan."""

    fractions: Float[np.ndarray, " cells"]
    level: float
    gain: Float[np.ndarray, " cells"]


def best_plan(
    model: LinearModel,
    criterion: Criterion,
    limits: Limits,
    *,
    restarts: int = 2,
    seed: int = 0,
    several: LinearModel | None = None,
) -> tuple[Chosen, Bounds]:
    """Exchange, then bounds; then exchange from the rounded mixtures of the classes of plans that the bounds do not exclude.

    **Arguments:**

    - `model`: of the cells, with positions that are measured already. `several`: of several visits of the settings, for the
      bound of any plan; None: not computed.
    """
    terms = [Term(((model, criterion),))]
    chosen = exchange(limits, terms, restarts=restarts, seed=seed)
    found = bounds(model, criterion, limits, chosen.cells)
    for number in range(1, _ROUNDS + 1):
        if found.efficiency >= _ENOUGH or not found.rounded:
            break
        # A plan far from its bound gets new random starts too.
        far = found.efficiency < GOOD
        starts = found.rounded[:_CLASSES]
        other = exchange(limits, terms, restarts=restarts if far else 0, seed=seed + number, starts=starts)
        if other.value < chosen.value * (1 - 1e-6):
            chosen, found = other, bounds(model, criterion, limits, other.cells)
        elif not far:
            break
    if several is not None:
        found = replace(found, repeated=min(bounds(several, criterion, limits, chosen.cells).white, found.white))
    return chosen, found


def bounds(model: LinearModel, criterion: Criterion, limits: Limits, chosen: Sequence[int] | np.ndarray) -> Bounds:
    """Bounds for the best plan within limits; `chosen`: cells of a good one."""
    value, group = float(criterion.of(model.covariance(chosen))), limits.cells.group
    plan = np.bincount(np.asarray(chosen, int), minlength=len(group))
    classes, searched, tangents = _classes(limits), dict[int, Mixture](), list[Mixture]()
    log_bound, tried = np.full(len(classes), -np.inf), [0] * len(classes)
    while len(searched) < _SEARCHES:
        at = int(np.argmin(log_bound))
        if log_bound[at] >= np.log((_DIVIDED if at in searched else _CLOSE) * value):
            break
        if tried[at] < len(tangents):
            tangent = tangents[tried[at]]
            log_bound[at] = max(log_bound[at], tangent.level - _most(limits, classes[at], tangent.gain)[0])
            tried[at] += 1
        elif at not in searched:
            searched[at] = mixture(model, criterion, limits, classes[at], plan, np.log(_CLOSE * value))
            tangents.append(searched[at])
        elif limits.timed and (parts := _divided(limits, classes[at], searched[at].fractions)):
            classes, tried = classes + parts, tried + [len(tangents)] * len(parts)
            log_bound = np.append(log_bound, np.full(len(parts), log_bound[at]))
            log_bound[at] = np.inf
        else:
            break
    at = int(np.argmin(log_bound))
    settings = np.unique(group[plan > 0])
    mine = Class(np.flatnonzero(limits.allowed & np.isin(group, settings)), len(settings), int(plan.sum()))
    inside = mixture(model, criterion, limits, mine, plan, np.log(value))
    white = min(float(np.exp(log_bound[at])), value)
    own = min(max(float(np.exp(inside.level - _most(limits, mine, inside.gain)[0])), white), value)
    better = [k for k in np.argsort(log_bound, kind="stable") if k in searched and log_bound[k] < np.log(value) - 1e-3]
    rounded = tuple(_rounded(limits, classes[k], searched[k].fractions) for k in better)
    reason = ""
    if white < GOOD * value:
        lost = [name for name in model.undetermined(chosen) if name not in model.undetermined()]
        reason = _reason(limits, classes[at], mine, white / value, own / value, lost)
    return Bounds(white, own, value, rounded, reason, white)


def mixture(
    model: LinearModel, criterion: Criterion, limits: Limits, one: Class, plan: np.ndarray, enough: float
) -> Mixture:
    """The mixture of plans of a class whose tangent gives the highest bound, until that reaches the logarithm `enough`.

    Plans that reduce the criterion most are added to the mixture one by one (simplicial decomposition: von Hohenbalken 1977,
    Mathematical Programming 13, 49).
    """
    smooth, shared = criterion.smooth(_POWER), len(model.names)
    flat, floor = model.columns.reshape(-1, model.columns.shape[2]), np.zeros(len(plan))
    floor[one.cells] = one.positions / len(one.cells)

    def at(fractions: np.ndarray) -> tuple[float, Mixture]:
        # A little of every cell: only then do gains include that the error of a pitch setting has to be determined too.
        fractions = (1 - _FLOOR) * fractions + _FLOOR * floor
        information = model.information + (flat * np.repeat(fractions, 3)[:, None]).T @ flat
        covariance = shared_covariance(information, len(information))
        value, root = smooth.support(covariance[:shared, :shared])
        gain = np.sum((flat @ (covariance[:, :shared] @ root)).reshape(len(fractions), -1) ** 2, axis=1)
        log_value = float(np.log(smooth.of(covariance[:shared, :shared])))
        return log_value, Mixture(fractions, float(np.log(value) + gain @ fractions), gain)

    def of_shares(shares: np.ndarray, plans: np.ndarray) -> tuple[float, np.ndarray]:
        log_value, found = at(shares @ plans)
        return log_value, -(1 - _FLOOR) * plans @ found.gain

    settings = np.union1d(limits.cells.group[plan > 0], one.used)
    within = (
        np.all(np.isin(np.flatnonzero(plan), one.cells)) and plan.sum() <= one.positions and len(settings) <= one.groups
    )
    size = np.zeros(len(plan))
    size[one.cells] = np.sum(model.columns[one.cells][:, :, :shared] ** 2, axis=(1, 2))
    plans = np.array([*([plan] if within else []), _most(limits, one, size)[1]], float)
    shares, best, since = np.full(len(plans), 1 / len(plans)), (-np.inf, Mixture(plans[0], -np.inf, size)), 0
    for _ in range(_MIXED):
        if len(shares) > 1:
            solved = minimize(
                of_shares,
                shares,
                args=(plans,),
                jac=True,
                method="SLSQP",
                bounds=[(0, 1)] * len(shares),
                constraints={"type": "eq", "fun": lambda s: s.sum() - 1, "jac": np.ones_like},
                options={"maxiter": 25, "ftol": 1e-7},
            )
            shares = np.maximum(solved.x, 0) / np.maximum(solved.x, 0).sum()
        log_value, here = at(shares @ plans)
        most, added = _most(limits, one, here.gain)
        since = 0 if here.level - most > best[0] + 1e-5 else since + 1
        best = max(best, (here.level - most, here), key=lambda found: found[0])
        if best[0] >= enough or log_value - best[0] < _GAP or since > _PATIENCE:
            break
        kept = shares > _LEAST
        plans = np.concatenate([plans[kept], added[None]])
        shares = np.append(0.9 * shares[kept], 0.1) / (0.9 * shares[kept].sum() + 0.1)
    return best[1]


def _most(limits: Limits, one: Class, gain: Float[np.ndarray, " cells"]) -> tuple[float, Float[np.ndarray, " cells"]]:
    """At least the sum of gains of any plan of a class, and fractions of positions that have it.

    A position must gain more than a price; the bound is valid for any price (Lagrange), and least at that where the number of
    positions agrees: between two plans, with too many positions and with too few.
    """
    group, here = np.unique(limits.cells.group[one.cells], return_inverse=True)[1].ravel(), gain[one.cells]
    used = np.isin(np.unique(limits.cells.group[one.cells]), one.used)

    def above(price: float) -> tuple[float, np.ndarray]:
        """The gains above a price in the best pitch settings, and the cells that have them."""
        over = np.maximum(here - price, 0.0)
        total = np.bincount(group, over, len(used))
        best = np.argsort(-total - used * (1.0 + total.sum()), kind="stable")[: one.groups]
        inside = np.zeros(len(used), bool)
        inside[best] = True
        return float(total[best].sum()), (over > 0) & inside[group]

    low, high = 0.0, float(here.max(initial=0.0))
    for _ in range(_BISECTIONS):
        price = (low + high) / 2
        many = limits.repeats * np.count_nonzero(above(price)[1]) > one.positions
        low, high = (price, high) if many else (low, price)
    (total, few), many = above(high), above(low)[1]
    most, least = (limits.repeats * np.count_nonzero(taken) for taken in (many, few))
    share = min(1.0, (one.positions - least) / (most - least)) if most > least else 0.0
    plan = np.zeros(len(gain))
    plan[one.cells] = limits.repeats * (share * many + (1 - share) * few)
    return limits.repeats * total + high * one.positions, plan


def _rounded(limits: Limits, one: Class, fractions: Float[np.ndarray, " cells"]) -> Int[np.ndarray, " positions"]:
    """Cells with the largest fractions, in the pitch settings with the most positions."""
    group = limits.cells.group
    number = np.bincount(group[one.cells], fractions[one.cells] + 1e-9, int(group.max()) + 1)
    number[list(one.used)] += 1.0 + number.sum()
    taken = np.argsort(-number, kind="stable")[: one.groups]
    cells = one.cells[np.isin(group[one.cells], taken)]
    return np.repeat(cells[np.argsort(-fractions[cells], kind="stable")], limits.repeats)[: one.positions]


def _divided(limits: Limits, one: Class, fractions: Float[np.ndarray, " cells"]) -> list[Class]:
    """The class with one pitch setting used by all plans, and without it: that with a fraction nearest to a half."""
    group = limits.cells.group[one.cells]
    share = np.zeros(int(limits.cells.group.max()) + 1)
    np.maximum.at(share, group, np.minimum(fractions[one.cells] / limits.repeats, 1.0))
    undecided = [g for g in np.unique(group) if g not in one.used and _WHOLE < share[g] < 1 - _WHOLE]
    if not undecided or len(one.used) >= one.groups:
        return []
    g = min(undecided, key=lambda g: abs(share[g] - 0.5))
    without = one.cells[group != g]
    groups, positions = len(np.unique(limits.cells.group[without])), limits.repeats * len(without)
    parts = [one._replace(used=(*one.used, g))]
    if groups:
        parts.append(
            one._replace(cells=without, groups=min(one.groups, groups), positions=min(one.positions, positions))
        )
    return parts


def _classes(limits: Limits) -> list[Class]:
    """All plans within limits: sets of mountings and temperatures, each with the numbers of positions at so many pitch settings
    that fit."""
    allowed, group, times = np.flatnonzero(limits.allowed), limits.cells.group, limits.times
    if not limits.timed:
        most = min(limits.count, limits.repeats * len(allowed))
        return [Class(allowed, len(np.unique(group[allowed])), int(most))]
    live, first = np.unique(limits.sitting[allowed], return_index=True)
    soak = limits.cells.soak[allowed[first]]
    sizes = range(1, len(live) + 1)
    if 2 ** len(live) - 1 <= _LISTED:
        sets = [np.array(one) for size in sizes for one in combinations(range(len(live)), size)]
        listed = [(live[one], len(one), len(np.unique(soak[one]))) for one in sets]
    else:
        listed = [(live, k, s) for k in sizes for s in range(1, min(k, len(np.unique(soak))) + 1)]
    # A turn may be saved where the pitch setting changes, and in a cell that is measured twice.
    turn = min(times.turn_s, times.pitch_change_s) if limits.repeats == 1 else 0.0
    made = list[Class]()
    for sittings, count, soaks in listed:
        cells = allowed[np.isin(limits.sitting[allowed], sittings)]
        before = 0
        for groups in range(len(np.unique(group[cells])), count - 1, -1):
            rest = limits.seconds - (groups - soaks) * times.pitch_change_s + groups * turn
            rest -= (count - soaks) * times.remount_s + (soaks - 1) * times.temperature_change_s
            fit = (rest + 1e-6) // (times.dwell_s + times.settle_s + turn)
            fit = int(min(fit, limits.count, limits.repeats * len(cells)))
            # Settings without positions are of no use, and a class with more settings and as many positions contains this one.
            if fit >= groups and fit > before:
                made.append(Class(cells, groups, fit))
                before = fit
    return made


def _reason(limits: Limits, nearest: Class, mine: Class, white: float, own: float, lost: Sequence[str]) -> str:
    """Why a plan is not closer to its bound; `white`, `own`: bounds over the value."""

    def words(one: Class) -> str:
        numbers = one.positions, one.groups, len(np.unique(limits.sitting[one.cells]))
        chamber = len(np.unique(limits.cells.soak)) > 1
        nouns = ("position", "pitch setting", "mounting-temperature combination" if chamber else "mounting")
        positions, groups, sittings = (f"{n} {noun}{'s' * (n != 1)}" for n, noun in zip(numbers, nouns, strict=True))
        return f"{positions} at {groups} in {sittings}"

    if lost:
        return (
            f"too few positions: {words(mine)} do not determine {', '.join(lost)}, but fractions of more positions do"
        )
    if own < white / own:
        return f"whole positions: for fractions of {words(mine)}, the settings of the plan, the bound is {own:.1%} of the value"
    return (
        f"whole settings: the bound is that of plans with {words(nearest)} in fractions of positions and settings; for "
        f"{words(mine)}, the settings of the plan, it is {own:.1%} of the value"
    )
