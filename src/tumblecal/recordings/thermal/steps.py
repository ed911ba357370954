"""Steps of the readings at rest: a jump from one sample to the next within one attitude, as of joined files or a moved unit.

The joins of a recording (`still/blocks.py`) that change the readings by less than a change of attitude are steps.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from tumblecal.recordings.clock import LONGEST_STEP_S
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.thermal.attitudes import ONE_ATTITUDE_G


# Blocks on each side of a step whose means give its size: before it changes with temperature.
_BLOCKS = 16
# A temperature that jumps by this many times its usual change in as many blocks is that of a different recording.
_JUMP = 10.0


@dataclass(frozen=True)
class Step:
    """A step of the readings.

    - `block`: the first one after it. `time_s`. `size`, `u` (3): of the step and its standard uncertainty, g.
    - `degc` (2): temperature before and after it. `joined`: whether the temperature jumps as well.
    """

    block: int
    time_s: float
    size: Float[np.ndarray, "3"]
    u: Float[np.ndarray, "3"]
    degc: tuple[float, float]
    joined: bool

    @property
    def words(self) -> str:
        """Time, temperature, size and cause of the step."""
        size = ", ".join(f"{1e3 * one:.2f}" for one in self.size)
        before, after = self.degc
        where = f"{before:.2f} to {after:.2f} degC" if self.joined else f"{after:.2f} degC"
        cause = (
            "the temperature jumps too, so two recordings are joined" if self.joined else "the unit was perhaps moved"
        )
        return (
            f"step at {self.time_s:.2f} s, {where}: the readings jump by {size} mg (standard uncertainty "
            f"{1e3 * float(np.max(self.u)):.2g} mg); {cause}. The parts before and after it have separate attitudes and clocks"
        )


def steps_of(blocks: SignalBlocks, degc: NDArray[np.float64], to_g: float) -> list[Step]:
    """The steps of a recording.

    **Arguments:**

    - `degc`: a reading of the thermometer in each block; NaN where unknown. `to_g`: unit of the blocks, g.
    """
    changes = np.abs(degc[_BLOCKS:] - degc[:-_BLOCKS])
    usual = float(np.nanmedian(changes)) if np.isfinite(changes).any() else np.inf
    edges = np.flatnonzero(blocks.broken)
    found = []
    for number, k in enumerate(edges.tolist()):
        if (
            k == 0
            or not 0 <= blocks.start_s[k] - blocks.start_s[k - 1] <= LONGEST_STEP_S + blocks.size / blocks.rate_hz
        ):
            continue
        start = max(k - _BLOCKS, int(edges[number - 1]) if number else 0)
        stop = min(k + _BLOCKS, int(edges[number + 1]) if number + 1 < len(edges) else len(blocks))
        before, after = to_g * blocks.mean[start:k, :3], to_g * blocks.mean[k:stop, :3]
        size = after.mean(0) - before.mean(0)
        if np.linalg.norm(size) >= ONE_ATTITUDE_G:
            continue
        variance = to_g**2 * blocks.squares[start:stop, :3].mean(0) / max(blocks.size - 1, 1) / blocks.size
        u = np.sqrt(variance * (1 / len(before) + 1 / len(after)))
        warmth = float(np.mean(degc[start:k])), float(np.mean(degc[k:stop]))
        joined = bool(abs(warmth[1] - warmth[0]) > _JUMP * usual)
        found.append(Step(k, float(blocks.start_s[k]), size, u, warmth, joined))
    return found
