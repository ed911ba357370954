"""Noise of an accelerometer triad by its parts, with closed forms of the Allan deviation and of dwell means.

Symbols and Allan deviations are those of IEEE Std 952-1997 (annex C) and 1293-2018: velocity random walk N, bias
instability B, acceleration random walk K, exponentially correlated (Gauss-Markov) noise, quantisation. One value per
axis; g, s, Hz. Samples are taken every `period_s`; means are of such samples, so that covariances are exact for the
numbers that an instrument delivers, not for a continuous idealisation.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from tumblecal.words import sentences


PerAxis: TypeAlias = Float[np.ndarray, "3"]

# Gauss-Markov terms for one decade of a flicker spectrum: three leave a ripple of 0.1 %.
TERMS_PER_DECADE = 3
# Slow parts below this share of the Allan variance at the length of a dwell are not reported.
MATTERS = 0.05


@dataclass(frozen=True, eq=False)
class Dwells:
    """When the positions are measured: start of each dwell, s, samples in each (one number for all, or one of each), and
    their period, s.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.noise import Dwells
        >>> Dwells(np.array([0.0, 30.0]), np.array([1000, 500]), 0.01).counts.tolist()
        [1000, 500]
    """

    start_s: Float[np.ndarray, " positions"]
    samples: int | Int[np.ndarray, " positions"]
    period_s: float

    @property
    def counts(self) -> Int[np.ndarray, " positions"]:
        """Samples of each dwell."""
        return np.broadcast_to(self.samples, self.start_s.shape)

    @property
    def earlier_counts(self) -> Int[np.ndarray, "positions positions"]:
        """Samples of that one of two dwells that begins first."""
        first = self.start_s[:, None] <= self.start_s[None, :]
        return np.where(first, self.counts[:, None], self.counts[None, :])


def regular_dwells(positions: int, dwell_s: float, move_s: float, rate_hz: float) -> Dwells:
    """Positions measured one after the other, `dwell_s` each, with `move_s` between them.

    **Raises:** `ValueError` for a dwell without a sample.

    Examples:
        >>> from tumblecal.noise import regular_dwells
        >>> dwells = regular_dwells(positions=3, dwell_s=10, move_s=20, rate_hz=100)
        >>> dwells.start_s.tolist(), dwells.samples
        ([0.0, 30.0, 60.0], 1000)
    """
    samples = round(dwell_s * rate_hz)
    if samples < 1:
        raise ValueError(f"a dwell of {dwell_s:g} s contains no sample at {rate_hz:g} Hz")
    return Dwells(np.arange(positions) * (samples / rate_hz + move_s), samples, 1.0 / rate_hz)


@dataclass(frozen=True, eq=False)
class White:
    """White noise: `N`, g/sqrt(Hz), the sd of a mean over one second.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.noise import White, regular_dwells
        >>> white = White(np.full(3, 60e-6))  # g/sqrt(Hz)
        >>> variance = white.mean_covariance(regular_dwells(2, 100.0, 0.0, 125.0))[0]
        >>> np.sqrt(variance.diagonal()).round(9).tolist()  # 60 ug / sqrt(100 s)
        [6e-06, 6e-06]
    """

    N: PerAxis

    def allan_variance(self, tau: np.ndarray) -> Float[np.ndarray, "*tau 3"]:
        """`N^2 / tau`."""
        return self.N**2 / tau[..., None]

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """Independent means, `N^2` over the dwell each."""
        return self.N[:, None, None] ** 2 * np.diag(1 / (dwells.counts * dwells.period_s))


@dataclass(frozen=True, eq=False)
class Quantisation:
    """Rounding to multiples of `step`, g, of a signal noisy enough (sd at least half a step) to dither it.

    Its error is then white with variance step^2/12 a sample; `period_s` is the sample period.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.noise import Quantisation
        >>> steps = Quantisation(np.full(3, 1e-3), period_s=0.01)  # g
        >>> np.sqrt(steps.allan_variance(np.array([0.01]))[0, 0]).round(8).item()  # 1 mg / sqrt(12)
        0.00028868
    """

    step: PerAxis
    period_s: float

    def allan_variance(self, tau: np.ndarray) -> Float[np.ndarray, "*tau 3"]:
        """`step^2/12 * period / tau`."""
        return self.step**2 / 12 * self.period_s / tau[..., None]

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """Independent means, `step^2/12` over the number of samples each."""
        return self.step[:, None, None] ** 2 * np.diag(1 / (12 * dwells.counts))


@dataclass(frozen=True, eq=False)
class GaussMarkov:
    """Exponentially correlated noise of variance `sd^2`, g^2, and correlation time `time_s`.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.noise import GaussMarkov, regular_dwells
        >>> slow = GaussMarkov(np.full(3, 1e-4), time_s=100.0)  # g
        >>> covariance = slow.mean_covariance(regular_dwells(2, 1.0, 99.0, 100.0))[0]
        >>> round(float(covariance[0, 1] / covariance[0, 0]), 3)  # exp(-1) after one correlation time
        0.369
    """

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
        n, step = dwells.counts, dwells.period_s / self.time_s
        fading = -np.expm1(-step)  # 1 - phi
        reach = -np.expm1(-n * step) / fading  # sum of phi^j over a dwell
        separation = np.abs(np.subtract.outer(dwells.start_s, dwells.start_s)) / self.time_s
        between = np.exp(np.minimum((dwells.earlier_counts - 1) * step - separation, 0.0)) * np.outer(
            reach / n, reach / n
        )
        # One dwell: [n (1 + phi)/(1 - phi) - 2 phi reach/(1 - phi)] / n^2; to first order where that cancels.
        exact = (n * (2 - fading) - 2 * (1 - fading) * reach) / fading / n**2
        np.fill_diagonal(between, np.where(n * step < 1e-4, 1.0 - step * (n**2 - 1) / (3 * n), exact))
        return self.sd[:, None, None] ** 2 * between


@dataclass(frozen=True, eq=False)
class RandomWalk:
    """Acceleration random walk: `K`, g/sqrt(s); zero at the first sample of all.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.noise import RandomWalk
        >>> walk = RandomWalk(np.full(3, 1e-6))  # g/sqrt(s)
        >>> np.sqrt(walk.allan_variance(np.array([300.0]))[0, 0]).round(9).item()  # K sqrt(tau / 3)
        1e-05
    """

    K: PerAxis

    def allan_variance(self, tau: np.ndarray) -> Float[np.ndarray, "*tau 3"]:
        """`K^2 tau / 3`."""
        return self.K**2 * tau[..., None] / 3

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """`K^2 min(s, t)` averaged over the samples of two dwells."""
        n, period = dwells.counts, dwells.period_s
        start = dwells.start_s - np.min(dwells.start_s)
        times = np.minimum.outer(start, start) + (dwells.earlier_counts - 1) / 2 * period
        np.fill_diagonal(times, start + (n - 1) * (2 * n - 1) / (6 * n) * period)
        return self.K[:, None, None] ** 2 * times


@dataclass(frozen=True, eq=False)
class Flicker:
    """Bias instability `B`, g: a spectrum 1/f between two correlation times, s.

    It is a sum of Gauss-Markov terms spread evenly over the logarithm of the correlation time. A density A of variance
    per unit of ln T has the spectrum A/f between the two times, and the flat Allan variance `2 ln2/pi B^2` for
    A = B^2/pi (El-Sheimy, Hou and Niu 2008). A flicker spectrum without bounds has no variance; an instrument's does
    have them.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.noise import Flicker
        >>> flicker = Flicker(np.full(3, 1e-5))  # g
        >>> deviation = np.sqrt(flicker.allan_variance(np.array([10.0]))[0, 0])
        >>> round(float(deviation / 1e-5), 2)  # sqrt(2 ln 2 / pi)
        0.66
    """

    B: PerAxis
    shortest_s: float = 0.01
    longest_s: float = 1e5

    @property
    def terms(self) -> tuple[GaussMarkov, ...]:
        """The Gauss-Markov terms."""
        count = int(np.ceil(np.log10(self.longest_s / self.shortest_s) * TERMS_PER_DECADE))
        width = np.log(self.longest_s / self.shortest_s) / count
        times = self.shortest_s * np.exp(width * (np.arange(count) + 0.5))
        sd = np.asarray(self.B) * np.sqrt(width / np.pi)
        return tuple(GaussMarkov(sd, float(time)) for time in times)

    def allan_variance(self, tau: np.ndarray) -> Float[np.ndarray, "*tau 3"]:
        """Sum of the terms': `2 ln2/pi B^2` well between the two times."""
        return sum(term.allan_variance(tau) for term in self.terms)  # type: ignore[return-value]

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """Sum of the terms'."""
        return sum(term.mean_covariance(dwells) for term in self.terms)  # type: ignore[return-value]


