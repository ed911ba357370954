"""Test whether the head is at rest and stays at rest: block means against a robust baseline, and a CUSUM for creep."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.port.live import Arrived


_RECENT_BLOCKS = 3
_TURNING_DPS = 2.0
_KNOCK_Z = 5.0
_SHAKEN = 2.0
_CUSUM_SLACK, _CUSUM_LIMIT = 0.5, 12.0
_BASELINE_BLOCKS = 10
# Number of stretches of a dwell whose means show its slow noise.
_STRETCHES = 6
_ARCSEC_PER_RAD = 180 / np.pi * 3600


@dataclass(frozen=True)
class Block:
    """About a second of samples: means and standard deviations per axis in g, and the number of good samples."""

    mean: NDArray[np.float64]
    sd: NDArray[np.float64]
    n: int


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
        self.size = max(size, 4)
        self._rest = np.zeros((0, 3))

    def add(self, force: NDArray[np.float64]) -> list[Block]:
        """The blocks that these samples (n, 3) complete."""
        data = np.vstack([self._rest, force])
        count = len(data) // self.size
        whole = data[: count * self.size].reshape(count, self.size, 3)
        self._rest = data[count * self.size :]
        return [Block(b.mean(0), b.std(0, ddof=1), self.size) for b in whole]

    def clear(self) -> None:
        """Forget the unfinished block."""
        self._rest = np.zeros((0, 3))


def is_still(blocks: list[Block], limit_g: float) -> bool:
    """Whether the head is at rest in these blocks: steady means, and no more noise than the quietest block explains.

    **Arguments:**

    - `blocks`: the last few.
    - `limit_g`: largest spread of the block means.
    """
    if len(blocks) < 2:
        return False
    means = np.array([b.mean for b in blocks])
    noise = np.array([b.sd for b in blocks])
    quiet = noise.min(0)
    spread = np.ptp(means, axis=0)
    allowed = np.maximum(limit_g, 6 * quiet / np.sqrt(blocks[0].n))
    return bool((spread < allowed).all() and (noise < np.maximum(3 * quiet, limit_g)).all())


@dataclass(frozen=True)
class Stationarity:
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

    @property
    def good(self) -> bool:
        """Whether nothing was found."""
        return not self.knocks and not self.creep


def stationarity(blocks: list[Block]) -> Stationarity:
    """Judge the blocks of one dwell.

    The baseline of each axis is the median and the median absolute deviation of the block means; with fewer than ten
    blocks the noise of the samples is used.
    """
    means = np.array([b.mean for b in blocks]).reshape(-1, 3)
    n = len(means)
    if n < 3:
        return Stationarity([], [], np.zeros(3), 0.0)
    sampling = np.median([b.sd for b in blocks], axis=0) / np.sqrt(blocks[0].n)
    baseline = means[: max(_BASELINE_BLOCKS, n // 3)]
    scatter = 1.4826 * np.median(np.abs(np.diff(means, axis=0)), axis=0) / np.sqrt(2)
    scale = np.maximum(np.maximum(scatter, sampling), 1e-9)
    centre = np.median(means, axis=0)
    noise = np.array([b.sd for b in blocks])
    stands_out = np.abs(means - centre) > _KNOCK_Z * scale
    shaken = noise > _SHAKEN * np.median(noise, axis=0)
    knocks = np.flatnonzero((stands_out | shaken).any(1)).tolist()
    creep = _cusum((means - np.median(baseline, axis=0)) / scale)
    line = np.polyfit(np.arange(n), means, 1)[0] * (n - 1)
    perpendicular = line - np.dot(line, centre) / max(np.dot(centre, centre), 1e-9) * centre
    return Stationarity(knocks, creep, line, float(np.linalg.norm(perpendicular) * _ARCSEC_PER_RAD))


def _cusum(z: NDArray[np.float64]) -> list[int]:
    """Blocks at which a two-sided CUSUM of any axis exceeds its limit; it restarts after each."""
    found = []
    high = low = np.zeros(z.shape[1])
    for k, row in enumerate(np.clip(z, -4, 4)):
        high, low = np.maximum(high + row - _CUSUM_SLACK, 0), np.maximum(low - row - _CUSUM_SLACK, 0)
        if (high > _CUSUM_LIMIT).any() or (low > _CUSUM_LIMIT).any():
            found.append(k)
            high = low = np.zeros(z.shape[1])
    return found


def mean_variance(blocks: list[Block]) -> NDArray[np.float64]:
    """Variance of a dwell's mean per axis: from its white noise, and from the slow noise between stretches of it, which
    averaging over one dwell does not reduce."""
    n = sum(block.n for block in blocks)
    white = np.mean([block.sd**2 for block in blocks], axis=0)
    means = np.array([block.mean for block in blocks])
    count = min(_STRETCHES, len(means))
    if count < 2:
        return white / n
    stretches = np.array([part.mean(0) for part in np.array_split(means, count)])
    return white / n + np.maximum(stretches.var(0, ddof=1) - white * count / n, 0.0)


class HeadWatch:
    """Watches the stream between and during recordings.

    **Arguments:**

    - `block`: samples in a block of about a second. `to_local_g`: factor from standard g to local g. `still_g`: limit
      for rest.

    `moved`: whether the head moved since this was last set to False.
    """

    moved: bool

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
