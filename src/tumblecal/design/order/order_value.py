"""The value of an order of positions, and of many exchanges of two positions at once, for a search.

With the covariance of the noise of the dwells, V on each axis, the information on all parameters is R^T V^-1 R plus that of the
priors. An exchange of two positions that leaves starts and visits as they are changes two rows of R on each
axis; the covariance follows exactly from a matrix of 12 rows (Woodbury's identity; Golub and Van Loan 2013, section 2.1.4).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.design.model.cells import Cells
from tumblecal.design.model.responses import Responses, Setting
from tumblecal.design.model.schedule import Schedule, continued
from tumblecal.estimation.visits import visit_precision
from tumblecal.noise.of_head import tabulated_covariance


class OfCovariance(Protocol):
    """A number to be small, from covariances of the scaled shared parameters."""

    def of(self, covariance: Float[np.ndarray, "*n shared shared"], /) -> Float[np.ndarray, "*n"] | float:
        """The number of each."""
        ...


# Information that keeps unknown errors of a visit invertible: a standard deviation of 10,000 scales.
RIDGE = 1e-8
# Informations on visits that are kept for further orders with the same visits.
_MOST_KEPT = 1000
# Exchanges that are evaluated at once: limits memory.
_AT_ONCE = 2048


def shared_covariance(information: Float[np.ndarray, "all all"], shared: int) -> Float[np.ndarray, "shared shared"]:
    """Covariance of the first parameters, for an information that a small ridge makes invertible."""
    flipped = information[::-1, ::-1] + RIDGE * np.eye(len(information))
    root = np.linalg.cholesky(flipped)[-shared:, -shared:]
    inverse = solve_triangular(root, np.eye(shared), lower=True)
    return (inverse.T @ inverse)[::-1, ::-1]


@dataclass(frozen=True)
class State:
    """An order with all that its exchanges need: `rows` (positions, 3, all), g; `weighted`, the same after V^-1; `precision`,
    V^-1; `covariance` (all, all)."""

    schedule: Schedule
    rows: Float[np.ndarray, "positions 3 all"]
    weighted: Float[np.ndarray, "positions 3 all"]
    precision: Float[np.ndarray, "positions positions"]
    covariance: Float[np.ndarray, "all all"]


class OrderValue:
    """Values of the orders of some positions: `order` is a permutation of the positions `listed`, numbers of cells.

    `after`: a schedule that is measured already; the positions continue it.
    """

    def __init__(
        self,
        responses: Responses,
        ability: HeadAbility,
        criterion: OfCovariance,
        listed: Int[np.ndarray, " positions"],
        after: Schedule | None = None,
    ) -> None:
        self.responses, self.ability, self.criterion = responses, ability, criterion
        self.listed, self.after = np.asarray(listed, int), after
        self.fixed = 0 if after is None else len(after)
        times = ability.times
        all_moves = times.settle_s + times.turn_s + times.pitch_change_s + times.remount_s + times.temperature_change_s
        span = 0.0 if after is None else after.end_s - after.start_s[0]
        longest = span + len(self.listed) * (times.dwell_s + all_moves)
        self._precisions = dict[tuple[bool, bytes], np.ndarray]()
        self.slow = tabulated_covariance(ability.slow_noise, times, longest)

    @cached_property
    def group(self) -> Int[np.ndarray, " positions"]:
        """Combination of temperature, mounting and pitch setting of each position."""
        return self.cells.group[self.listed]

    @property
    def cells(self) -> Cells:
        """All cells."""
        return self.responses.cells

    def scheduled(self, order: Int[np.ndarray, " positions"]) -> Schedule:
        """The schedule of an order."""
        return continued(self.cells, self.after, self.listed[order], self.ability.times)

    def noise(self, planned: Schedule) -> Float[np.ndarray, "positions positions"]:
        """Covariance of the means on each axis, g^2."""
        total = self.slow(planned.start_s)
        total[np.diag_indices(len(total))] += self.responses.sd**2
        return total

    def model(self, planned: Schedule) -> tuple[np.ndarray, np.ndarray]:
        """Rows (positions, 3, all) and information of the priors (all, all): `design_of` with fewer operations."""
        settings = self._settings(planned)
        rows = self._embedded(planned, planned.cells, np.arange(len(planned)))
        shared, total = len(self.responses.names), rows.shape[2]
        information = np.zeros((total, total))
        information[:shared, :shared] = self.responses.information
        offset = shared
        for setting, visit, labels, components, visits in settings:
            first = np.concatenate([[0], np.flatnonzero(np.diff(visit)) + 1])
            precision = self._visit_precision(setting, labels[first])
            for _ in range(components):
                information[offset : offset + visits, offset : offset + visits] = precision
                offset += visits
        return rows, information

    def _visit_precision(self, setting: Setting, settings: np.ndarray) -> np.ndarray:
        key = (setting is self.responses.pitch, settings.tobytes())
        if key not in self._precisions:
            if len(self._precisions) > _MOST_KEPT:
                self._precisions.clear()
            self._precisions[key] = visit_precision(setting.common, setting.again, settings)
        return self._precisions[key]

    def value(self, planned: Schedule, *, slow: bool = True) -> float:
        """The criterion of a schedule; without `slow`, as if the slow noise were known."""
        rows, information = self.model(planned)
        flat = rows.reshape(len(rows), -1)
        if slow:
            root = np.linalg.cholesky(self.noise(planned))
            white = solve_triangular(root, flat, lower=True, check_finite=False)
        else:
            white = flat / self.responses.sd
        white = white.reshape(-1, rows.shape[2])
        covariance = shared_covariance(information + white.T @ white, len(self.responses.names))
        return float(self.criterion.of(covariance))

    def state(self, planned: Schedule) -> State:
        """A schedule with all that its exchanges need."""
        rows, information = self.model(planned)
        precision = cho_solve(cho_factor(self.noise(planned)), np.eye(len(rows)))
        weighted = (precision @ rows.reshape(len(rows), -1)).reshape(rows.shape)
        parameters = rows.shape[2]
        information += rows.reshape(-1, parameters).T @ weighted.reshape(-1, parameters)
        covariance = np.linalg.inv(information + RIDGE * np.eye(parameters))
        return State(planned, rows, weighted, precision, covariance)

    def exchanges(self, state: State, pairs: Int[np.ndarray, "pairs 2"]) -> Float[np.ndarray, " pairs"]:
        """The criterion after the exchange of two positions of a schedule that have the same group, starts and visits kept."""
        parts = [self._exchanges(state, pairs[k : k + _AT_ONCE]) for k in range(0, len(pairs), _AT_ONCE)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _exchanges(self, state: State, pairs: np.ndarray) -> np.ndarray:
        count, shared = len(pairs), len(self.responses.names)
        first, second = pairs.T
        changes = np.stack([self._changed(state, first, second), self._changed(state, second, first)], axis=1)
        weighted = state.weighted[pairs]
        # (pairs, 12, all): the weighted rows of both positions, then the changes of both.
        sides = np.concatenate([weighted, changes], axis=1).reshape(count, 12, -1)
        spread = sides @ state.covariance
        between = spread @ sides.swapaxes(1, 2)
        weights = state.precision[pairs[:, :, None], pairs[:, None, :]]
        axes = np.eye(3)
        between[:, :6, :6] -= np.einsum("pij,ab->piajb", weights, axes).reshape(count, 6, 6)
        between[:, :6, 6:] += np.eye(6)
        between[:, 6:, :6] += np.eye(6)
        mixed = spread[:, :, :shared]
        removed = mixed.swapaxes(1, 2) @ np.linalg.solve(between, mixed)
        return np.asarray(self.criterion.of(state.covariance[:shared, :shared] - removed))

    def _changed(self, state: State, at: np.ndarray, by: np.ndarray) -> Float[np.ndarray, "pairs 3 all"]:
        """The change of the rows of the positions `at` if they get the cells of the positions `by`."""
        planned = state.schedule
        return self._embedded(planned, planned.cells[by], at) - state.rows[at]

    def _embedded(self, planned: Schedule, cells: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Rows of cells at positions of a schedule."""
        settings = self._settings(planned)
        total = sum(components * visits for *_, components, visits in settings)
        offset, here = len(self.responses.names), np.arange(len(cells))
        rows = np.zeros((len(cells), 3, offset + total))
        rows[:, :, :offset] = self.responses.columns[cells]
        for setting, visit, _, components, visits in settings:
            for component in range(components):
                rows[here, :, offset + visit[at]] = setting.columns[cells, :, component]
                offset += visits
        return rows

    def _settings(self, planned: Schedule) -> list[tuple[Setting, np.ndarray, np.ndarray, int, int]]:
        """Settings with errors: number of the visit and of the setting of each position, components, number of visits."""
        responses = self.responses
        return [
            (setting, visit, labels[planned.cells], setting.columns.shape[2], int(visit[-1]) + 1)
            for setting, visit, labels in (
                (responses.pitch, planned.pitch_visit, self.cells.pitch),
                (responses.mount, planned.mount_visit, self.cells.mounting),
            )
            if not setting.exact
        ]
