"""Noise of an accelerometer triad by its parts, with closed forms of the Allan deviation and of dwell means.

Symbols and Allan deviations are those of IEEE Std 952-1997 (annex C) and 1293-2018: velocity random walk N, bias
instability B, acceleration random walk K, exponentially correlated (Gauss-Markov) noise, quantisation. One value per
axis; g, s, Hz. Samples are taken every `period_s`; means are of such samples, so that covariances are exact for the
numbers that an instrument delivers, not for a continuous idealisation.
"""

from typing import TypeAlias

import equinox as eqx
import numpy as np
from jaxtyping import Float


PerAxis: TypeAlias = Float[np.ndarray, "3"]

# Gauss-Markov terms that stand for one decade of a flicker spectrum: three leave a ripple of 0.1 %.
TERMS_PER_DECADE = 3


class Dwells(eqx.Module):
    """When the positions are measured: start of each dwell, s, samples in each, and their period, s."""

    start_s: Float[np.ndarray, " positions"]
    samples: int = eqx.field(static=True)
    period_s: float = eqx.field(static=True)


def regular_dwells(positions: int, dwell_s: float, move_s: float, rate_hz: float) -> Dwells:
    """Positions measured one after the other, `dwell_s` each, with `move_s` between them."""
    samples = round(dwell_s * rate_hz)
    if samples < 1:
        raise ValueError(f"a dwell of {dwell_s:g} s holds no sample at {rate_hz:g} Hz")
    return Dwells(np.arange(positions) * (samples / rate_hz + move_s), samples, 1.0 / rate_hz)


class White(eqx.Module):
    """White noise: `N`, g/sqrt(Hz), the sd of a mean over one second."""

    N: PerAxis

    def allan_variance(self, tau: np.ndarray) -> Float[np.ndarray, "*tau 3"]:
        """`N^2 / tau`."""
        return self.N**2 / tau[..., None]

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """Independent means, `N^2` over the dwell each."""
        variance = self.N**2 / (dwells.samples * dwells.period_s)
        return variance[:, None, None] * np.eye(len(dwells.start_s))


class Quantisation(eqx.Module):
    """Rounding to multiples of `step`, g, of a signal noisy enough (sd at least half a step) to dither it.

    Its error is then white with variance step^2/12 a sample; `period_s` is the sample period.
    """

    step: PerAxis
    period_s: float

    def allan_variance(self, tau: np.ndarray) -> Float[np.ndarray, "*tau 3"]:
        """`step^2/12 * period / tau`."""
        return self.step**2 / 12 * self.period_s / tau[..., None]

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """Independent means, `step^2/12` over the number of samples each."""
        return (self.step**2 / 12 / dwells.samples)[:, None, None] * np.eye(len(dwells.start_s))


class GaussMarkov(eqx.Module):
    """Exponentially correlated noise of variance `sd^2`, g^2, and correlation time `time_s`."""

    sd: PerAxis
    time_s: float

    def allan_variance(self, tau: np.ndarray) -> Float[np.ndarray, "*tau 3"]:
        """IEEE 952, C.1.6: `2 sd^2 (T/tau) [1 - (T/2tau)(3 - 4 exp(-tau/T) + exp(-2tau/T))]`."""
        r = tau / self.time_s
        # 3 - 4 e^-r + e^-2r = 2r - 2r^3/3 + ...: below 1e-3 the difference has lost its digits.
        exact = 2 / r * (1 - (3 - 4 * np.exp(-r) + np.exp(-2 * r)) / (2 * r))
        return np.where(r < 1e-3, 2 * r / 3 * (1 - 0.75 * r), exact)[..., None] * self.sd**2

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """Sums of `phi^|i - j|` over the samples of two dwells, phi the correlation of neighbours."""
        n, step = dwells.samples, dwells.period_s / self.time_s
        fading = -np.expm1(-step)  # 1 - phi
        reach = -np.expm1(-n * step) / fading  # sum of phi^j over a dwell
        apart = np.abs(np.subtract.outer(dwells.start_s, dwells.start_s)) / self.time_s
        between = np.exp(np.minimum((n - 1) * step - apart, 0.0)) * (reach / n) ** 2
        np.fill_diagonal(between, self._within(n, step, fading, reach))
        return self.sd[:, None, None] ** 2 * between

    @staticmethod
    def _within(n: int, step: float, fading: float, reach: float) -> float:
        """Variance of one dwell's mean: `[n (1 + phi)/(1 - phi) - 2 phi reach/(1 - phi)] / n^2`."""
        if n * step < 1e-4:
            return 1.0 - step * (n * n - 1) / (3 * n)  # first order; the exact form cancels here
        return float((n * (2 - fading) - 2 * (1 - fading) * reach) / fading) / n**2


class RandomWalk(eqx.Module):
    """Acceleration random walk: `K`, g/sqrt(s); zero at the first sample of the first dwell."""

    K: PerAxis

    def allan_variance(self, tau: np.ndarray) -> Float[np.ndarray, "*tau 3"]:
        """`K^2 tau / 3`."""
        return self.K**2 * tau[..., None] / 3

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """`K^2 min(s, t)` averaged over the samples of two dwells."""
        n, period = dwells.samples, dwells.period_s
        start = dwells.start_s - dwells.start_s[0]
        times = np.minimum.outer(start, start) + (n - 1) / 2 * period
        np.fill_diagonal(times, start + (n - 1) * (2 * n - 1) / (6 * n) * period)
        return self.K[:, None, None] ** 2 * times


Part: TypeAlias = White | Quantisation | GaussMarkov | RandomWalk


def flicker(B: PerAxis, shortest_s: float = 0.01, longest_s: float = 1e5) -> tuple[GaussMarkov, ...]:
    """Bias instability `B`, g, as Gauss-Markov terms spread evenly over the logarithm of the correlation time.

    A density A of variance per unit of ln T has the spectrum A/f between the two times, and the flat Allan variance
    `2 ln2/pi B^2` for A = B^2/pi. A flicker spectrum without bounds has no variance; an instrument's does have them.

    **Arguments:**

    - `B`: bias instability coefficient of each axis.
    - `shortest_s`, `longest_s`: correlation times between which the spectrum is 1/f.
    """
    count = int(np.ceil(np.log10(longest_s / shortest_s) * TERMS_PER_DECADE))
    width = np.log(longest_s / shortest_s) / count
    times = shortest_s * np.exp(width * (np.arange(count) + 0.5))
    sd = np.asarray(B) * np.sqrt(width / np.pi)
    return tuple(GaussMarkov(sd, float(time)) for time in times)


class Noise(eqx.Module):
    """Independent parts, added."""

    parts: tuple[Part, ...]

    def allan_deviation(self, tau_s: Float[np.ndarray, " tau"]) -> Float[np.ndarray, "tau 3"]:
        """Allan deviation at averaging times, g."""
        tau = np.asarray(tau_s, float)
        return np.sqrt(sum((part.allan_variance(tau) for part in self.parts), np.zeros((len(tau), 3))))

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """Exact covariance of the means over dwells, per axis, g^2."""
        return sum((part.mean_covariance(dwells) for part in self.parts), np.zeros((3, 1, 1)))