Part: TypeAlias = White | Quantisation | Flicker | GaussMarkov | RandomWalk


@dataclass(frozen=True, eq=False)
class Noise:
    """Independent parts, added.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.noise import Flicker, Noise, White
        >>> noise = Noise((White(np.full(3, 60e-6)), Flicker(np.full(3, 20e-6))))
        >>> noise.allan_deviation(np.array([1.0, 100.0]))[:, 0].round(7).tolist()
        [6.14e-05, 1.46e-05]
    """

    parts: tuple[Part, ...]

    @property
    def processes(self) -> tuple[White | Quantisation | GaussMarkov | RandomWalk, ...]:
        """The parts, flicker as its Gauss-Markov terms: what can be drawn one step after the other."""
        split = (part.terms if isinstance(part, Flicker) else (part,) for part in self.parts)
        return tuple(term for terms in split for term in terms)

    def allan_deviation(self, tau_s: Float[np.ndarray, " tau"]) -> Float[np.ndarray, "tau 3"]:
        """Allan deviation at averaging times, g."""
        tau = np.asarray(tau_s, float)
        return np.sqrt(sum((part.allan_variance(tau) for part in self.parts), np.zeros((len(tau), 3))))

    def mean_covariance(self, dwells: Dwells) -> Float[np.ndarray, "3 positions positions"]:
        """Exact covariance of the means over dwells, per axis, g^2."""
        return sum((part.mean_covariance(dwells) for part in self.parts), np.zeros((3, 1, 1)))

    def coefficients(self) -> list[dict[str, float]]:
        """The size of each kind of part, by axis, with its unit in the name; Gauss-Markov parts as one of their mean time."""
        sizes = {
            "white_g_per_rthz": self._size(White, "N"),
            "flicker_g": self._size(Flicker, "B"),
            "walk_g_per_rts": self._size(RandomWalk, "K"),
            "markov_sd_g": self._size(GaussMarkov, "sd"),
            "markov_time_s": np.ones(3),
        }
        markov = [part for part in self.parts if isinstance(part, GaussMarkov)]
        if markov:
            times = np.sum([part.sd**2 * np.log(part.time_s) for part in markov], axis=0)
            sizes["markov_time_s"] = np.exp(times / np.maximum(sizes["markov_sd_g"] ** 2, 1e-300))
        return [{name: float(size[axis]) for name, size in sizes.items()} for axis in range(3)]

    def _size(self, kind: type, symbol: str) -> PerAxis:
        return np.sqrt(sum((getattr(p, symbol) ** 2 for p in self.parts if isinstance(p, kind)), np.zeros(3)))

    def words(self, dwell_s: float) -> list[str]:
        """Components of the noise, by axis: white noise, and the slow parts that are significant for means over a dwell."""
        tau = np.array([dwell_s])
        total = self.allan_deviation(tau)[0] ** 2
        kinds = {"flicker": Flicker, "markov": GaussMarkov, "walk": RandomWalk}
        matters = {
            name: Noise(tuple(p for p in self.parts if isinstance(p, kind))).allan_deviation(tau)[0] ** 2
            > MATTERS * total
            for name, kind in kinds.items()
        }
        sizes = self.coefficients()
        axes = [(size, {name: bool(of[axis]) for name, of in matters.items()}) for axis, size in enumerate(sizes)]
        return sentences("noise/components", axes=axes)
