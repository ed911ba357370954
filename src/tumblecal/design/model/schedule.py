"""When the positions of a plan are measured, and how often pitch setting and mounting are set again."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_ability import Times
from tumblecal.design.model.cells import Cells


@dataclass(frozen=True)
class Schedule:
    """Positions in measuring order.

    - `cells`: number of the cell of each position. `start_s`: of each dwell; `end_s`: of the last one.
    - `pitch_visit`, `mount_visit`: number of the visit of the pitch setting and of the mounting that each position belongs to:
      both are set again whenever they change, the pitch also with the mounting.
    """

    cells: Int[np.ndarray, " positions"]
    start_s: Float[np.ndarray, " positions"]
    end_s: float
    pitch_visit: Int[np.ndarray, " positions"]
    mount_visit: Int[np.ndarray, " positions"]

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def minutes(self) -> float:
        """Duration, min."""
        return self.end_s / 60


def moves(
    cells: Cells, first: Int[np.ndarray, "*n"], then: Int[np.ndarray, "*n"], times: Times
) -> Float[np.ndarray, "*n"]:
    """Times from the end of a dwell in one cell to the start of a dwell in another, s; settling included."""
    remount = cells.mounting[first] != cells.mounting[then]
    pitch = remount | (cells.pitch[first] != cells.pitch[then])
    turn = cells.alpha_deg[first] != cells.alpha_deg[then]
    heat = cells.soak[first] != cells.soak[then]
    return (
        times.settle_s
        + times.turn_s * turn
        + times.pitch_change_s * pitch
        + times.remount_s * remount
        + times.temperature_change_s * heat
    )


def schedule(cells: Cells, order: Int[np.ndarray, " positions"], times: Times) -> Schedule:
    """The schedule of some cells in this order. The first position has its mounting, pitch setting and temperature already."""
    order = np.asarray(order, int)
    between = moves(cells, order[:-1], order[1:], times)
    start = times.settle_s + np.concatenate([[0.0], np.cumsum(times.dwell_s + between)])
    remounted = np.diff(cells.mounting[order]) != 0
    changed = remounted | (np.diff(cells.pitch[order]) != 0)
    visits = (np.concatenate([[0], np.cumsum(change)]) for change in (changed, remounted))
    return Schedule(order, start, float(start[-1] + times.dwell_s), *visits)


def continued(cells: Cells, measured: Schedule | None, order: Int[np.ndarray, " positions"], times: Times) -> Schedule:
    """A schedule, measured or planned, with further positions after it; None: nothing is before them."""
    if measured is None:
        return schedule(cells, order, times)
    order = np.concatenate([measured.cells[-1:], np.asarray(order, int)])
    # The last measured position, then the further ones: times and visits from its end on.
    further = schedule(cells, order, times)
    shift = measured.end_s - further.start_s[0] - times.dwell_s
    return Schedule(
        np.concatenate([measured.cells, order[1:]]),
        np.concatenate([measured.start_s, further.start_s[1:] + shift]),
        further.end_s + shift,
        np.concatenate([measured.pitch_visit, measured.pitch_visit[-1] + further.pitch_visit[1:]]),
        np.concatenate([measured.mount_visit, measured.mount_visit[-1] + further.mount_visit[1:]]),
    )
