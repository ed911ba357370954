"""The order of the positions of a plan under slow noise, with the costs of transitions and with settings that are set again.

A trend-free order keeps drift out of the parameters, but changes of pitch setting and mounting take time and add errors when
they are set again (Tack and Vandebroek 2004, Budget constrained run orders in optimum design, Journal of Statistical Planning
and Inference 124). Many changes of an order are evaluated at once, and the best one is kept: two positions exchanged, or a
stretch of positions moved or reversed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.errors import InputError
from tumblecal.noise.of_head import tabulated_covariance
from tumblecal.plan.cells import Labels, Numbers
from tumblecal.plan.criterion import Criterion
from tumblecal.plan.information import SEARCHED, scheduled_model, uncertainties
from tumblecal.plan.limits import Schedule, in_order, schedule
from tumblecal.plan.responses import Responses


Kind = Literal["best", "random", "keep"]
# Exponent of the duration in the objective. Without a limit a longer order must pay: repeating a measurement reduces all
# standard deviations by the square root of the time. With a limit time up to it is free, but not wasted on negligible gains.
_PRICE, _PRICE_WITHIN_LIMIT = 0.5, 0.02
# Changes that are evaluated at once, rounds without a gain after which a start is given up, and the least gain.
_TRIED, _PATIENCE, _GAIN = 48, 12, 1e-5
# Evaluations of a search are limited to so many, divided by the number of positions.
_EFFORT = 150_000
# Share of the exchanges within a pitch setting, and of the stretches that are whole visits.
_WITHIN = 0.75


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
    cells: Numbers,
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
    rng, times, of, order = np.random.default_rng(seed), ability.times, responses.cells, np.asarray(cells, int)
    present, limit_s = int(measured[-1]) if len(measured) else None, np.inf if minutes is None else 60 * minutes
    shortest, random = in_order(of, order, present), in_order(of, order, present, rng)
    if kind == "random":
        order = shortest if schedule(of, random, times, measured).end_s > limit_s else random
    elif kind == "best" and len(order) > 1:
        table, price = None, _PRICE if minutes is None else _PRICE_WITHIN_LIMIT
        if ability.slow_noise.any:
            longest = (
                times.settle_s + times.turn_s + times.pitch_change_s + times.remount_s + times.temperature_change_s
            )
            table = tabulated_covariance(
                ability.slow_noise, times, (len(measured) + len(order)) * (times.dwell_s + longest)
            )

        def objective(orders: Numbers) -> Float[np.ndarray, " n"]:
            """Logarithm of the criterion of orders with the price of the duration; an excess over the limit costs more than
            any criterion."""
            planned = schedule(of, orders, times, measured)
            model = scheduled_model(responses, planned, SEARCHED)
            slow = None if table is None else table(planned.start_s) / responses.sd**2
            values = np.log(criterion.of(model.shared(model.with_all(slow)))) + price * np.log(planned.end_s)
            return np.where(planned.end_s > limit_s, 1e3 + 1e6 * (planned.end_s / limit_s - 1), values)

        starts = [order, shortest, *(_mirrored(of.group, one, rng) for one in (random, order))]
        rounds, found = max(3, _EFFORT // (_TRIED * len(starts) * len(order))), list[tuple[float, Numbers]]()
        for start in starts:
            best, value, since = start, float(objective(start[None])[0]), 0
            for _ in range(rounds):
                tried = np.array([_changed(of.group, best, rng) for _ in range(_TRIED)])
                values = objective(tried)
                least = int(np.argmin(values))
                since = 0 if values[least] < value - _GAIN else since + 1
                if values[least] < value:
                    best, value = tried[least], float(values[least])
                if since > _PATIENCE:
                    break
            found.append((value, best))
        order = min(found, key=lambda one: one[0])[1]
    planned = schedule(of, order, times, measured)
    if planned.end_s > limit_s * (1 + 1e-12):
        least, here = ("at least ", "") if kind == "best" else ("", " in this order")
        needed = f"{len(planned)} positions need {least}{np.ceil(planned.minutes):.0f} min{here}"
        raise InputError(f"{needed}, but {minutes:g} min are allowed; allow more time or fewer positions")
    model = scheduled_model(responses, planned)
    value = criterion.of(uncertainties(responses, planned, ability).covariance)
    return Ordered(planned, float(value), float(criterion.of(model.shared(model.with_all()))))


def _mirrored(group: Labels, order: Numbers, rng: np.random.Generator) -> Numbers:
    """Every visit in two halves: the first halves, then the second ones in the reverse order."""
    halves = [np.array_split(rng.permutation(visit), 2) for visit in np.split(order, _ends(group, order)[1:-1])]
    return np.concatenate([half[0] for half in halves] + [half[1] for half in halves[::-1]])


def _ends(group: Labels, order: Numbers) -> Numbers:
    """Where the visits of an order begin, and its length; a visit: positions of one temperature, mounting and pitch setting."""
    return np.concatenate([[0], 1 + np.flatnonzero(np.diff(group[order])), [len(order)]])


def _changed(group: Labels, order: Numbers, rng: np.random.Generator) -> Numbers:
    """An order with one random change: two positions exchanged, or a stretch reversed or moved."""
    every, within = np.arange(len(order) + 1), rng.random() < _WITHIN
    if rng.random() < 0.5:
        # Of one pitch setting: that adds no visit.
        first = int(rng.integers(len(order)))
        others = np.flatnonzero(group[order] == group[order[first]]) if within else every[:-1]
        pair, order = [first, int(rng.choice(others))], order.copy()
        order[pair] = order[pair[::-1]]
        return order
    first, last = np.sort(rng.choice(_ends(group, order) if within else every, 2, replace=False)).tolist()
    part, rest = order[first:last], np.delete(order, np.s_[first:last])
    reverse = rng.random() < 0.5
    at = first if reverse and rng.random() < 0.5 else int(rng.choice(_ends(group, rest)))
    return np.concatenate([rest[:at], part[::-1] if reverse else part, rest[at:]])
