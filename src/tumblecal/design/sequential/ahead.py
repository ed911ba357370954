"""The positions that a running measurement still needs, planned from those measured so far (receding horizon).

The rest of a measurement is planned like a whole one: by exchange under the times of the head, with the settings and the
information that there are. With a goal it is the shortest plan that reaches it. Only the first position is measured before the
next plan, so positions that are skipped, repeated or noisier than stated need no rule.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.design.criteria.criterion import Criterion
from tumblecal.design.criteria.measure import Measures, measures
from tumblecal.design.model.limits import limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import Responses
from tumblecal.design.model.schedule import Schedule, continued, moves
from tumblecal.design.order.best_order import valued
from tumblecal.design.positions.exchange import exchange
from tumblecal.ground.errors import InputError


# Plans have at most this number of positions; the duration of the shortest one is found to within this part of a position.
MOST_AHEAD, _RESOLUTION = 48, 0.5
# Durations are tried from this number of positions on, each at most so many times as long as the last one.
_FIRST, _LONGER = 6, 2.5
_RESTARTS = 1


@dataclass(frozen=True)
class Ahead:
    """Further positions in measuring order, the schedule with them, and the criterion after it."""

    cells: Int[np.ndarray, " positions"]
    schedule: Schedule
    value: float

    def first_visit(self, responses: Responses) -> Int[np.ndarray, " positions"]:
        """The positions before the next change of the pitch setting."""
        groups = responses.cells.group[self.cells]
        return self.cells[: int(np.argmin(np.append(groups, -1) == groups[0]))]


@dataclass(frozen=True)
class Planner:
    """Plans the rest of a measurement.

    - `measured`: the positions so far; None: none yet. `allowed`: cells that may be chosen.
    """

    responses: Responses
    ability: HeadAbility
    criterion: Criterion
    measured: Schedule | None
    allowed: Bool[np.ndarray, " cells"]

    def plan(self, remaining_s: float, goal: float | None = None, most: int = MOST_AHEAD) -> Ahead | None:
        """The best plan of at most `most` positions in the remaining time, or the shortest one found that has a criterion of at
        most `goal`; None if no position fits."""
        position_s = self.ability.times.dwell_s + self.ability.times.settle_s
        longest = min(remaining_s, self._move_s + most * (position_s + self.ability.times.turn_s))
        duration = longest if goal is None else min(longest, self._move_s + _FIRST * position_s)
        short, long, best, start = 0.0, np.inf, None, ()
        while True:
            found = self._within(duration, most, start)
            if goal is None or (found is None and duration >= longest):
                return found
            if found is not None and found.value <= goal:
                best, long, start = found, duration, ()
            elif duration >= longest:
                return best or found
            else:
                short, start = duration, () if found is None else (found.cells,)
            if long - short <= 2 * _RESOLUTION * position_s:
                return best
            # The information, 1 / criterion^2, grows at most in proportion to the duration.
            guess = duration * (1.5 if found is None else (found.value / goal) ** 2)
            most_s = min(longest, _LONGER * duration) if best is None else long - _RESOLUTION * position_s
            duration = min(max(guess, short + _RESOLUTION * position_s), most_s)

    @property
    def _move_s(self) -> float:
        """Time of the longest move to the next position."""
        allowed = np.flatnonzero(self.allowed)
        if self.measured is None or not len(allowed):
            return 0.0
        last = np.full(len(allowed), self.measured.cells[-1])
        return float(np.max(moves(self.responses.cells, last, allowed, self.ability.times)))

    def _within(self, seconds: float, most: int, starts: Sequence[np.ndarray]) -> Ahead | None:
        """The best plan that takes at most this time."""
        cells, present = self.responses.cells, None if self.measured is None else int(self.measured.cells[-1])
        try:
            limits = limits_of(
                cells,
                self.ability,
                count=most,
                minutes=seconds / 60,
                allowed=self.allowed,
                repeats=most,
                present=present,
            )
        except InputError:
            return None
        taken = exchange(limits, self._measures, restarts=_RESTARTS, starts=starts).cells
        planned = continued(cells, self.measured, taken, self.ability.times)
        return Ahead(taken, planned, self.value(planned))

    @cached_property
    def _measures(self) -> Measures:
        return measures(one_visit(self.responses, running=self.measured), self.criterion)

    def value(self, planned: Schedule) -> float:
        """The criterion after a schedule, slow noise included."""
        return valued(self.responses, self.ability, self.criterion, planned).value
