"""The head at rest: means of blocks of about a second, found at rest, knocked or creeping."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.port.live import Arrived


_TURNING_DPS = 2.0
_KNOCK_Z, _SHAKEN, _CREEP_U = 5.0, 2.0, 5.0


class Stationarity(NamedTuple):
    """Stationarity of a dwell.

    **Arguments:**

    - `knocks`: blocks that are outliers from the baseline. `creep`: the last block, if the drift is significant.
    - `drift_g`: end minus beginning of a straight line through the block means, per axis.
    - `tilt_arcsec`: the tilt that would cause that drift (by the axes that are sensitive to it).
    """

    knocks: list[int]
    creep: list[int]
    drift_g: NDArray[np.float64]
    tilt_arcsec: float


class Blocks:
    """Blocks of about a second of samples.

    **Arguments:**

    - `rate_hz`: sample rate. `most`: number of blocks to keep, the last ones; 0 for all.

    `size`: samples in a block. `mean_g`, `sd_g`: mean of each block, and standard deviation of its samples, shape (k, 3).
    """

    mean_g: NDArray[np.float64]
    sd_g: NDArray[np.float64]

    def __init__(self, rate_hz: float, most: int = 0):
        self.size, self._most = max(4, round(rate_hz)), most
        self.forget()

    def forget(self) -> None:
        """Begin again: the head turns."""
        self._unfinished = self.mean_g = self.sd_g = np.zeros((0, 3))

    def forget_unfinished(self) -> None:
        """After a gap: the samples of a block must belong together."""
        self._unfinished = np.zeros((0, 3))

    def add(self, force: NDArray[np.float64]) -> int:
        """Add samples (n, 3); returns the number of blocks that they complete."""
        data = np.vstack([self._unfinished, force])
        count = len(data) // self.size
        blocks, self._unfinished = np.split(data, [count * self.size])
        blocks = blocks.reshape(count, self.size, 3)
        self.mean_g = np.concatenate([self.mean_g, blocks.mean(1)])[-self._most :]
        self.sd_g = np.concatenate([self.sd_g, blocks.std(1, ddof=1)])[-self._most :]
        return count

    def still(self, limit_g: float) -> bool:
        """Whether the head is at rest: two steady means, and no more noise than the quieter block explains."""
        means, noise = self.mean_g[-2:], self.sd_g[-2:]
        if len(means) < 2:
            return False
        quiet = noise.min(0)
        allowed = np.maximum(limit_g, 6 * quiet / np.sqrt(self.size))
        return bool((np.ptp(means, axis=0) < allowed).all() and (noise < np.maximum(3 * quiet, limit_g)).all())

    def stationarity(self) -> Stationarity:
        """Judge the blocks of a dwell.

        The baseline of each axis is the median and the median absolute deviation of the block means; with few blocks the
        noise of the samples is used.
        """
        means, noise = self.mean_g, self.sd_g
        if (n := len(means)) < 3:
            return Stationarity([], [], np.zeros(3), 0.0)
        quiet, centre = np.median(noise, axis=0), np.median(means, axis=0)
        scatter = 1.4826 * np.median(np.abs(np.diff(means, axis=0)), axis=0) / np.sqrt(2)
        scale = np.maximum(np.maximum(scatter, quiet / np.sqrt(self.size)), 1e-9)
        outlier = (np.abs(means - centre) > _KNOCK_Z * scale) | (noise > _SHAKEN * quiet)
        line = np.polyfit(np.arange(n), means, 1)[0] * (n - 1)
        # Its standard uncertainty for independent blocks is scale sqrt(12/n).
        creep = [n - 1] if (np.abs(line) > _CREEP_U * scale * np.sqrt(12 / n)).any() else []
        across = line - line @ centre / max(centre @ centre, 1e-9) * centre
        tilt_arcsec = np.linalg.norm(across) * (180 / np.pi * 3600)
        return Stationarity(np.flatnonzero(outlier.any(1)).tolist(), creep, line, float(tilt_arcsec))


class HeadWatch:
    """Watches the stream between and during recordings.

    **Arguments:**

    - `rate_hz`: sample rate. `to_local_g`: factor from standard g to local g.

    `blocks`: the last two. `moved`: whether the head moved since this was last set to False.
    """

    def __init__(self, rate_hz: float, to_local_g: float):
        self._to_local_g, self.blocks, self.moved = to_local_g, Blocks(rate_hz, 2), False

    def take(self, part: Arrived) -> int:
        """Add new samples; returns the number of blocks they complete."""
        rate, fresh = (
            part.samples.rate,
            self.blocks.add(part.samples.force[part.samples.status == 0] * self._to_local_g),
        )
        # The angular rate shows a turn without effect on gravity (about the vertical).
        if len(rate) >= 8 and (np.abs([piece.mean(0) for piece in np.array_split(rate, 8)]) > _TURNING_DPS).any():
            self.blocks.forget()
            self.moved = True
        return fresh
