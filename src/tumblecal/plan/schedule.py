"""When the positions of a plan are measured, and how often pitch setting and mounting are set again."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain.head_ability import Times
from tumblecal.plan.cells import Cells


@dataclass(frozen=True)
class Schedule:
    """Positions in measuring order, or several orders of them (n).

    - `cells`: number of the cell of each position. `start_s`: of each dwell; `end_s`: of the last one.
    - `pitch_visit`, `mount_visit`: number of the visit of the pitch setting and of the mounting that each position belongs to:
      both are set again whenever they change, the pitch also with the mounting.
    """

    cells: Int[np.ndarray, "*n positions"]
    start_s: Float[np.ndarray, "*n positions"]
    end_s: float | Float[np.ndarray, "*n"]
    pitch_visit: Int[np.ndarray, "*n positions"]
    mount_visit: Int[np.ndarray, "*n positions"]

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def minutes(self) -> float:
        """Duration, min."""
        return float(self.end_s) / 60


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


def schedule(
    cells: Cells, order: Int[np.ndarray, "*n positions"], times: Times, measured: Schedule | None = None
) -> Schedule:
    """The schedule of some cells in this order, or in each of several.

    The first position has its mounting, pitch setting and temperature already, or follows the last one that is `measured`.
    """
    order = np.asarray(order, int)
    before = np.broadcast_to(order[..., :1] if measured is None else measured.cells[-1], (*order.shape[:-1], 1))
    path = order if measured is None else np.concatenate([before, order], axis=-1)
    between = moves(cells, path[..., :-1], path[..., 1:], times)
    start = np.concatenate([np.zeros(before.shape), np.cumsum(times.dwell_s + between, axis=-1)], axis=-1)
    remounted = np.diff(cells.mounting[path]) != 0
    changed = remounted | (np.diff(cells.pitch[path]) != 0)
    numbers = [
        np.concatenate([np.zeros(before.shape, int), np.cumsum(change, axis=-1)], axis=-1)
        for change in (changed, remounted)
    ]
    if measured is None:
        start = start + times.settle_s
        return Schedule(order, start, start[..., -1] + times.dwell_s, *numbers)
    start = start + measured.end_s - times.dwell_s
    joined, starts, *visits = [
        np.concatenate([np.broadcast_to(known, (*order.shape[:-1], len(measured))), new[..., 1:]], axis=-1)
        for known, new in (
            (measured.cells, path),
            (measured.start_s, start),
            (measured.pitch_visit, measured.pitch_visit[-1] + numbers[0]),
            (measured.mount_visit, measured.mount_visit[-1] + numbers[1]),
        )
    ]
    return Schedule(joined, starts, start[..., -1] + times.dwell_s, visits[0], visits[1])
