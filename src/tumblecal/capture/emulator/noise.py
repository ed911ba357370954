"""Noise of the virtual accelerometers, sample by sample, without gaps between calls."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tumblecal.capture.emulator.config import Noise


class NoiseSource:
    """White noise, a Gauss-Markov process and a random walk on three axes.

    **Arguments:**

    - `noise`: sizes.
    - `rate_hz`: sample rate.
    """

    def __init__(self, noise: Noise, rate_hz: float):
        self._random = np.random.default_rng(noise.seed)
        self._white = noise.white_g_per_rthz * np.sqrt(rate_hz)
        self._decay = float(np.exp(-1 / (noise.markov_time_s * rate_hz)))
        self._drive = noise.markov_sd_g * np.sqrt(1 - self._decay**2)
        self._step = noise.walk_g_per_rts / np.sqrt(rate_hz)
        self._markov = self._random.normal(size=3) * noise.markov_sd_g
        self._walk = np.zeros(3)

    def take(self, n: int) -> NDArray[np.float64]:
        """The next `n` samples, g, shape (n, 3)."""
        if not n:
            return np.zeros((0, 3))
        total = self._random.normal(size=(n, 3)) * self._white
        if self._drive:
            drive = self._random.normal(size=(n, 3)) * self._drive
            drive[0] += self._decay * self._markov
            markov = lfilter([1.0], [1.0, -self._decay], drive, axis=0)
            self._markov = markov[-1]
            total += markov
        if self._step:
            walk = self._walk + np.cumsum(self._random.normal(size=(n, 3)) * self._step, axis=0)
            self._walk = walk[-1]
            total += walk
        return total
