"""Raw samples of a noise model: for the virtual instrument, for `--raw` studies, and as a check of closed forms.

Plain numpy.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from tumblecal.noise.parts import Dwells, GaussMarkov, Noise, Quantisation, RandomWalk


class SampleStream:
    """Samples of a noise model, one stretch after the other; correlated parts continue through the gaps.

    **Arguments:**

    - `noise`: its parts, without rounding. `period_s`: sample period. `seed`: of the random numbers.
    """

    def __init__(self, noise: Noise, period_s: float, seed: int | np.random.SeedSequence):
        self._parts = [part for part in noise.processes if not isinstance(part, Quantisation)]
        self._period_s = period_s
        self._generator = np.random.default_rng(seed)
        # Last value of each part; a walk begins at zero.
        self._last: dict[int, Float[np.ndarray, 3]] = {}

    def take(self, count: int, gap_s: float | None = None) -> Float[np.ndarray, "samples 3"]:
        """The next `count` samples, g, the first `gap_s` (a period when None) after the last."""
        total = np.zeros((count, 3))
        if not count:
            return total
        for number, part in enumerate(self._parts):
            fresh = self._generator.standard_normal(total.shape)
            gap = self._period_s if gap_s is None else gap_s
            if isinstance(part, GaussMarkov):
                values = self._exponential(part, number, gap, fresh)
            elif isinstance(part, RandomWalk):
                values = self._walk(part, number, gap, fresh)
            else:
                values = part.N / np.sqrt(self._period_s) * fresh
            self._last[number] = values[-1]
            total += values
        return total

    def _exponential(self, part: GaussMarkov, number: int, gap_s: float, fresh: np.ndarray) -> np.ndarray:
        from scipy.signal import lfilter  # brings scipy.stats with it, most of a second that few commands need

        step = self._period_s / part.time_s
        driven = np.sqrt(-np.expm1(-2 * step)) * part.sd * fresh
        driven[0] = part.sd * fresh[0]
        if number in self._last:
            gap = gap_s / part.time_s
            driven[0] = self._last[number] * np.exp(-gap) + np.sqrt(-np.expm1(-2 * gap)) * driven[0]
        return np.asarray(lfilter([1.0], [1.0, -np.exp(-step)], driven, axis=0))

    def _walk(self, part: RandomWalk, number: int, gap_s: float, fresh: np.ndarray) -> np.ndarray:
        steps = part.K * np.sqrt(self._period_s) * fresh
        steps[0] = self._last[number] + part.K * np.sqrt(gap_s) * fresh[0] if number in self._last else 0.0
        return np.cumsum(steps, axis=0)


def dwell_records(
    noise: Noise,
    dwells: Dwells,
    seed: int | np.random.SeedSequence,
    signal: Float[np.ndarray, "positions 3"] | None = None,
) -> Iterator[Float[np.ndarray, "samples 3"]]:
    """Samples of one dwell after the other, g; only one dwell is in memory.

    **Arguments:**

    - `noise`, `dwells`: the model and the schedule; correlated parts continue through the moves.
    - `seed`: of the random numbers.
    - `signal`: true reading of each position, added before rounding.
    """
    stream, end_s = SampleStream(noise, dwells.period_s, seed), None
    rounded = [part.step for part in noise.parts if isinstance(part, Quantisation)]
    for position, (start_s, count) in enumerate(zip(dwells.start_s, dwells.counts, strict=True)):
        total = stream.take(int(count), None if end_s is None else float(start_s - end_s))
        if signal is not None:
            total = signal[position] + total
        for step in rounded:
            total = np.round(total / step) * step
        end_s = float(start_s) + (count - 1) * dwells.period_s
        yield total


def record(noise: Noise, samples: int, period_s: float, seed: int) -> Float[np.ndarray, "samples 3"]:
    """One static record, g."""
    return next(dwell_records(noise, Dwells(np.zeros(1), samples, period_s), seed))
