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
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize, minimize_scalar

from tumblecal.ground.numbers_shown import counted
from tumblecal.plan.criterion import Criterion
from tumblecal.plan.exchange import Chosen, exchange
from tumblecal.plan.information import covariance_of
from tumblecal.plan.limits import Limits
from tumblecal.plan.linear_model import LinearModel
from tumblecal.plan.set_value import Term


# An efficiency that needs no reason; classes with bounds above the second share of the value get no mixture of their own.
GOOD, _CLOSE = 0.95, 0.995
# Largest number of mountings and temperatures of which all sets are listed; of mixtures; of plans in a mixture.
_LISTED, _SEARCHES, _MIXED = 8, 100, 120
# A mixture ends at this duality gap, or if so many plans more do not raise its bound. Least share of a plan in it.
_GAP, _PATIENCE, _LEAST = 1e-3, 10, 1e-4
# Power of the mean that replaces the largest variance. Share of all cells together in every mixture.
_POWER, _FLOOR = 64.0, 3e-4
# Accuracy of the price of a position, as a share of the largest gain.
_PRICES = 1e-4
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
    """Plans with at most so many positions at so many pitch settings, in some cells."""

    cells: Int[np.ndarray, " allowed"]
    groups: int
    positions: int


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
        # A plan far from its bound gets new random starts too.
        far, starts = found.efficiency < GOOD, found.rounded[:_CLASSES]
        if found.efficiency >= _ENOUGH or not starts:
            break
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
    value, classes = float(criterion.of(model.covariance(chosen))), _classes(limits)
    log_bound, searched = np.full(len(classes), -np.inf), dict[int, Mixture]()
    at, close = 0, np.log(_CLOSE * value)
    while log_bound[at] < close and at not in searched and len(searched) < _SEARCHES:
        searched[at] = mixture(model, criterion, limits, classes[at], close)
        for k in np.flatnonzero(log_bound < close).tolist():
            log_bound[k] = max(log_bound[k], searched[at].level - _most(limits, classes[k], searched[at].gain)[0])
        at = int(np.argmin(log_bound))
    group = limits.cells.group
    settings = np.unique(group[np.asarray(chosen, int)])
    mine = Class(np.flatnonzero(limits.allowed & np.isin(group, settings)), len(settings), len(chosen))
    inside = mixture(model, criterion, limits, mine, np.log(value))
    white = min(float(np.exp(log_bound[at])), value)
    own = min(max(float(np.exp(inside.level - _most(limits, mine, inside.gain)[0])), white), value)
    better = [k for k in np.argsort(log_bound, kind="stable") if k in searched and log_bound[k] < np.log(value) - 1e-3]
    rounded = tuple(_rounded(limits, classes[k], searched[k].fractions) for k in better)
    lost = [name for name in model.undetermined(chosen) if name not in model.undetermined()]
    reason = "" if white >= GOOD * value else _reason(limits, classes[at], mine, white / value, own / value, lost)
    return Bounds(white, own, value, rounded, reason, white)


def mixture(model: LinearModel, criterion: Criterion, limits: Limits, one: Class, enough: float) -> Mixture:
    """The mixture of plans of a class whose tangent gives the highest bound, until that reaches the logarithm `enough`.

    Plans that reduce the criterion most are added to the mixture one by one (simplicial decomposition: von Hohenbalken 1977,
    Mathematical Programming 13, 49).
    """
    smooth, shared = criterion.smooth(_POWER), len(model.names)
    flat, floor = model.columns.reshape(-1, model.columns.shape[2]), np.zeros(len(model.columns))
    floor[one.cells] = _FLOOR * one.positions / len(one.cells)

    def added(fractions: np.ndarray) -> np.ndarray:
        return (flat * np.repeat(fractions, 3)[:, None]).T @ flat

    # A little of every cell: only then do gains include that the error of a pitch setting has to be determined too.
    before = model.information + added(floor)

    def at(shares: np.ndarray, each: np.ndarray) -> tuple[float, float, np.ndarray]:
        """Logarithms of the criterion and of its support, and R with the gain of information X: trace of R' X R."""
        covariance = covariance_of(before + (1 - _FLOOR) * np.tensordot(shares, each, 1))
        value, root = smooth.support(covariance[:shared, :shared])
        log_value = float(np.log(smooth.of(covariance[:shared, :shared])))
        return log_value, float(np.log(value)), covariance[:, :shared] @ root

    def with_slope(shares: np.ndarray, each: np.ndarray) -> tuple[float, np.ndarray]:
        log_value, _, root = at(shares, each)
        return log_value, -(1 - _FLOOR) * np.sum((each @ root) * root, axis=(1, 2))

    plans = _most(limits, one, np.sum(model.columns[:, :, :shared] ** 2, axis=(1, 2)))[1][None]
    each, shares, since = added(plans[0])[None], np.ones(1), 0
    best = -np.inf, Mixture(plans[0], -np.inf, plans[0])
    for _ in range(_MIXED):
        if len(shares) > 1:
            whole = {"type": "eq", "fun": lambda s: s.sum() - 1, "jac": np.ones_like}
            within, options = [(0, 1)] * len(shares), {"maxiter": 25, "ftol": 1e-7}
            solved = minimize(
                with_slope, shares, (each,), "SLSQP", True, bounds=within, constraints=whole, options=options
            )
            shares = np.maximum(solved.x, 0) / np.maximum(solved.x, 0).sum()
        log_value, level, root = at(shares, each)
        gain = np.sum((flat @ root).reshape(len(floor), -1) ** 2, axis=1)
        fractions = (1 - _FLOOR) * shares @ plans + floor
        here = Mixture(fractions, level + float(gain @ fractions), gain)
        most, plan = _most(limits, one, gain)
        since = 0 if here.level - most > best[0] + 1e-5 else since + 1
        best = max(best, (here.level - most, here), key=lambda found: found[0])
        if best[0] >= enough or log_value - best[0] < _GAP or since > _PATIENCE:
            break
        kept = shares > _LEAST
        plans, each = np.concatenate([plans[kept], plan[None]]), np.concatenate([each[kept], added(plan)[None]])
        shares = np.append(0.9 * shares[kept], 0.1) / (0.9 * shares[kept].sum() + 0.1)
    return best[1]


