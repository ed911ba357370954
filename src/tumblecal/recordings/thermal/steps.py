"""Steps of the readings at rest: a jump from one sample to the next within one attitude, as of joined files or a moved unit.

The joins of a recording (`still/blocks.py`) that change the readings by less than a change of attitude are steps.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.recordings.clock import LONGEST_STEP_S
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.thermal.attitudes import ONE_ATTITUDE_G


# Blocks on each side of a step whose means give its size: before it changes with temperature.
_BLOCKS = 16


def steps_of(blocks: SignalBlocks, degc: NDArray[np.float64], to_g: float) -> dict[int, str]:
    """The first block after each step of a recording, and a line about the step.

    **Arguments:** `degc`: a reading of the thermometer in each block; NaN where unknown. `to_g`: unit of the blocks, g.
    """
    edges = np.unique(np.append(np.flatnonzero(blocks.broken), [0, len(blocks)])).tolist()
    mean = to_g * blocks.mean[:, :3]
    found = dict[int, str]()
    for begin, k, end in zip(edges, edges[1:], edges[2:], strict=False):
        pause = blocks.start_s[k] - blocks.start_s[k - 1]
        start, stop = max(k - _BLOCKS, begin), min(k + _BLOCKS, end)
        size = mean[k:stop].mean(0) - mean[start:k].mean(0)
        in_time = 0 <= pause <= LONGEST_STEP_S + blocks.size / blocks.rate_hz
        if not in_time or np.linalg.norm(size) >= ONE_ATTITUDE_G:
            continue
        variance = blocks.squares[start:stop, :3].mean(0) / (blocks.size - 1) / blocks.size
        u = to_g * np.sqrt(variance * (1 / (k - start) + 1 / (stop - k)))
        found[k] = (
            f"step at {blocks.start_s[k]:.2f} s, {degc[k]:.2f} degC: the readings jump by "
            f"{', '.join(f'{1e3 * one:.2f}' for one in size)} mg (standard uncertainty {1e3 * u.max():.2g} mg); the unit was "
            "moved, or two recordings are joined. The parts before and after it have separate attitudes and clocks"
        )
    return found
