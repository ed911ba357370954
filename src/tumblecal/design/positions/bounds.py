"""The least value of a criterion that any plan within limits can have under white noise, and the reason for the distance to it.

Plans are divided into classes: the set of mountings and temperatures, and the number of pitch settings, which together give the
number of positions that fit. Each class is bounded over its convex hull; a tangent found in one class bounds the others too, so
few need a search of their own. A class with a low bound is divided further, by the use of a pitch setting (branch and bound).
Settings are visited once each. A second visit of a setting is of use if its error is drawn again (`[head.repeatability]`): the
same bound in the model of several visits (`one_visit.py`) is one for every plan.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from tumblecal.design.criteria.criterion import CriterionOfCovariance
from tumblecal.design.model.limits import Limits
from tumblecal.design.model.one_visit import OneVisit
from tumblecal.design.positions.relaxation import POWER, Relaxed, relaxed


# Sets of mountings and temperatures are listed up to this number; more are bounded by their size.
_LISTED = 127
_SEARCHES = 100
_BISECTIONS = 30
# An efficiency that needs no reason; classes below the next one are divided, and those above the last one are not searched.
GOOD = 0.95
_DIVIDED = 0.975
_CLOSE = 0.995
# A pitch setting is used, or not, if the fraction is this close to 1 or 0.
_WHOLE = 0.02


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of a criterion under white noise.

    - `white`: of every plan within the limits that visits each setting once. `own`: of such plans with the number of positions
      of this plan, in its settings. `repeated`: of every plan within the limits, with any number of visits.
    - `value`: of the plan. `fractions`: positions of the relaxed optimum. `rounded`: whole positions near the relaxed optima of
      the classes in which a better plan is not excluded, the most promising class first.
    - `reason`: for the distance to the bound.
    """

    white: float
    own: float
    value: float
    fractions: Float[np.ndarray, " cells"]
    rounded: tuple[Int[np.ndarray, " positions"], ...]
    reason: str
    repeated: float

    @property
    def efficiency(self) -> float:
        """Bound of plans that visit each setting once, over value."""
        return self.white / self.value


@dataclass(frozen=True)
class _Classes:
    """Classes of plans with positions in some cells: each has a largest number of pitch settings and one of positions.

    `used`: pitch settings whose time is spent in all of the plans.
    """

    cells: Int[np.ndarray, " allowed"]
    groups: Int[np.ndarray, " classes"]
    positions: Int[np.ndarray, " classes"]
    used: tuple[int, ...] = ()

    def each(self) -> "list[_Classes]":
        """The classes one by one."""
        return [
            replace(self, groups=self.groups[k : k + 1], positions=self.positions[k : k + 1])
            for k in range(len(self.groups))
        ]


def bounds(
    model: OneVisit, criterion: CriterionOfCovariance, limits: Limits, chosen: Sequence[int] | np.ndarray
) -> Bounds:
    """Bounds for the best plan within limits; `chosen`: cells of a good one."""
    value = float(criterion.of_rows(criterion.rows @ model.covariance(chosen) @ criterion.rows.T))
    smooth, plan = criterion.smooth(POWER), np.bincount(np.asarray(chosen, int), minlength=len(model.columns))
    sets = _classes(limits)
    each = [one for several in sets for one in several.each()]
    undivided = len(each)
    lower, searched = np.full(undivided, -np.inf), dict[int, Relaxed]()
    for _ in range(_SEARCHES):
        at = int(np.argmin(lower))
        if lower[at] >= np.log(_CLOSE * value) or (at in searched and lower[at] >= np.log(_DIVIDED * value)):
            break
        if at in searched:
            parts = _divided(limits, each[at], searched[at].fractions) if limits.timed else []
            if not parts:
                break
            each += parts
            lower = np.append(lower, np.full(len(parts), lower[at]))
            lower[at] = np.inf
            continue
        found = searched[at] = _searched(model, smooth, limits, each[at], plan, np.log(_CLOSE * value))
        if at < undivided:
            tangent = found.tangent
            bound = tangent.level - np.concatenate([_gains(limits, one, tangent.gain)[0] for one in sets])
            # A class that is divided already is bounded by its parts.
            lower[:undivided] = np.maximum(lower[:undivided], bound)
        lower[at] = max(lower[at], found.log_bound)
    at = int(np.argmin(lower))
    nearest = searched[at] if at in searched else searched[max(searched)]
    group = limits.cells.group
    used = np.unique(group[np.flatnonzero(plan)])
    settings = np.flatnonzero(limits.allowed & np.isin(group, used))
    mine = _Classes(settings, np.array([len(used)]), np.array([plan.sum()]))
    own = _searched(model, smooth, limits, mine, plan, np.log(value))
    white, within = (min(float(np.exp(log)), value) for log in (lower[at], max(own.log_bound, lower[at])))
    better = [k for k in np.argsort(lower, kind="stable") if k in searched and lower[k] < np.log(value) - 1e-3]
    rounded = tuple(_rounded(limits, each[k], searched[k].fractions) for k in better)
    reason = ""
    if white < GOOD * value:
        lost = [name for name in model.undetermined(chosen) if name not in model.undetermined()]
        reason = _reason(limits, each[at], mine, white / value, within / value, lost)
    return Bounds(white, within, value, nearest.fractions, rounded, reason, white)


