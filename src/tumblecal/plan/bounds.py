"""The least value of a criterion that any plan within limits can have under white noise, and the reason for the distance to it.

The logarithm of a criterion is convex in the information, so its tangent at any mixture of plans is a bound of every plan:

    log(value of a plan) >= log(value of the mixture) + gains of its positions - gains of the positions of the plan

The gains of a plan are at most those that a price of the time allows. Every set of mountings and temperatures has a bound.
Settings are visited once each. A second visit of a setting is of use if its error is drawn again (`[head.repeatability]`): the
same bound in the model of several visits (`one_visit`) is one for every plan.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from tumblecal.ground.counted import shortened
from tumblecal.plan.criterion import Criterion
from tumblecal.plan.information import LinearModel, covariance_of
from tumblecal.plan.limits import Limits


# An efficiency that needs no reason; a bound above the second share of the value is close enough.
GOOD, _CLOSE = 0.95, 0.995
# Largest number of plans that are added to a mixture.
_MIXED = 120
# A mixture ends at this duality gap, or if so many plans more do not raise its bound. Least share of a plan in it, and share
# of all cells together.
_GAP, _PATIENCE, _LEAST, _FLOOR = 1e-3, 10, 1e-4, 3e-4
# Steps of the price.
_STEPS = 30


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of a criterion under white noise.

    - `white`: of every plan within the limits that visits each setting once. `own`: of such plans with the number of positions
      of this plan, in its settings. `repeated`: of every plan within the limits, with any number of visits.
    - `value`: of the plan. `reason`: for the distance to the bound.
    """

    white: float
    own: float
    value: float
    repeated: float
    reason: str

    @property
    def efficiency(self) -> float:
        """Bound of plans that visit each setting once, over value."""
        return self.white / self.value


class Resource(NamedTuple):
    """Number of positions, or time of some cells: how much there is, and what a position and a pitch setting take."""

    cells: Bool[np.ndarray, " cells"]
    whole: float
    position: float = 1.0
    group: float = 0.0


class Tangent(NamedTuple):
    """`level` minus the `gain` of the positions of a plan: a bound of the logarithm of its value."""

    level: float
    gain: Float[np.ndarray, " cells"]


def bounds(
    model: LinearModel, several: LinearModel, criterion: Criterion, limits: Limits, chosen: Sequence[int] | np.ndarray
) -> Bounds:
    """Bounds for the best plan within limits.

    **Arguments:** `several`: the model of several visits. `chosen`: cells of a good plan.
    """
    value, group = float(criterion.of(model.covariance(chosen))), limits.cells.group
    white, repeated = (_least(one, criterion, limits, [*_resources(limits)], value) for one in (model, several))
    inside = Resource(limits.allowed & np.isin(group, group[np.asarray(chosen, int)]), len(chosen))
    own = max(_least(model, criterion, limits, [[inside]], value), white)
    kind, hopeless = "positions" if own * own < white * value else "settings", model.undetermined()
    reason = (
        f"whole {kind}: for fractions of positions in the settings of the plan it is {own / value:.1%} of the value"
    )
    if lost := [name for name in model.undetermined(chosen) if name not in hopeless]:
        reason = f"too few positions: they do not determine {shortened(lost, 9)}, but fractions of more positions do"
    return Bounds(white, own, value, min(repeated, white), reason if white < GOOD * value else "")


def _resources(limits: Limits) -> Iterator[list[Resource]]:
    """The resources of every set of mountings and temperatures."""
    times = limits.times
    # A turn may be saved where the pitch setting changes, and in a cell that is measured twice.
    turn = min(times.turn_s, times.pitch_change_s) if limits.repeats == 1 else 0.0
    position, group = times.dwell_s + times.settle_s + turn, times.pitch_change_s - turn
    for cells in limits.sets:
        soaks, mountings = (len(np.unique(label[cells])) for label in (limits.cells.soak, limits.cells.mounting))
        changes = (mountings - 1) * times.remount_s + (soaks - 1) * times.temperature_change_s
        time = limits.seconds - changes + soaks * times.pitch_change_s + 1e-6
        count = [] if np.isinf(limits.count) else [Resource(cells, limits.count)]
        if not limits.timed or time > position + group:
            yield count + ([Resource(cells, time, position, group)] if limits.timed else [])


def _least(
    model: LinearModel, criterion: Criterion, limits: Limits, sets: Sequence[Sequence[Resource]], value: float
) -> float:
    """The least bound of some sets, each with the highest bound that one of its resources gives."""
    tangents, least = list[Tangent](), np.log(value)
    for resources in sets:
        enough = min(least, np.log(_CLOSE * value))
        bound = max((t.level - _most(limits, r, t.gain)[0] for t in tangents for r in resources), default=-np.inf)
        for resource in resources:
            if bound < enough:
                tangents.append(_tangent(model, criterion, limits, resource, enough))
                bound = max(bound, tangents[-1].level - _most(limits, resource, tangents[-1].gain)[0])
        least = min(least, bound)
    return float(np.exp(least))


