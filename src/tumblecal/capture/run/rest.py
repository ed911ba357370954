"""The head at rest: means of blocks of about a second, found at rest, knocked or creeping.

Blocks are an array of shape (k, 2, 3): for each block the mean and the standard deviation of its samples per axis, g.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.port.live import Arrived


Blocks: TypeAlias = NDArray[np.float64]

_TURNING_DPS = 2.0
_KNOCK_Z, _SHAKEN = 5.0, 2.0
_CUSUM_SLACK, _CUSUM_LIMIT = 0.5, 12.0
_BASELINE_BLOCKS = 10
# Number of stretches of a dwell whose means show its slow noise.
_STRETCHES = 6
_ARCSEC_PER_RAD = 180 / np.pi * 3600


def block_size(rate_hz: float) -> int:
    """Samples in a block of about a second."""
    return max(4, round(rate_hz))


class BlockCutter:
    """Cuts a stream of samples into blocks of equal size.

    **Arguments:**

    - `size`: samples in a block.
    """

    size: int

    def __init__(self, size: int):
        self.size = size
        self.clear()

    def add(self, force: NDArray[np.float64]) -> Blocks:
        """The blocks that these samples (n, 3) complete."""
        data = np.vstack([self._rest, force])
        count = len(data) // self.size
        self._rest = data[count * self.size :]
        whole = data[: count * self.size].reshape(count, self.size, 3)
        return np.stack([whole.mean(1), whole.std(1, ddof=1)], axis=1)

    def clear(self) -> None:
        """Forget the unfinished block."""
        self._rest = np.zeros((0, 3))


class Stationarity(NamedTuple):
    """Stationarity of a dwell.

    **Arguments:**

    - `knocks`: blocks that are outliers from the baseline. `creep`: blocks from which on the CUSUM shows a moved mean.
    - `drift_g`: end minus beginning of a straight line through the block means, per axis.
    - `tilt_arcsec`: the tilt that would cause that drift (by the axes that are sensitive to it).
    """

    knocks: list[int]
    creep: list[int]
    drift_g: NDArray[np.float64]
    tilt_arcsec: float


def stationarity(blocks: Blocks, size: int) -> Stationarity:
    """Judge the blocks of one dwell, each of `size` samples.

    The baseline of each axis is the median and the median absolute deviation of the block means; with fewer than ten
    blocks the noise of the samples is used.
    """
    means, noise, n = blocks[:, 0], blocks[:, 1], len(blocks)
    if n < 3:
        return Stationarity([], [], np.zeros(3), 0.0)
    quiet, centre = np.median(noise, axis=0), np.median(means, axis=0)
    scatter = 1.4826 * np.median(np.abs(np.diff(means, axis=0)), axis=0) / np.sqrt(2)
    scale = np.maximum(np.maximum(scatter, quiet / np.sqrt(size)), 1e-9)
    outlier = (np.abs(means - centre) > _KNOCK_Z * scale) | (noise > _SHAKEN * quiet)
    baseline = np.median(means[: max(_BASELINE_BLOCKS, n // 3)], axis=0)
    line = np.polyfit(np.arange(n), means, 1)[0] * (n - 1)
    perpendicular = line - np.dot(line, centre) / max(np.dot(centre, centre), 1e-9) * centre
    tilt_arcsec = float(np.linalg.norm(perpendicular) * _ARCSEC_PER_RAD)
    return Stationarity(np.flatnonzero(outlier.any(1)).tolist(), _cusum((means - baseline) / scale), line, tilt_arcsec)


def _cusum(z: NDArray[np.float64]) -> list[int]:
    """Blocks at which a two-sided CUSUM of any axis exceeds its limit; it restarts after each."""
    found, sums = [], np.zeros((2, z.shape[1]))
    for k, row in enumerate(np.clip(z, -4, 4)):
        sums = np.maximum(sums + np.stack([row, -row]) - _CUSUM_SLACK, 0)
        if (sums > _CUSUM_LIMIT).any():
            found.append(k)
            sums[:] = 0
    return found


def mean_variance(blocks: Blocks, size: int) -> NDArray[np.float64]:
    """Variance of a dwell's mean per axis: from its white noise, and from the slow noise between stretches of it, which
    averaging over one dwell does not reduce."""
    means, n = blocks[:, 0], size * len(blocks)
    white = np.mean(blocks[:, 1] ** 2, axis=0)
    count = min(_STRETCHES, len(means))
    if count < 2:
        return white / n
    stretches = np.array([part.mean(0) for part in np.array_split(means, count)])
    return white / n + np.maximum(stretches.var(0, ddof=1) - white * count / n, 0.0)


class HeadWatch:
    """Watches the stream between and during recordings.

    **Arguments:**

    - `size`: samples in a block. `to_local_g`: factor from standard g to local g. `still_g`: limit for rest.

    `blocks`: the last two. `moved`: whether the head moved since this was last set to False.
    """

    blocks: Blocks
    moved: bool

    def __init__(self, size: int, to_local_g: float, still_g: float):
        self._cutter, self._to_local_g, self._still_g = BlockCutter(size), to_local_g, still_g
        self._quiet_rate: NDArray[np.float64] | None = None
        self.blocks = np.zeros((0, 2, 3))
        self.moved = False

    @property
    def still(self) -> bool:
        """Whether the head is at rest: steady means, and no more noise than the quietest block explains."""
        if len(self.blocks) < 2:
            return False
        means, noise = self.blocks[:, 0], self.blocks[:, 1]
        quiet = noise.min(0)
        allowed = np.maximum(self._still_g, 6 * quiet / np.sqrt(self._cutter.size))
        return bool((np.ptp(means, axis=0) < allowed).all() and (noise < np.maximum(3 * quiet, self._still_g)).all())

    def take(self, part: Arrived) -> int:
        """Add new samples; returns the number of blocks they complete."""
        good = part.samples.status == 0
        fresh = self._cutter.add(part.samples.force[good] * self._to_local_g)
        self.blocks = np.concatenate([self.blocks, fresh])[-2:]
        self._watch_rotation(part.samples.rate)
        return len(fresh)

    def forget_unfinished(self) -> None:
        """After a gap: the samples of a block must belong together."""
        self._cutter.clear()

    def _watch_rotation(self, rate: NDArray[np.float64]) -> None:
        """Detect by the angular rate a turn without effect on gravity (about the vertical)."""
        eighth = len(rate) // 8
        if not eighth or not np.isfinite(rate).all():
            return
        means = rate[: 8 * eighth].reshape(8, eighth, 3).mean(1)
        noise = rate.std(0) / np.sqrt(eighth) if self._quiet_rate is None else self._quiet_rate
        if (np.abs(means).max(0) > _TURNING_DPS + 6 * noise).any():
            self.moved = True
            self._cutter.clear()
            self.blocks = self.blocks[:0]
        elif self._quiet_rate is None:
            self._quiet_rate = noise
