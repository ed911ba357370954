"""The least value of a criterion that any plan within limits can have under white noise, and the plan that is searched with it.

The logarithm of a criterion is convex in the information, so its tangent at any mixture of plans is a bound of every plan:

    log(value of a plan) >= log(value of the mixture) + gains of its positions - gains of the positions of the plan

The gains of a plan are at most those of the best positions in the best pitch settings. Plans are divided into classes, each
with a number of pitch settings and the number of positions that then fit. Settings are visited once each. A second visit of a
setting is of use if its error is drawn again (`[head.repeatability]`): the same bound in the model of several visits
(`one_visit`) is one for every plan.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from tumblecal.plan.cells import Numbers
from tumblecal.plan.criterion import Criterion
from tumblecal.plan.exchange import Term, exchange
from tumblecal.plan.information import LinearModel, Square, covariance_of
from tumblecal.plan.limits import Limits


# An efficiency that needs no reason; a bound above the second share of the value is close enough.
GOOD, _CLOSE = 0.95, 0.995
# Largest number of tangents, and of plans that are added to a mixture.
_SEARCHES, _MIXED = 40, 120
# A plan this close to its bound is not searched further; the most promising classes are searched in each round.
_ENOUGH, _ROUNDS, _CLASSES = 0.99, 3, 4
# A mixture ends at this duality gap, or if so many plans more do not raise its bound. Least share of a plan in it, and share
# of all cells together.
_GAP, _PATIENCE, _LEAST, _FLOOR = 1e-3, 10, 1e-4, 3e-4
# Steps of the price.
_STEPS = 30

Gains = Float[np.ndarray, " cells"]


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of a criterion under white noise.

    - `white`: of every plan within the limits that visits each setting once. `own`: of such plans with the number of positions
      of this plan, in its settings. `repeated`: of every plan within the limits, with any number of visits.
    - `value`: of the plan. `reason`: for the distance to the bound. `rounded`: whole positions near the mixtures of the classes
      in which a better plan is not excluded, the most promising class first.
    """

    white: float
    own: float
    value: float
    repeated: float
    reason: str
    rounded: tuple[Numbers, ...] = ()

    @property
    def efficiency(self) -> float:
        """Bound of plans that visit each setting once, over value."""
        return self.white / self.value


class Class(NamedTuple):
    """Plans with at most so many positions at so many pitch settings, in some cells."""

    cells: Bool[np.ndarray, " cells"]
    groups: int
    positions: float


def best_plan(
    model: LinearModel, several: LinearModel, criterion: Criterion, limits: Limits, *, restarts: int = 2, seed: int = 0
) -> tuple[Numbers, Bounds]:
    """Exchange, then bounds; then exchange from the mixtures of the classes of plans that the bounds do not exclude.

    **Arguments:** `several`: the model of several visits, for the bound of any plan.
    """
    terms = [Term(((model, criterion),))]
    chosen = exchange(limits, terms, restarts=restarts, seed=seed).cells
    found = bounds(model, criterion, limits, chosen)
    for number in range(1, _ROUNDS + 1):
        if found.efficiency >= _ENOUGH or not found.rounded:
            break
        # A plan far from its bound gets new random starts too.
        far = found.efficiency < GOOD
        other = exchange(limits, terms, restarts=restarts * far, seed=seed + number, starts=found.rounded)
        if other.value < found.value * (1 - 1e-6):
            chosen, found = other.cells, bounds(model, criterion, limits, other.cells)
        elif not far:
            break
    repeated = bounds(several, criterion, limits, chosen).white
    return np.array(chosen), replace(found, repeated=min(repeated, found.white))


def bounds(model: LinearModel, criterion: Criterion, limits: Limits, chosen: Sequence[int] | np.ndarray) -> Bounds:
    """Bounds for the best plan within limits; `chosen`: cells of a good one."""
    value, group = float(criterion.of(model.covariance(chosen))), limits.cells.group
    white, rounded = _least(model, criterion, limits, [*_classes(limits)], value)
    settings = np.unique(group[np.asarray(chosen, int)])
    inside = Class(limits.allowed & np.isin(group, settings), len(settings), len(chosen))
    own = max(_least(model, criterion, limits, [inside], value)[0], white)
    reason = (
        f"whole positions: for fractions of positions in the settings of the plan it is {own / value:.1%} of the value"
    )
    return Bounds(white, own, value, white, reason if white < GOOD * value else "", rounded)


def _classes(limits: Limits) -> Iterator[Class]:
    """All plans within limits: sets of mountings and temperatures, each with the numbers of positions at so many pitch settings
    that fit."""
    times, cells = limits.times, limits.cells
    # A turn may be saved where the pitch setting changes, and in a cell that is measured twice.
    turn = min(times.turn_s, times.pitch_change_s) if limits.repeats == 1 else 0.0
    for inside in limits.sets:
        soaks, mountings, most = (len(np.unique(label[inside])) for label in (cells.soak, cells.mounting, cells.group))
        free = limits.seconds - (mountings - 1) * times.remount_s - (soaks - 1) * times.temperature_change_s
        before = 0.0
        for groups in range(most, 0, -1):
            time = free - (groups - soaks) * times.pitch_change_s + groups * turn + 1e-6
            fit = min(np.floor(time / (times.dwell_s + times.settle_s + turn)), limits.count)
            # A class with more settings and as many positions contains this one.
            if fit >= groups and fit > before:
                yield Class(inside, groups, fit)
                before = fit


