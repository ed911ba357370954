"""The next position of a running measurement: the one that reduces the criterion most in the time it takes.

A change of the pitch setting or of the mounting pays only after several positions. Therefore a candidate is valued with the
positions that would follow it without a further remount: the best start of that batch counts (look-ahead by batches). As long
as the positions do not determine the parameters of the criterion, the volume of the uncertainty ellipsoid takes its place.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_triangular

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.design.order_value import RIDGE, OfCovariance, OrderValue, shared_covariance
from tumblecal.design.responses import Responses
from tumblecal.design.schedule import Schedule, continued, moves


# Longest batches: without a change of the mounting or the temperature, and with one.
_LONGEST, _LONGEST_AFTER_REMOUNT = 6, 16
# A batch is not continued after so many positions that do not raise its gain per minute.
_PATIENCE = 4
# A criterion that grows by more than this with a hundredth of the ridge is that of parameters that are not determined.
_UNDETERMINED = 1.5


@dataclass(frozen=True)
class NextCell:
    """A candidate for the next position.

    - `cell`: its number. `value`: the criterion after this position. `seconds`: from the last dwell to the end of this one.
    - `batch`: the positions that this one begins; `rate`: reduction of the logarithm of the criterion by them, per minute.
    - `purpose`: the parameter whose standard uncertainty the batch reduces most, relative to the present one;
      `before`, `after`: that uncertainty now and after the batch, base units (infinite: not determined yet).
    """

    cell: int
    value: float
    seconds: float
    batch: tuple[int, ...]
    rate: float
    purpose: str
    before: float
    after: float


def next_cells(
    responses: Responses,
    ability: HeadAbility,
    criterion: OfCovariance,
    measured: Schedule | None,
    remaining_s: float | None = None,
    candidates: Sequence[int] | Int[np.ndarray, " candidates"] | None = None,
) -> tuple[NextCell, ...]:
    """Candidates for the next position, the best one first; empty if none fits into the remaining time.

    **Arguments:**

    - `measured`: the positions so far with the real starts of their dwells; None: none yet.
    - `remaining_s`: time until the end of the measurement, s; None: no limit. `candidates`: numbers of cells (default: all).
    """
    listed = np.arange(len(responses.cells)) if candidates is None else np.unique(np.asarray(candidates, int))
    search = _Batches(responses, ability, criterion, measured, np.inf if remaining_s is None else remaining_s)
    found = [one for cells, longest in search.families(listed) for one in search.of_family(cells, longest)]
    return tuple(sorted(found, key=lambda one: (-one.rate, one.seconds, one.cell)))


class _Batches:
    """Batches of positions after those that are measured."""

    def __init__(
        self,
        responses: Responses,
        ability: HeadAbility,
        criterion: OfCovariance,
        measured: Schedule | None,
        remaining_s: float,
    ) -> None:
        self.values = OrderValue(responses, ability, criterion, np.zeros(0, int), measured, _LONGEST_AFTER_REMOUNT)
        self.responses, self.times, self.criterion = responses, ability.times, criterion
        self.measured, self.remaining_s, self.shared = measured, remaining_s, len(responses.names)
        self.now = self._covariance(measured)
        self.determined = not self._undetermined(measured)
        self.before = self._objective(self.now)

    def families(self, listed: np.ndarray) -> list[tuple[np.ndarray, int]]:
        """Cells that share their batches, and the longest batch: of each pitch setting of the present mounting and temperature,
        and of each other combination of these two."""
        cells = self.responses.cells
        sitting = cells.soak * (cells.mounting.max() + 1) + cells.mounting
        if self.measured is None:
            return [(listed[sitting[listed] == label], _LONGEST_AFTER_REMOUNT) for label in np.unique(sitting[listed])]
        here = sitting[listed] == sitting[self.measured.cells[-1]]
        near, far = listed[here], listed[~here]
        found = [(near[cells.pitch[near] == label], _LONGEST) for label in np.unique(cells.pitch[near])]
        return found + [(far[sitting[far] == label], _LONGEST_AFTER_REMOUNT) for label in np.unique(sitting[far])]

    def of_family(self, cells: np.ndarray, longest: int) -> list[NextCell]:
        """Every cell of a family as the first one of its best batch."""
        batch, first = self._greedy(cells, longest)
        found = []
        for cell, covariance in first.items():
            start = self._extended(self.measured, [cell])
            alone = self._scored(cell, (cell,), covariance, start, float(self.criterion.of(covariance)))
            rest = [other for other in batch if other != cell][: len(batch) - 1]
            following = self._extended(self.measured, [cell, *rest])
            best = alone
            if rest and self._seconds(following) <= self.remaining_s:
                together = self._covariance(following)
                with_rest = self._scored(cell, (cell, *rest), together, following, alone.value, alone.seconds)
                best = max(alone, with_rest, key=lambda one: one.rate)
            found.append(best)
        return found

    def _greedy(self, cells: np.ndarray, longest: int) -> tuple[list[int], dict[int, np.ndarray]]:
        """The batch of the largest gain per minute, one position after the other; covariances after the first position for each
        cell that fits."""
        planned, batch, first = self.measured, list[int](), dict[int, np.ndarray]()
        best, best_rate, present = list[int](), -np.inf, self.before
        for step in range(longest):
            seconds = self._seconds_with(planned, cells)
            fits = seconds <= self.remaining_s
            cells, seconds = cells[fits], seconds[fits]
            if not len(cells):
                break
            covariances = self._after(planned, cells)
            if not step:
                first = dict(zip(cells.tolist(), covariances, strict=True))
            objectives = self._objective(covariances)
            taken = seconds - self._seconds(planned)
            k = int(np.argmax((present - objectives) / taken))
            batch.append(int(cells[k]))
            planned, present = self._extended(planned, batch[-1:]), float(objectives[k])
            rate = (self.before - present) / self._seconds(planned)
            if rate > best_rate:
                best, best_rate = list(batch), rate
            elif len(batch) >= len(best) + _PATIENCE:
                break
        return best, first

    def _kinds(self, planned: Schedule | None, cells: np.ndarray) -> np.ndarray:
        """Number of the kind of each cell: those of one pitch setting, mounting and temperature that take the same time."""
        group = self.responses.cells.group[cells]
        if planned is None:
            return np.unique(group, return_inverse=True)[1].ravel()
        turn = self.responses.cells.alpha_deg[cells] != self.responses.cells.alpha_deg[planned.cells[-1]]
        return np.unique(2 * group + turn, return_inverse=True)[1].ravel()

    def _seconds_with(self, planned: Schedule | None, cells: np.ndarray) -> Float[np.ndarray, " cells"]:
        """Time from the end of the measured positions to that of one more position in each cell."""
        if planned is None:
            return np.full(len(cells), self.times.settle_s + self.times.dwell_s)
        last = np.full(len(cells), planned.cells[-1])
        return self._seconds(planned) + moves(self.responses.cells, last, cells, self.times) + self.times.dwell_s

    def _after(self, planned: Schedule | None, cells: np.ndarray) -> Float[np.ndarray, "cells shared shared"]:
        """Covariances of the shared parameters after one more position in each of some cells."""
        kinds = self._kinds(planned, cells)
        found = np.zeros((len(cells), self.shared, self.shared))
        for kind in range(int(kinds.max()) + 1):
            at = np.flatnonzero(kinds == kind)
            found[at] = self._after_kind(planned, cells[at])
        return found

    def _after_kind(self, planned: Schedule | None, cells: np.ndarray) -> np.ndarray:
        """The same for cells that take the same time: they share noise and visits, and differ in the last rows."""
        longer = self._extended(planned, cells[:1])
        rows, information = self.values.model(longer)
        root = np.linalg.cholesky(self.values.noise(longer))
        before = rows[:-1].reshape(len(rows) - 1, rows[0].size)
        white = solve_triangular(root[:-1, :-1], before, lower=True, check_finite=False) if len(before) else before
        known = (root[-1, :-1] @ white).reshape(rows.shape[1:])
        white = white.reshape(-1, rows.shape[2])
        covariance = np.linalg.inv(information + white.T @ white + RIDGE * np.eye(len(information)))
        new = (self.values.rows_of(longer, cells) - known) / root[-1, -1]
        spread = new @ covariance
        mixed = spread[:, :, : self.shared]
        gain = np.linalg.solve(np.eye(3) + spread @ new.swapaxes(1, 2), mixed)
        return covariance[: self.shared, : self.shared] - mixed.swapaxes(1, 2) @ gain

    def _extended(self, planned: Schedule | None, order: Sequence[int] | np.ndarray) -> Schedule:
        return continued(self.responses.cells, planned, np.asarray(order, int), self.times)

    def _seconds(self, planned: Schedule | None) -> float:
        """Time from the end of the measured positions to that of a schedule."""
        if planned is None:
            return 0.0
        return planned.end_s - (0.0 if self.measured is None else self.measured.end_s)

    def _covariance(self, planned: Schedule | None, ridge: float = RIDGE) -> np.ndarray:
        return shared_covariance(self._information(planned), self.shared, ridge)

    def _information(self, planned: Schedule | None) -> np.ndarray:
        if planned is None:
            return self.responses.information
        rows, information = self.values.model(planned)
        root = np.linalg.cholesky(self.values.noise(planned))
        white = solve_triangular(root, rows.reshape(len(rows), -1), lower=True, check_finite=False)
        white = white.reshape(-1, rows.shape[2])
        return information + white.T @ white

    def _undetermined(self, planned: Schedule | None) -> bool:
        values = [float(self.criterion.of(self._covariance(planned, ridge))) for ridge in (RIDGE, RIDGE / 100)]
        return values[1] > _UNDETERMINED * values[0]

    def _objective(self, covariances: Float[np.ndarray, "*n shared shared"]) -> Float[np.ndarray, "*n"]:
        if self.determined:
            return np.log(self.criterion.of(covariances))
        return np.linalg.slogdet(covariances)[1] / (2 * self.shared)

    def _scored(
        self,
        cell: int,
        batch: tuple[int, ...],
        covariance: np.ndarray,
        planned: Schedule,
        value: float,
        seconds: float | None = None,
    ) -> NextCell:
        """A batch; `covariance`, `planned`: after it; `value`, `seconds`: after its first position."""
        total = self._seconds(planned)
        rate = 60 * float(self.before - self._objective(covariance)) / total
        before, after = (np.sqrt(np.diag(one)) for one in (self.now, covariance))
        k = int(np.argmin(after / before))
        # Without data a parameter has the standard deviation of the ridge.
        sizes = [
            float(sd[k] * self.responses.scales[k]) if sd[k] ** 2 < 0.01 / RIDGE else np.inf for sd in (before, after)
        ]
        return NextCell(
            cell, value, total if seconds is None else seconds, batch, rate, self.responses.names[k], *sizes
        )