def _tangent(model: LinearModel, criterion: Criterion, limits: Limits, resource: Resource, enough: float) -> Tangent:
    """The tangent with the highest bound, at a mixture of plans, until that reaches the logarithm `enough`.

    Plans that reduce the criterion most are added to the mixture one by one (simplicial decomposition: von Hohenbalken 1977,
    Mathematical Programming 13, 49).
    """
    shared, columns = len(model.names), model.columns
    flat = columns.reshape(-1, columns.shape[2])

    def added(fractions: np.ndarray) -> np.ndarray:
        return (flat * np.repeat(fractions, 3)[:, None]).T @ flat

    def at(shares: np.ndarray, each: np.ndarray) -> tuple[float, float, np.ndarray]:
        """Logarithms of the criterion and of its support, and R with the gain of information X: trace of R' X R."""
        covariance = covariance_of(before + (1 - _FLOOR) * np.tensordot(shares, each, 1))
        smooth, value, root = criterion.support(covariance[:shared, :shared])
        return float(np.log(smooth)), float(np.log(value)), covariance[:, :shared] @ root

    def with_slope(shares: np.ndarray, each: np.ndarray) -> tuple[float, np.ndarray]:
        log_value, _, root = at(shares, each)
        return log_value, -(1 - _FLOOR) * np.sum((each @ root) * root, axis=(1, 2))

    plans = _most(limits, resource, np.sum(columns[:, :, :shared] ** 2, axis=(1, 2)))[1][None]
    # A little of every cell: only then do gains include that the error of a pitch setting has to be determined too.
    floor = _FLOOR * resource.cells * np.sum(plans) / np.count_nonzero(resource.cells)
    before, each, shares, since = model.information + added(floor), added(plans[0])[None], np.ones(1), 0
    best, highest = Tangent(0.0, floor), -np.inf
    for _ in range(_MIXED):
        if len(shares) > 1:
            whole = {"type": "eq", "fun": lambda s: s.sum() - 1, "jac": np.ones_like}
            within, options = [(0, 1)] * len(shares), {"maxiter": 25, "ftol": 1e-7}
            solved = minimize(
                with_slope, shares, (each,), "SLSQP", True, bounds=within, constraints=whole, options=options
            )
            shares = np.maximum(solved.x, 0) / np.maximum(solved.x, 0).sum()
        log_value, level, root = at(shares, each)
        gain = np.sum((flat @ root).reshape(len(columns), -1) ** 2, axis=1)
        here = Tangent(level + float(gain @ ((1 - _FLOOR) * shares @ plans + floor)), gain)
        most, plan = _most(limits, resource, gain)
        since = 0 if here.level - most > highest + 1e-5 else since + 1
        if here.level - most > highest:
            best, highest = here, here.level - most
        if highest >= enough or log_value - highest < _GAP or since > _PATIENCE:
            break
        kept = shares > _LEAST
        plans, each = np.concatenate([plans[kept], plan[None]]), np.concatenate([each[kept], added(plan)[None]])
        shares = np.append(0.9 * shares[kept], 0.1) / (0.9 * shares[kept].sum() + 0.1)
    return best


def _most(
    limits: Limits, resource: Resource, gain: Float[np.ndarray, " cells"]
) -> tuple[float, Float[np.ndarray, " cells"]]:
    """At least the sum of gains of any plan, and a plan with this sum, in fractions.

    A position, and a pitch setting, must gain more than its price, which is raised until the resource is enough. The sum of
    these gains and of the price of the whole resource is valid for any price (Lagrange).
    """
    _, share, position, group = resource
    inside = np.where(resource.cells, gain, 0.0)

    def at(price: float) -> tuple[float, np.ndarray, float]:
        more = limits.repeats * np.maximum(inside - price * position, 0.0)
        open = np.bincount(limits.cells.group, more) - price * group
        plan = limits.repeats * ((more > 0) & (open > 0)[limits.cells.group])
        return float(price * share + np.maximum(open, 0).sum()), plan, plan.sum() * position + np.sum(open > 0) * group

    low, high = 0.0, float(inside.max()) / position
    for _ in range(_STEPS):
        price = (low + high) / 2
        low, high = (price, high) if at(price)[2] > share else (low, price)
    (_, many, over), (bound, few, under) = at(low), at(high)
    return bound, few + (many - few) * np.clip((share - under) / max(over - under, 1e-300), 0.0, 1.0)
