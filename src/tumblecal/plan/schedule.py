"""When the positions of a plan are measured, and how often pitch setting and mounting are set again."""

from collections.abc import Sequence
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


def schedule(
    cells: Cells, order: Int[np.ndarray, "*n positions"], times: Times, measured: Sequence[int] | np.ndarray = ()
) -> Schedule:
    """The schedule of some cells in this order, or in each of several, after those that are `measured` already.

    The first position has its mounting, pitch setting and temperature already.
    """
    order = np.asarray(order, int)
    known = np.broadcast_to(np.asarray(measured, int), (*order.shape[:-1], len(measured)))
    path = np.concatenate([known, order], axis=-1)
    turned, tilted, remounted, heated = (
        np.diff(label[path]) != 0 for label in (cells.alpha_deg, cells.pitch, cells.mounting, cells.soak)
    )
    changed = remounted | tilted
    between = times.turn_s * turned + times.pitch_change_s * changed + times.remount_s * remounted
    step = float(times.dwell_s + times.settle_s) + between + times.temperature_change_s * heated
    zero = np.zeros((*path.shape[:-1], 1))
    start, pitch, mount = (
        np.concatenate([zero, np.cumsum(each, axis=-1)], axis=-1) for each in (step, changed, remounted)
    )
    start += times.settle_s
    return Schedule(path, start, start[..., -1] + times.dwell_s, pitch.astype(int), mount.astype(int))