def _reason(limits: Limits, nearest: _Classes, mine: _Classes, white: float, own: float, lost: Sequence[str]) -> str:
    """Why a plan is not closer to its bound; `white`, `own`: bounds over the value."""

    def words(one: _Classes) -> str:
        numbers = int(one.positions[0]), int(one.groups[0]), len(np.unique(limits.sitting[one.cells]))
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


def _divided(limits: Limits, one: _Classes, fractions: np.ndarray) -> list[_Classes]:
    """The class without a pitch setting, and with it used by all plans: that with a fraction nearest to a half."""
    group = limits.cells.group[one.cells]
    share = np.zeros(int(limits.cells.group.max()) + 1)
    np.maximum.at(share, group, np.minimum(fractions[one.cells] / limits.repeats, 1.0))
    open_now = [g for g in np.unique(group) if g not in one.used]
    if not open_now or len(one.used) >= one.groups[0]:
        return []
    g = int(min(open_now, key=lambda g: abs(share[g] - 0.5)))
    if not _WHOLE < share[g] < 1 - _WHOLE:
        return []
    without, used = one.cells[group != g], (*one.used, g)
    parts = [replace(one, used=used)]
    if len(used) == one.groups[0]:
        # All pitch settings are known.
        parts = [replace(one, cells=one.cells[np.isin(group, used)], used=())]
    if len(without):
        groups = np.minimum(one.groups, len(np.unique(limits.cells.group[without])))
        positions = np.minimum(one.positions, limits.repeats * len(without))
        parts.append(replace(one, cells=without, groups=groups, positions=positions))
    return parts


def _searched(
    model: OneVisit, criterion: CriterionOfCovariance, limits: Limits, one: _Classes, plan: np.ndarray, log_value: float
) -> Relaxed:
    """The bound of one class."""

    def best(gain: np.ndarray) -> tuple[np.ndarray, float]:
        most, threshold = _gains(limits, one, gain)
        return _plan(limits, one, gain, float(threshold[0])), float(most[0])

    rows = model.columns[one.cells]
    first = best(np.bincount(one.cells, np.sum(rows[:, :, : len(model.names)] ** 2, axis=(1, 2)), len(plan)))[0]
    taken = np.flatnonzero(plan)
    settings = len(np.union1d(limits.cells.group[taken], one.used))
    within = np.all(np.isin(taken, one.cells)) and plan.sum() <= one.positions[0] and settings <= one.groups[0]
    starts = [plan, first] if within else [first]
    return relaxed(model, criterion, best, starts, enough=log_value)


