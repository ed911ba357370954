"""The order of the positions of a plan under slow noise, with the costs of transitions and with settings that are set again.

A trend-free order keeps drift out of the parameters, but changes of pitch setting and mounting take time and add errors when
they are set again (Tack and Vandebroek 2004, Budget constrained run orders in optimum design, Journal of Statistical Planning
and Inference 124). Many changes of an order are evaluated at once, and the best one is kept: two positions exchanged, or a
stretch of positions moved or reversed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.errors import InputError
from tumblecal.noise.of_head import tabulated_covariance
from tumblecal.plan.criterion import Criterion
from tumblecal.plan.information import SEARCHED, scheduled_model, uncertainties
from tumblecal.plan.limits import in_order
from tumblecal.plan.responses import Responses
from tumblecal.plan.schedule import Schedule, schedule


Kind = Literal["best", "random", "keep"]
# Numbers of cells.
Order = Int[np.ndarray, " positions"]
Objective = Callable[[Int[np.ndarray, "n positions"]], Float[np.ndarray, " n"]]


# Exponent of the duration in the objective. Without a limit a longer order must pay: repeating a measurement reduces all
# standard deviations by the square root of the time. With a limit time up to it is free, but not wasted on negligible gains.
_PRICE, _PRICE_WITHIN_LIMIT = 0.5, 0.02
# Changes that are evaluated at once, rounds without a gain after which a start is given up, and the least gain.
_TRIED, _PATIENCE, _GAIN = 48, 12, 1e-5
# Evaluations of a search are limited to so many, divided by the number of positions.
_EFFORT = 150_000
# Shares of the exchanges within a pitch setting, and of the stretches that are whole visits.
_WITHIN, _VISITS = 0.75, 0.75


@dataclass(frozen=True)
class Ordered:
    """An order: its schedule, the criterion, and the criterion if the slow noise were known (`drift_known`): no order with the
    same visits is better."""

    schedule: Schedule
    value: float
    drift_known: float


def best_order(
    responses: Responses,
    ability: HeadAbility,
    criterion: Criterion,
    cells: Order,
    *,
    minutes: float | None = None,
    seed: int = 0,
    kind: Kind = "best",
    measured: Sequence[int] | np.ndarray = (),
) -> Ordered:
    """The order of some positions; its criterion is huge if the positions do not determine the parameters.

    **Arguments:**

    - `cells`: numbers of cells; one may be listed several times.
    - `minutes`: limit of the whole schedule. If not stated, an order that takes longer must pay for it: criterion times the
      square root of the duration is minimised.
    - `kind`: `"keep"`: the order given; `"random"`: one visit of each pitch setting and mounting, visits and their positions in
      random order; `"best"`: the least criterion.
    - `measured`: cells of positions that are measured already; the order continues them.

    **Raises:** `InputError` if the positions need more than `minutes`.
    """
    rng, given = np.random.default_rng(seed), np.asarray(cells, int)
    of, present = responses.cells, int(measured[-1]) if len(measured) else None
    shortest, random = in_order(of, given, present), in_order(of, given, present, rng)
    if kind == "keep" or len(given) < 2:
        order = given
    elif kind == "random":
        late = minutes is not None and schedule(of, random, ability.times, measured).minutes > minutes
        order = shortest if late else random
    else:
        mirrored = [_mirrored(of.group, one, rng) for one in (random, given)]
        starts = list({tuple(one.tolist()): one for one in (given, shortest, *mirrored)}.values())
        order = _searched(
            _objective(responses, ability, criterion, minutes, measured, len(given)), of.group, starts, rng
        )
    planned = schedule(of, order, ability.times, measured)
    if minutes is not None and planned.minutes > minutes:
        least, here = ("at least ", "") if kind == "best" else ("", " in this order")
        needed = f"{len(planned)} positions need {least}{np.ceil(planned.minutes):.0f} min{here}"
        raise InputError(f"{needed}, but {minutes:g} min are allowed; allow more time or fewer positions")
    model = scheduled_model(responses, planned)
    value = criterion.of(uncertainties(responses, planned, ability).covariance)
    return Ordered(planned, float(value), float(criterion.of(model.shared(model.with_all()))))


def _objective(
    responses: Responses,
    ability: HeadAbility,
    criterion: Criterion,
    minutes: float | None,
    measured: Sequence[int] | np.ndarray,
    count: int,
) -> Objective:
    """Logarithm of the criterion of orders of so many positions, with the price of the duration; the excess over a limit is
    added at a high price."""
    times, slow, table = ability.times, ability.slow_noise, None
    if slow.any:
        longest = times.settle_s + times.turn_s + times.pitch_change_s + times.remount_s + times.temperature_change_s
        table = tabulated_covariance(slow, times, (len(measured) + count) * (times.dwell_s + longest))
    limit_s, price = (np.inf, _PRICE) if minutes is None else (60 * minutes, _PRICE_WITHIN_LIMIT)

    def objective(orders: Int[np.ndarray, "n positions"]) -> Float[np.ndarray, " n"]:
        planned = schedule(responses.cells, orders, times, measured)
        model = scheduled_model(responses, planned, SEARCHED)
        shared = None if table is None else table(planned.start_s) / responses.sd**2
        values = criterion.of(model.shared(model.with_all(shared)))
        over = np.maximum(planned.end_s / limit_s - 1.0, 0.0)
        return np.log(values) + price * np.log(planned.end_s) + np.where(over > 0, 1e3 + 1e6 * over, 0.0)

    return objective


def _mirrored(group: Int[np.ndarray, " cells"], order: Order, rng: np.random.Generator) -> Order:
    """Every visit in two halves: the first halves, then the second ones in the reverse order."""
    halves = [np.array_split(rng.permutation(visit), 2) for visit in np.split(order, _ends(group, order)[1:-1])]
    return np.concatenate([half[0] for half in halves] + [half[1] for half in halves[::-1]])


def _ends(group: Int[np.ndarray, " cells"], order: Order) -> Int[np.ndarray, " ends"]:
    """Where the visits of an order begin, and its length; a visit: positions of one temperature, mounting and pitch setting."""
    return np.concatenate([[0], 1 + np.flatnonzero(np.diff(group[order])), [len(order)]])


def _changed(group: Int[np.ndarray, " cells"], order: Order, rng: np.random.Generator) -> Order:
    """An order with one random change: two positions exchanged, or a stretch reversed or moved."""
    count = len(order)
    if rng.random() < 0.5:
        # Of one pitch setting: that adds no visit.
        first = int(rng.integers(count))
        others = np.flatnonzero(group[order] == group[order[first]]) if rng.random() < _WITHIN else np.arange(count)
        pair = [first, int(rng.choice(others))]
        order = order.copy()
        order[pair] = order[pair[::-1]]
        return order
    ends = _ends(group, order) if rng.random() < _VISITS else np.arange(count + 1)
    first, last = np.sort(rng.choice(ends, 2, replace=False)).tolist()
    part, rest = order[first:last], np.delete(order, np.s_[first:last])
    reverse = rng.random() < 0.5
    at = first if reverse and rng.random() < 0.5 else int(rng.choice(_ends(group, rest)))
    return np.concatenate([rest[:at], part[::-1] if reverse else part, rest[at:]])


def _searched(
    objective: Objective, group: Int[np.ndarray, " cells"], starts: list[Order], rng: np.random.Generator
) -> Order:
    """The best order found from some starts, each improved until changes gain nothing for a while."""
    rounds = max(3, _EFFORT // (_TRIED * len(starts) * len(starts[0])))
    best = np.inf, starts[0]
    for order in starts:
        value, since = float(objective(order[None])[0]), 0
        for _ in range(rounds):
            tried = np.array([_changed(group, order, rng) for _ in range(_TRIED)])
            values = objective(tried)
            at = int(np.argmin(values))
            since = 0 if values[at] < value - _GAIN else since + 1
            if values[at] < value:
                order, value = tried[at], float(values[at])
            if since > _PATIENCE:
                break
        best = min(best, (value, order), key=lambda found: found[0])
    return best[1]