def _least(
    model: LinearModel, criterion: Criterion, limits: Limits, classes: Sequence[Class], value: float
) -> tuple[float, tuple[Numbers, ...]]:
    """The least bound of some classes, and whole positions near the mixtures of those with the lowest bounds; a class with a
    low one gets a tangent for itself."""
    bound, searched, close = np.full(len(classes), -np.inf), dict[int, Numbers](), np.log(_CLOSE * value)
    at = 0
    while bound[at] < close and at not in searched and len(searched) < _SEARCHES:
        level, gain, fractions = _tangent(model, criterion, limits, classes[at], close)
        for k in np.flatnonzero(bound < close).tolist():
            bound[k] = max(bound[k], level - _most(limits, classes[k], gain)[0])
        # The cells with the largest fractions, in the pitch settings with the most positions.
        group, (_, groups, positions) = limits.cells.group, classes[at]
        best = np.argsort(-np.bincount(group, fractions), kind="stable")[:groups]
        cells = np.argsort(-np.where(np.isin(group, best), fractions, -1.0), kind="stable")
        searched[at] = np.repeat(cells, limits.repeats)[: int(positions)]
        at = int(np.argmin(bound))
    better = [k for k in np.argsort(bound, kind="stable").tolist() if k in searched and bound[k] < np.log(value) - 1e-3]
    return min(float(np.exp(bound.min())), value), tuple(searched[k] for k in better[:_CLASSES])


def _tangent(
    model: LinearModel, criterion: Criterion, limits: Limits, one: Class, enough: float
) -> tuple[float, Gains, Gains]:
    """The tangent with the highest bound, at a mixture of plans, until that reaches the logarithm `enough`: its level, from
    which the gains of a plan are subtracted, the gain of a position in each cell, and the fractions of positions in it.

    Plans that reduce the criterion most are added to the mixture one by one (simplicial decomposition: von Hohenbalken 1977,
    Mathematical Programming 13, 49).
    """
    shared, columns = len(model.names), model.columns
    flat = columns.reshape(-1, columns.shape[2])

    def added(fractions: Gains) -> Square:
        return (flat * np.repeat(fractions, 3)[:, None]).T @ flat

    def support(shares: np.ndarray, each: Square) -> tuple[float, float, np.ndarray]:
        """Logarithms of the criterion and of its tangent, and R: the gain of information X is the trace of R' X R."""
        covariance = covariance_of(before + (1 - _FLOOR) * np.tensordot(shares, each, 1))
        smooth, value, root = criterion.support(covariance[:shared, :shared])
        return float(np.log(smooth)), float(np.log(value)), covariance[:, :shared] @ root

    def with_slope(shares: np.ndarray, each: Square) -> tuple[float, np.ndarray]:
        smooth, _, root = support(shares, each)
        return smooth, -(1 - _FLOOR) * np.sum((each @ root) * root, axis=(1, 2))

    plans = _most(limits, one, np.sum(columns[:, :, :shared] ** 2, axis=(1, 2)))[1][None]
    # A little of every cell: only then do gains include that the error of a pitch setting has to be determined too.
    floor = _FLOOR * one.cells * np.sum(plans) / np.count_nonzero(one.cells)
    before, each, shares = model.information + added(floor), added(plans[0])[None], np.ones(1)
    highest, since, best = -np.inf, 0, None
    whole = {"type": "eq", "fun": lambda s: s.sum() - 1, "jac": np.ones_like}
    while True:
        if len(shares) > 1:
            options = {"maxiter": 25, "ftol": 1e-7}
            within = [(0, 1)] * len(shares)
            solved = minimize(
                with_slope, shares, (each,), "SLSQP", True, bounds=within, constraints=whole, options=options
            )
            shares = np.maximum(solved.x, 0) / np.maximum(solved.x, 0).sum()
        smooth, value, root = support(shares, each)
        gain = np.sum((flat @ root).reshape(len(columns), -1) ** 2, axis=1)
        fractions = (1 - _FLOOR) * shares @ plans + floor
        level = value + float(gain @ fractions)
        most, plan = _most(limits, one, gain)
        since = 0 if level - most > highest + 1e-5 else since + 1
        if best is None or level - most > highest:
            best, highest = (level, gain, fractions), level - most
        if highest >= enough or smooth - highest < _GAP or since > _PATIENCE or len(plans) > _MIXED:
            return best
        kept = shares > _LEAST
        plans, each = np.concatenate([plans[kept], plan[None]]), np.concatenate([each[kept], added(plan)[None]])
        shares = np.append(0.9 * shares[kept], 0.1) / (0.9 * shares[kept].sum() + 0.1)


def _most(limits: Limits, one: Class, gain: Gains) -> tuple[float, Gains]:
    """At least the sum of gains of any plan of a class, and a plan with this sum, in fractions.

    A position must gain more than a price, which is raised until no more positions do than there are. The sum of these gains
    and of the price of all positions is valid for any price (Lagrange).
    """
    inside, group = np.where(one.cells, gain, 0.0), limits.cells.group

    def at(price: float) -> tuple[float, Gains]:
        more = limits.repeats * np.maximum(inside - price, 0.0)
        of_group = np.bincount(group, more)
        best = np.argsort(of_group, kind="stable")[-one.groups :]
        return float(of_group[best].sum() + price * one.positions), limits.repeats * ((more > 0) & np.isin(group, best))

    low, high = 0.0, float(inside.max())
    for _ in range(_STEPS):
        price = (low + high) / 2
        low, high = (price, high) if at(price)[1].sum() > one.positions else (low, price)
    many, (bound, few) = at(low)[1], at(high)
    share = (one.positions - few.sum()) / max(many.sum() - few.sum(), 1)
    return bound, few + (many - few) * np.clip(share, 0.0, 1.0)