def _gains(limits: Limits, one: _Classes, gain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each class a bound of the sum of gains of its plans, and a threshold of the gain of their positions.

    A position must gain more than a price; the bound is valid for any price (Lagrange), and is least at that where the
    number of positions agrees.
    """
    group = np.unique(limits.cells.group[one.cells], return_inverse=True)[1].ravel()
    order = np.argsort(group, kind="stable")
    gain, first = gain[one.cells][order], np.unique(group[order], return_index=True)[1]
    rank = np.arange(len(first))
    inside = rank < one.groups[:, None]
    # Pitch settings that are used come first.
    ahead = np.isin(np.unique(limits.cells.group[one.cells]), one.used) * 1e6 * (1.0 + gain.sum())
    low, high = np.zeros(len(one.groups)), np.full(len(one.groups), gain.max(initial=0.0))
    for _ in range(_BISECTIONS):
        price = (low + high) / 2
        over = np.maximum(gain - price[:, None], 0.0)
        of_group = np.add.reduceat(over, first, axis=1)
        number = np.add.reduceat(over > 0, first, axis=1, dtype=int)
        by_value = np.argsort(-of_group - ahead, axis=1)
        count = np.sum(np.take_along_axis(number, by_value, axis=1) * inside, axis=1) * limits.repeats
        low, high = np.where(count > one.positions, price, low), np.where(count > one.positions, high, price)
    over = np.add.reduceat(np.maximum(gain - high[:, None], 0.0), first, axis=1)
    by_value = np.argsort(-over - ahead, axis=1)
    best = np.sum(np.take_along_axis(over, by_value, axis=1) * inside, axis=1) * limits.repeats
    return best + high * one.positions, high


def _plan(limits: Limits, one: _Classes, gain: np.ndarray, price: float) -> np.ndarray:
    """Positions in each cell of a plan of the (only) class with the largest gains."""
    group = limits.cells.group
    over = np.bincount(group[one.cells], np.maximum(gain[one.cells] - price * (1 - 1e-9), 0.0), int(group.max()) + 1)
    over[list(one.used)] += 1e6 * (1.0 + over.sum())
    taken = np.argsort(-over, kind="stable")[: one.groups[0]]
    cells = one.cells[np.isin(group[one.cells], taken)]
    cells = np.repeat(cells[np.argsort(-gain[cells], kind="stable")], limits.repeats)[: one.positions[0]]
    return np.bincount(cells, minlength=len(gain))


def _rounded(limits: Limits, one: _Classes, fractions: np.ndarray) -> np.ndarray:
    """Cells with the largest fractions in the pitch settings with the most positions."""
    return np.repeat(np.arange(len(fractions)), _plan(limits, one, fractions + 1e-9, 0.0))


def _classes(limits: Limits) -> list[_Classes]:
    """All plans: a set of mountings and temperatures each, with the numbers of pitch settings and positions that fit."""
    allowed, group = np.flatnonzero(limits.allowed), limits.cells.group
    if not limits.timed:
        groups = len(np.unique(group[allowed]))
        return [
            _Classes(allowed, np.array([groups]), np.array([min(limits.count, limits.repeats * len(allowed))], int))
        ]
    live = np.unique(limits.sitting[allowed])
    soak_of = np.array([limits.cells.soak[limits.sitting == one][0] for one in live])
    if 2 ** len(live) - 1 <= _LISTED:
        sets = [np.array(one) for size in range(1, len(live) + 1) for one in combinations(range(len(live)), size)]
        listed = [(live[one], len(one), len(np.unique(soak_of[one]))) for one in sets]
    else:
        soaks = len(np.unique(soak_of))
        listed = [(live, k, s) for k in range(1, len(live) + 1) for s in range(1, min(k, soaks) + 1)]
    made = (_of_set(limits, allowed[np.isin(limits.sitting[allowed], one)], k, soaks) for one, k, soaks in listed)
    return [one for one in made if len(one.groups)]


def _of_set(limits: Limits, cells: np.ndarray, sittings: int, soaks: int) -> _Classes:
    """Classes of a set of mountings and temperatures; the times are at most those of any schedule."""
    times = limits.times
    # A turn may be saved where the pitch setting changes, and in a cell that is measured twice.
    turn = min(times.turn_s, times.pitch_change_s) if limits.repeats == 1 else 0.0
    groups = np.arange(max(1, sittings), len(np.unique(limits.cells.group[cells])) + 1)
    settings = (
        (groups - soaks) * times.pitch_change_s
        - groups * turn
        + (sittings - soaks) * times.remount_s
        + (soaks - 1) * times.temperature_change_s
    )
    positions = np.floor((limits.seconds - settings + 1e-6) / (times.dwell_s + times.settle_s + turn))
    positions = np.minimum(positions, min(limits.count, limits.repeats * len(cells)))
    # Settings without positions are of no use, and a class with more settings and as many positions contains this one.
    groups, positions = groups[positions >= groups], positions[positions >= groups].astype(int)
    useful = positions > np.append(positions[1:], 0)
    return _Classes(cells, groups[useful], positions[useful])
