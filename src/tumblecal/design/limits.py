"""The limits of a plan, number of positions and time, and the positions that still fit."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from tumblecal.chain.head_ability import HeadAbility, Times
from tumblecal.design.cells import Cells
from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class Limits:
    """The largest number of positions and the longest duration, s; infinite: no limit.

    `repeats`: largest number of positions in one cell. `allowed`: cells that may be chosen. `present`: cell in which the head
    is before the first position, which is then reached by a move; None: the first position is set already.
    """

    cells: Cells
    times: Times
    count: float
    seconds: float
    repeats: int
    allowed: Bool[np.ndarray, " cells"]
    present: int | None = None

    @cached_property
    def sitting(self) -> Int[np.ndarray, " cells"]:
        """Number of the combination of temperature and mounting of each cell."""
        pairs = np.stack([self.cells.soak, self.cells.mounting], axis=1)
        return np.unique(pairs, axis=0, return_inverse=True)[1].ravel()

    @property
    def timed(self) -> bool:
        """Whether the duration is limited."""
        return bool(np.isfinite(self.seconds))


def limits_of(
    cells: Cells,
    ability: HeadAbility,
    *,
    count: int | None = None,
    minutes: float | None = None,
    allowed: Bool[np.ndarray, " cells"] | None = None,
    repeats: int = 1,
    present: int | None = None,
) -> Limits:
    """The limits of a plan: `count` positions, or as many as are best within `minutes`, or both.

    `allowed`: cells that may be chosen; all if omitted. `repeats`: largest number of positions in one cell. `present`: the
    cell of the last position of a running measurement.

    **Raises:** `InputError` if neither a number nor a duration is stated, or no position fits.
    """
    if count is None and minutes is None:
        raise InputError("a plan needs a number of positions or a duration; state one")
    mask = np.ones(len(cells), bool) if allowed is None else np.asarray(allowed, bool)
    seconds = np.inf if minutes is None else 60.0 * minutes
    limits = Limits(cells, ability.times, np.inf if count is None else count, seconds, repeats, mask, present)
    if not np.any(Occupied(limits).fits()):
        least = (ability.times.dwell_s + ability.times.settle_s) / 60
        raise InputError(f"no position fits; one takes {least:.3g} min, in an allowed setting")
    return limits


@dataclass
class Occupied:
    """How often each cell is occupied; with that, its pitch settings, mountings and temperatures, each visited once."""

    limits: Limits
    cell: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        cells, present = self.limits.cells, self.limits.present
        self.cell = np.zeros(len(cells), int)
        self._group, self._sitting, self._soak = (
            np.zeros(int(label.max()) + 1, int) for label in (cells.group, self.limits.sitting, cells.soak)
        )
        self._set = np.zeros(len(cells), int)
        if present is not None:
            self._count(present, 1)

    def change(self, cell: int, by: int) -> None:
        """Add a position (1) or remove it (-1)."""
        self.cell[cell] += by
        self._count(cell, by)

    def _count(self, cell: int, by: int) -> None:
        """Count the settings of a cell."""
        cells = self.limits.cells
        self._set[cell] += by
        self._group[cells.group[cell]] += by
        self._sitting[self.limits.sitting[cell]] += by
        self._soak[cells.soak[cell]] += by

    @property
    def seconds(self) -> float:
        """Duration: at most this, since the spindle need not turn at every change of the pitch setting."""
        times, total = self.limits.times, int(self.cell.sum())
        if not total:
            return 0.0
        distinct, groups, sittings, soaks = (
            int(np.count_nonzero(counts)) for counts in (self._set, self._group, self._sitting, self._soak)
        )
        return (
            total * (times.dwell_s + times.settle_s)
            + (distinct - 1) * times.turn_s
            + (groups - 1) * times.pitch_change_s
            + (sittings - soaks) * times.remount_s
            + (soaks - 1) * times.temperature_change_s
        )

    def fits(self) -> Bool[np.ndarray, " cells"]:
        """Cells in which one more position can be measured."""
        limits, cells, times = self.limits, self.limits.cells, self.limits.times
        total = int(self.cell.sum())
        if total + 1 > limits.count:
            return np.zeros(len(cells), bool)
        free = limits.allowed & (self.cell < limits.repeats)
        if not limits.timed:
            return free
        left = limits.seconds - self.seconds - times.dwell_s - times.settle_s + 1e-9
        if not total and limits.present is None:
            return free & (left >= 0)
        new_soak = (self._soak == 0)[cells.soak]
        more = (
            times.turn_s * (self._set == 0)
            + times.pitch_change_s * (self._group == 0)[cells.group]
            + times.remount_s * ((self._sitting == 0)[limits.sitting] & ~new_soak)
            + times.temperature_change_s * new_soak
        )
        return free & (more <= left)


def in_order(
    cells: Cells, taken: Sequence[int] | np.ndarray, present: int | None = None
) -> Int[np.ndarray, " positions"]:
    """Cells in an order that visits each setting once: temperatures upwards, mountings and pitch settings there and back, and
    within a pitch setting one turn of the spindle from its last angle on. Those of the `present` cell come first."""
    taken, order = np.asarray(taken, int), list[int]()
    angle = 0.0 if present is None else float(cells.alpha_deg[present])
    soaks, mountings, pitches = (_Labels(each, present) for each in (cells.soak, cells.mounting, cells.pitch))
    for s, soak in enumerate(soaks.listed(taken)):
        at = taken[cells.soak[taken] == soak]
        for m, mounting in enumerate(mountings.listed(at, backwards=s % 2 > 0)):
            here = at[cells.mounting[at] == mounting]
            for pitch in pitches.listed(here, backwards=(s + m) % 2 > 0):
                group = here[cells.pitch[here] == pitch]
                turn = np.mod(cells.alpha_deg[group] - angle + 1e-9, 360.0)
                order += group[np.argsort(turn, kind="stable")].tolist()
                angle = float(cells.alpha_deg[order[-1]])
    return np.array(order, int)


@dataclass(frozen=True)
class _Labels:
    """Labels of a setting by cell, in the order of their visits."""

    of_cell: Int[np.ndarray, " cells"]
    present: int | None

    def listed(self, at: np.ndarray, *, backwards: bool = False) -> Int[np.ndarray, " labels"]:
        """The labels of some cells: that of the present cell, then the others."""
        found = np.unique(self.of_cell[at])[:: -1 if backwards else 1]
        if self.present is None:
            return found
        here = found == self.of_cell[self.present]
        return np.concatenate([found[here], found[~here]])
