"""The order of the positions of a plan under slow noise, with the costs of transitions and with settings that are set again.

A trend-free order keeps drift out of the parameters, but changes of pitch setting and mounting take time and add errors when
they are set again (Tack and Vandebroek 2004, Budget constrained run orders in optimum design, Journal of Statistical Planning
and Inference 124). The search exchanges positions of one pitch setting and mounting (all pairs at once). It also exchanges,
reverses, moves, splits and joins visits, from several starts.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.design.model.information import design_of, information_of, noise_covariance
from tumblecal.design.model.limits import in_order
from tumblecal.design.model.responses import Responses
from tumblecal.design.model.schedule import Schedule
from tumblecal.design.order.order_moves import changed, mirrored, nested, pairs_of_groups
from tumblecal.design.order.order_value import OfCovariance, OrderValue, shared_covariance
from tumblecal.ground.errors import InputError


Kind = Literal["best", "random", "keep"]

# Exponent of the duration in the objective. Without a limit a longer order must pay: repeating a measurement reduces all
# standard deviations by the square root of the time. With a limit time up to it is free, but not wasted on negligible gains.
_PRICE, _PRICE_WITHIN_LIMIT = 0.5, 0.02
# A long order this close to the value with the slow noise known is not improved further; nor is a gain below `_GAIN` pursued.
_CLOSE, _GAIN = 1e-3, 1e-6
# Up to so many positions are searched with more effort.
_FEW = 60
# Changes of visits that are tried in a round, exchanges that are evaluated in a step of polishing, and the most steps.
_TRIED, _PAIRS, _STEPS = 12, 500, 30


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
    rng = np.random.default_rng(seed)
    values = OrderValue(responses, ability, criterion, np.asarray(cells, int), after)
    if kind == "keep":
        order = np.arange(len(values.listed))
    elif kind == "random":
        order = _fitting(values, shortest(values, rng), minutes)
    else:
        order = _Search(values, rng, minutes).run()
    planned = values.scheduled(order)
    if minutes is not None and planned.minutes > minutes:
        least, here = ("at least ", "") if kind == "best" else ("", " in this order")
        needed = f"{len(planned)} positions need {least}{np.ceil(planned.minutes):.0f} min{here}"
        raise InputError(f"{needed}, but {minutes:g} min are allowed; allow more time or fewer positions")
    design = design_of(responses, planned)
    white = np.tile(responses.sd**2 * np.eye(len(planned)), (3, 1, 1))
    value, known = (
        float(criterion.of(shared_covariance(information_of(design, noise), design.shared)))
        for noise in (noise_covariance(responses, planned, ability), white)
    )
    return Ordered(planned, value, known)


def shortest(values: OrderValue, rng: np.random.Generator | None) -> np.ndarray:
    """An order with one visit of each pitch setting and mounting, and the fewest remounts and changes of temperature; random,
    or by increasing spindle angle."""
    cells = values.cells
    by_angle = np.argsort(cells.alpha_deg[values.listed], kind="stable")
    order = by_angle if rng is None else rng.permutation(by_angle)
    if values.after is not None:
        # The settings of the last measured position come first.
        last = values.after.cells[-1]
        for label in (cells.pitch, cells.mounting, cells.soak):
            order = order[np.argsort(label[values.listed[order]] != label[last], kind="stable")]
    return nested(order, *(label[values.listed] for label in (cells.soak, cells.mounting, cells.pitch)))


def _fitting(values: OrderValue, order: np.ndarray, minutes: float | None) -> np.ndarray:
    """The order, or if it does not fit the given one, or one with fewer turns of the spindle, or the shortest of these."""
    if minutes is None or values.scheduled(order).minutes <= minutes:
        return order
    given = np.arange(len(order))
    # The canonical order turns the spindle least; positions of one cell come in the order given.
    canonical, by_cell = in_order(values.cells, values.listed), np.argsort(values.listed, kind="stable")
    turned = np.zeros_like(given)
    turned[np.argsort(canonical, kind="stable")] = by_cell
    others = [given, shortest(values, None), turned]
    return next((one for one in others if values.scheduled(one).minutes <= minutes), min(others, key=_minutes(values)))


def _minutes(values: OrderValue) -> Callable[[np.ndarray], float]:
    return lambda order: values.scheduled(order).minutes


class _Search:
    """A search from several starts: `value` of orders, a random generator, a limit of the duration in min."""

    def __init__(self, values: OrderValue, rng: np.random.Generator, minutes: float | None) -> None:
        self.values, self.rng = values, rng
        self.limit_s = np.inf if minutes is None else 60 * minutes
        # Effort: rounds for each start, orders that are polished in a round; an evaluation takes longer for more positions.
        self.few = len(values.listed) <= _FEW
        self.rounds, self.polished = (18, 2) if self.few else (30, 1)
        self.price = _PRICE if minutes is None else _PRICE_WITHIN_LIMIT

    def run(self) -> np.ndarray:
        """The best order found."""
        values, rng = self.values, self.rng
        if len(values.listed) < 2:
            return np.arange(len(values.listed))
        given = np.arange(len(values.listed))
        starts = [given, mirrored(shortest(values, rng), values.group, rng)]
        if self.few:
            starts += [shortest(values, rng), rng.permutation(given), mirrored(given, values.group, rng)]
        starts = [_fitting(values, start, self.limit_s / 60) for start in starts]
        best = self._improved(starts[0])
        for start in starts[1:]:
            if not self.few and self._close(best[1]):
                break
            best = min(best, self._improved(start), key=lambda found: found[0])
        return best[1]

    def _close(self, order: np.ndarray) -> bool:
        planned = self.values.scheduled(order)
        return self.values.value(planned) < (1 + _CLOSE) * self.values.value(planned, slow=False)

    def _fits(self, order: np.ndarray) -> bool:
        return self.values.scheduled(order).end_s <= self.limit_s

    def _objective(self, order: np.ndarray) -> float:
        planned = self.values.scheduled(order)
        if planned.end_s > self.limit_s:
            return np.inf
        return float(np.log(self.values.value(planned)) + self.price * np.log(planned.end_s))

    def _improved(self, order: np.ndarray) -> tuple[float, np.ndarray]:
        """The best order from one start by rounds of changes of visits, the most promising ones polished."""
        best = self._polished(order)
        for _ in range(self.rounds):
            tried = [self._changed(best[1]) for _ in range(_TRIED)]
            sizes = np.array([self._objective(order) for order in tried])
            chosen = [tried[k] for k in np.argsort(sizes, kind="stable")[: self.polished] if np.isfinite(sizes[k])]
            found = min((self._polished(order) for order in chosen), key=lambda found: found[0], default=best)
            if found[0] < best[0] - _GAIN:
                best = found
        return best

    def _changed(self, order: np.ndarray) -> np.ndarray:
        """An order after one or two random changes of its visits."""
        for _ in range(self.rng.integers(1, 3)):
            order = changed(order, self.values.group, self.rng)
        return order

    def _polished(self, order: np.ndarray) -> tuple[float, np.ndarray]:
        """An order with exchanges of positions of one group, as long as they gain; with its objective."""
        values, order, size = self.values, order.copy(), self._objective(order)
        for _ in range(_STEPS):
            planned = values.scheduled(order)
            pairs = pairs_of_groups(values.group[order], _PAIRS, self.rng) + values.fixed
            gained = np.log(values.exchanges(values.state(planned), pairs)) + self.price * np.log(planned.end_s)
            ranked = np.argsort(gained, kind="stable")
            ranked = ranked[gained[ranked] < size - _GAIN]
            taken = _disjoint(pairs[ranked] - values.fixed)
            if planned.end_s + 4 * len(taken) * values.ability.times.turn_s > self.limit_s:
                # An exchange may need a turn of the spindle more at each of its four neighbours.
                taken = _disjoint(
                    [pair for pair in pairs[ranked] - values.fixed if self._fits(_exchanged(order, [pair]))]
                )
            # Exchanges that gain or fit one by one may not do so together: fewer are tried.
            while len(taken):
                trial = _exchanged(order, taken)
                if (new := self._objective(trial)) < size - _GAIN:
                    order, size = trial, new
                    break
                taken = taken[: len(taken) // 2]
            else:
                break
        return size, order


def _exchanged(order: np.ndarray, pairs: Iterable[Iterable[int]]) -> np.ndarray:
    order = order.copy()
    for first, second in pairs:
        order[[first, second]] = order[[second, first]]
    return order


def _disjoint(pairs: Iterable[Iterable[int]]) -> list[tuple[int, int]]:
    """The first pairs that have no position in common."""
    used, taken = set[int](), list[tuple[int, int]]()
    for first, second in pairs:
        if first not in used and second not in used:
            used |= {first, second}
            taken.append((first, second))
    return taken
