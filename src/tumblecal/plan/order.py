"""The order of the positions of a plan under slow noise, with the costs of transitions and with settings that are set again.

A trend-free order keeps drift out of the parameters, but changes of pitch setting and mounting take time and add errors when
they are set again (Tack and Vandebroek 2004, Budget constrained run orders in optimum design, Journal of Statistical Planning
and Inference 124). Many changes of an order are evaluated at once, and the best one is kept: two positions exchanged, or visits
exchanged, reversed, moved, split and joined.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.ground.errors import InputError
from tumblecal.noise.of_head import tabulated_covariance
from tumblecal.plan.limits import in_order, sittings_in_order
from tumblecal.plan.linear_model import SEARCHED, scheduled_model, shared_covariance
from tumblecal.plan.responses import Responses
from tumblecal.plan.schedule import Schedule, schedule
from tumblecal.plan.uncertainties import information_of, uncertainties


Kind = Literal["best", "random", "keep"]
Order = Int[np.ndarray, " positions"]


class OfCovariance(Protocol):
    """A number to be small, from covariances of the scaled shared parameters."""

    def of(self, covariance: Float[np.ndarray, "*n shared shared"], /) -> Float[np.ndarray, "*n"]:
        """The number of each."""
        ...


# Exponent of the duration in the objective. Without a limit a longer order must pay: repeating a measurement reduces all
# standard deviations by the square root of the time. With a limit time up to it is free, but not wasted on negligible gains.
_PRICE, _PRICE_WITHIN_LIMIT = 0.5, 0.02
# Changes that are evaluated at once, rounds without a gain after which a start is given up, and the least gain.
_TRIED, _PATIENCE, _GAIN = 48, 12, 1e-5
# Evaluations of a search are limited to so many, divided by the number of positions.
_EFFORT = 150_000


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
    criterion: OfCovariance,
    cells: Int[np.ndarray, " positions"],
    *,
    minutes: float | None = None,
    seed: int = 0,
    kind: Kind = "best",
    after: Schedule | None = None,
) -> Ordered:
    """The order of some positions; its criterion is huge if the positions do not determine the parameters.

    **Arguments:**

    - `cells`: numbers of cells; one may be listed several times.
    - `minutes`: limit of the whole schedule. If not stated, an order that takes longer must pay for it: criterion times the
      square root of the duration is minimised.
    - `kind`: `"keep"`: the order given; `"random"`: one visit of each pitch setting and mounting, visits and their positions in
      random order; `"best"`: the least criterion.
    - `after`: positions that are measured already; the order continues them.

    **Raises:** `InputError` if the positions need more than `minutes`.
    """
    orders = _Orders(responses, ability, criterion, np.asarray(cells, int), minutes, after)
    rng, given = np.random.default_rng(seed), np.arange(len(cells))
    # The canonical order turns the spindle least; positions of one cell come in the order given.
    shortest = np.empty_like(given)
    canonical = in_order(orders.cells, orders.listed, orders.present)
    shortest[np.argsort(canonical, kind="stable")] = np.argsort(orders.listed, kind="stable")
    if kind == "keep":
        order = given
    elif kind == "random":
        order = next((one for one in (orders.random(rng), given, shortest) if orders.fits(one)), shortest)
    else:
        starts = [given, shortest, orders.mirrored(orders.random(rng), rng), orders.mirrored(given, rng)]
        order = _searched(orders, starts, rng) if len(given) > 1 else given
    planned = orders.scheduled(order)
    if minutes is not None and planned.minutes > minutes:
        least, here = ("at least ", "") if kind == "best" else ("", " in this order")
        needed = f"{len(planned)} positions need {least}{np.ceil(planned.minutes):.0f} min{here}"
        raise InputError(f"{needed}, but {minutes:g} min are allowed; allow more time or fewer positions")
    model = scheduled_model(responses, planned)
    known = shared_covariance(information_of(model, None), len(model.names))
    value = criterion.of(uncertainties(responses, planned, ability).covariance)
    return Ordered(planned, float(value), float(criterion.of(known)))


class _Orders:
    """Orders of some positions, numbers of cells: their schedules, values and changes."""

    def __init__(
        self,
        responses: Responses,
        ability: HeadAbility,
        criterion: OfCovariance,
        listed: Order,
        minutes: float | None,
        after: Schedule | None,
    ) -> None:
        self._responses, self._ability, self._criterion, self._after = responses, ability, criterion, after
        self.listed, self.cells = listed, responses.cells
        self._limit_s = np.inf if minutes is None else 60 * minutes
        self._price = _PRICE if minutes is None else _PRICE_WITHIN_LIMIT
        self.group, self.present = self.cells.group[listed], None if after is None else int(after.cells[-1])
        times = ability.times
        longest = times.settle_s + times.turn_s + times.pitch_change_s + times.remount_s + times.temperature_change_s
        span = 0.0 if after is None else after.end_s - after.start_s[0]
        slow = ability.slow_noise
        self._slow = (
            tabulated_covariance(slow, times, span + len(listed) * (times.dwell_s + longest)) if slow.any else None
        )

    def scheduled(self, orders: Int[np.ndarray, "*n positions"]) -> Schedule:
        """The schedule of each order."""
        return schedule(self.cells, self.listed[orders], self._ability.times, self._after)

    def fits(self, order: Order) -> bool:
        """Whether an order takes no longer than the limit."""
        return bool(self.scheduled(order).end_s <= self._limit_s)

    def objective(self, orders: Int[np.ndarray, "n positions"]) -> Float[np.ndarray, " n"]:
        """Logarithm of the criterion with the price of the duration; the excess over a limit is added at a high price."""
        planned = self.scheduled(orders)
        model = scheduled_model(self._responses, planned, SEARCHED)
        slow = None if self._slow is None else self._slow(planned.start_s) / self._responses.sd**2
        values = self._criterion.of(shared_covariance(information_of(model, slow), len(model.names)))
        end_s = np.asarray(planned.end_s)
        over = np.maximum(end_s / self._limit_s - 1.0, 0.0)
        return np.log(values) + self._price * np.log(end_s) + np.where(over > 0, 1e3 + 1e6 * over, 0.0)

    def random(self, rng: np.random.Generator) -> Order:
        """One visit of each pitch setting and mounting in random order, with the fewest remounts and changes of temperature."""
        sitting = list(
            zip(self.cells.soak[self.listed].tolist(), self.cells.mounting[self.listed].tolist(), strict=True)
        )
        first = self.present
        now = None if first is None else (int(self.cells.soak[first]), int(self.cells.mounting[first]))
        rank = sittings_in_order(tuple(sorted({*sitting})), now)[1]
        group = rng.permutation(int(self.cells.group.max()) + 1)
        if first is not None:
            group[self.cells.group[first]] = -1
        return np.lexsort((rng.random(len(sitting)), group[self.group], np.array([rank.index(one) for one in sitting])))

    def visits(self, order: Order) -> list[Order]:
        """The visits of an order: stretches of positions of one temperature, mounting and pitch setting."""
        return np.split(order, np.flatnonzero(np.diff(self.group[order])) + 1)

    def mirrored(self, order: Order, rng: np.random.Generator) -> Order:
        """Every visit in two halves: the first halves, then the second ones in the reverse order."""
        halves = [np.array_split(rng.permutation(visit), 2) for visit in self.visits(order)]
        return np.concatenate([half[0] for half in halves] + [half[1] for half in halves[::-1]])

    def changed(self, order: Order, rng: np.random.Generator) -> Order:
        """An order with one random change: two positions, or two visits, exchanged; visits or their positions reversed; a visit
        moved, split, or joined with another one of its settings."""
        parts, kind = self.visits(order), int(rng.integers(10))
        first, last = np.sort(rng.integers(len(parts), size=2))
        if kind < 5 or len(parts) == 1:
            # Of one pitch setting, if there are two: that adds no visit.
            within = parts[first] if len(parts[first]) > 1 and kind else order
            one, other = rng.choice(within, min(2, len(within)), replace=False)[[0, -1]]
            order = order.copy()
            order[(order == one) | (order == other)] = order[(order == one) | (order == other)][::-1]
            return order
        if kind == 5:
            parts[first], parts[last] = parts[last], parts[first]
        elif kind == 6:
            parts[first : last + 1] = parts[first : last + 1][::-1]
        elif kind == 7:
            parts.insert(int(rng.integers(len(parts))), parts.pop(first))
        elif kind == 8:
            some = rng.permutation(parts[first])
            share = int(rng.integers(1, max(len(some), 2)))
            parts[first] = some[share:]
            parts.insert(int(rng.integers(len(parts) + 1)), some[:share])
        else:
            same = [
                k for k in range(len(parts)) if k != first and self.group[parts[k][0]] == self.group[parts[first][0]]
            ]
            if same:
                into = int(rng.choice(same))
                parts[into] = np.concatenate([parts[into], parts[first]])
                parts.pop(first)
            else:
                parts[first : last + 1] = [np.concatenate(parts[first : last + 1])[::-1]]
        return np.concatenate(parts)


def _searched(orders: _Orders, starts: list[Order], rng: np.random.Generator) -> Order:
    """The best order found from some starts, each improved until changes gain nothing for a while."""
    rounds = max(3, _EFFORT // (_TRIED * len(starts) * len(orders.listed)))
    best = np.inf, starts[0]
    for order in starts:
        value, since = float(orders.objective(order[None])[0]), 0
        for _ in range(rounds):
            tried = np.array([orders.changed(order, rng) for _ in range(_TRIED)])
            values = orders.objective(tried)
            at = int(np.argmin(values))
            since = 0 if values[at] < value - _GAIN else since + 1
            if values[at] < value:
                order, value = tried[at], float(values[at])
            if since > _PATIENCE:
                break
        best = min(best, (value, order), key=lambda found: found[0])
    return best[1]
