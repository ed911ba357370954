"""Whether the head rests or turns, from block means of the specific force, and from the angular rate if there is one."""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.port.live import Arrived
from tumblecal.capture.run.stationarity import Block, BlockCutter, is_still


_RECENT_BLOCKS = 3
_TURNING_DPS = 2.0


class HeadWatch:
    """Watches the stream between and during recordings.

    **Arguments:**

    - `block`: samples in a block of about a second. `to_local_g`: factor from standard g to local g. `still_g`: limit
      for rest.

    `moved`: whether the head moved since this was last set to False.
    """

    def __init__(self, block: int, to_local_g: float, still_g: float):
        self._cutter = BlockCutter(block)
        self._to_local_g, self._still_g = to_local_g, still_g
        self._quiet_rate: NDArray[np.float64] | None = None
        self.blocks: list[Block] = []
        self.moved = False

    @property
    def last(self) -> Block | None:
        """The newest block."""
        return self.blocks[-1] if self.blocks else None

    @property
    def still(self) -> bool:
        """Whether the head is at rest."""
        return len(self.blocks) >= 2 and is_still(self.blocks[-2:], self._still_g)

    def take(self, part: Arrived) -> int:
        """Add new samples; returns the number of blocks they complete."""
        if not len(part.samples):
            return 0
        good = part.samples.status == 0
        fresh = self._cutter.add(part.samples.force[good] * self._to_local_g)
        self.blocks = (self.blocks + fresh)[-_RECENT_BLOCKS:]
        self._watch_rotation(part.samples.rate)
        return len(fresh)

    def forget_unfinished(self) -> None:
        """After a gap: the samples of a block must belong together."""
        self._cutter.clear()

    def _watch_rotation(self, rate: NDArray[np.float64]) -> None:
        """Detect by the angular rate a turn without effect on gravity (about the vertical)."""
        if len(rate) < 8 or not np.isfinite(rate).all():
            return
        eighth = len(rate) // 8
        means = rate[: 8 * eighth].reshape(8, eighth, 3).mean(1)
        noise = rate.std(0) / np.sqrt(eighth) if self._quiet_rate is None else self._quiet_rate
        if (np.abs(means).max(0) > _TURNING_DPS + 6 * noise).any():
            self.moved = True
            self._cutter.clear()
            self.blocks.clear()
        elif self._quiet_rate is None:
            self._quiet_rate = noise