def _most(limits: Limits, one: Class, gain: Float[np.ndarray, " cells"]) -> tuple[float, Float[np.ndarray, " cells"]]:
    """At least the sum of gains of any plan of a class, and a plan that has nearly this sum.

    A position must gain more than a price; the bound is valid for any price (Lagrange), and convex in it.
    """
    number, here = np.unique(limits.cells.group[one.cells], return_inverse=True)[1].ravel(), gain[one.cells]

    def above(price: float) -> np.ndarray:
        return np.bincount(number, np.maximum(here - price, 0.0))

    def bound(price: float) -> float:
        return float(limits.repeats * np.sort(above(price))[-one.groups :].sum() + price * one.positions)

    most = float(here.max(initial=1e-300))
    found: Any = minimize_scalar(bound, bounds=(0.0, most), method="bounded", options={"xatol": _PRICES * most})
    price = float(found.x)
    inside = np.isin(number, np.argsort(above(price), kind="stable")[-one.groups :])
    best = one.cells[np.argsort(-np.where(inside, here, -1.0), kind="stable")[: np.count_nonzero(inside)]]
    plan = np.zeros(len(gain))
    plan[best] = np.clip(one.positions - limits.repeats * np.arange(len(best)), 0, limits.repeats)
    return bound(price), plan


def _rounded(limits: Limits, one: Class, fractions: Float[np.ndarray, " cells"]) -> Int[np.ndarray, " positions"]:
    """Cells with the largest fractions, in the pitch settings with the most positions."""
    group = limits.cells.group[one.cells]
    taken = np.argsort(-np.bincount(group, fractions[one.cells] + 1e-9), kind="stable")[: one.groups]
    cells = one.cells[np.isin(group, taken)]
    return np.repeat(cells[np.argsort(-fractions[cells], kind="stable")], limits.repeats)[: one.positions]


def _classes(limits: Limits) -> list[Class]:
    """All plans within limits: sets of mountings and temperatures, each with the numbers of positions at so many pitch settings
    that fit."""
    allowed, group, times = np.flatnonzero(limits.allowed), limits.cells.group, limits.times
    most = int(min(limits.count, limits.repeats * len(allowed)))
    if not limits.timed:
        return [Class(allowed, len(np.unique(group[allowed])), most)]
    every, made = np.unique(limits.cells.sitting[allowed]).tolist(), list[Class]()
    # Of very many mountings and temperatures: all of them, as if they were one.
    listed = len(every) <= _LISTED
    sets = [one for size in range(1, len(every) + 1) for one in combinations(every, size)] if listed else [every]
    # A turn may be saved where the pitch setting changes, and in a cell that is measured twice.
    turn = min(times.turn_s, times.pitch_change_s) if limits.repeats == 1 else 0.0
    for sittings in sets:
        cells, before = allowed[np.isin(limits.cells.sitting[allowed], sittings)], 0
        soaks, count = (len(np.unique(limits.cells.soak[cells])), len(sittings)) if listed else (1, 1)
        rest = limits.seconds - (count - soaks) * times.remount_s - (soaks - 1) * times.temperature_change_s
        for groups in range(len(np.unique(group[cells])), count - 1, -1):
            free = rest - (groups - soaks) * times.pitch_change_s + groups * turn + 1e-6
            fit = int(min(free // (times.dwell_s + times.settle_s + turn), most, limits.repeats * len(cells)))
            # Settings without positions are of no use, and a class with more settings and as many positions contains this one.
            if fit >= groups and fit > before:
                made.append(Class(cells, groups, fit))
                before = fit
    return made


def _reason(limits: Limits, nearest: Class, mine: Class, white: float, own: float, lost: Sequence[str]) -> str:
    """Why a plan is not closer to its bound; `white`, `own`: bounds over the value."""
    numbers = (
        (
            counted(one.positions, "position"),
            counted(one.groups, "pitch setting"),
            len(np.unique(limits.cells.sitting[one.cells])),
        )
        for one in (mine, nearest)
    )
    noun = "mounting-temperature combination" if len(np.unique(limits.cells.soak)) > 1 else "mounting"
    own_words, words = (
        f"{positions} at {groups} in {counted(sittings, noun)}" for positions, groups, sittings in numbers
    )
    settings = f"{own_words}, the settings of the plan,"
    if lost:
        return f"too few positions: {own_words} do not determine {', '.join(lost)}, but fractions of more positions do"
    if own < white / own:
        return f"whole positions: for fractions of {settings} the bound is {own:.1%} of the value"
    return (
        f"whole settings: the bound is that of plans with {words} in fractions of positions and settings; for {settings} it is "
        f"{own:.1%} of the value"
    )
