"""Raw samples of a noise model, for what its closed forms are checked against and for `--raw` studies. Plain numpy."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from tumblecal.noise.parts import Dwells, GaussMarkov, Noise, Quantisation, RandomWalk, White


def dwell_records(
    noise: Noise,
    dwells: Dwells,
    seed: int | np.random.SeedSequence,
    signal: Float[np.ndarray, "positions 3"] | None = None,
) -> Iterator[Float[np.ndarray, "samples 3"]]:
    """Samples of one dwell after the other, g; only one dwell is in memory.

    **Arguments:**

    - `noise`, `dwells`: the model and the schedule; correlated parts go on through the moves in between.
    - `seed`: of the random numbers.
    - `signal`: true reading of each position, added before rounding.
    """
    generator = np.random.default_rng(seed)
    states: dict[int, np.ndarray] = {}
    end_s = None
    for position, start_s in enumerate(dwells.start_s):
        gap_s = 0.0 if end_s is None else float(start_s - end_s)
        total = np.zeros((dwells.samples, 3))
        if signal is not None:
            total += signal[position]
        for place, part in enumerate(noise.processes):
            if isinstance(part, White):
                total += part.N / np.sqrt(dwells.period_s) * generator.standard_normal(total.shape)
            elif isinstance(part, GaussMarkov):
                total += _exponential(part, dwells, states, place, gap_s, generator)
            elif isinstance(part, RandomWalk):
                total += _walk(part, dwells, states, place, gap_s, generator)
        for part in noise.parts:
            if isinstance(part, Quantisation):
                step = part.step
                total = np.round(total / step) * step
        end_s = float(start_s) + (dwells.samples - 1) * dwells.period_s
        yield total


def record(noise: Noise, samples: int, period_s: float, seed: int) -> Float[np.ndarray, "samples 3"]:
    """One static record, g."""
    return next(dwell_records(noise, Dwells(np.zeros(1), samples, period_s), seed))


def _exponential(part: GaussMarkov, dwells: Dwells, states, place: int, gap_s: float, generator) -> np.ndarray:
    sd, step = part.sd, dwells.period_s / part.time_s
    fresh = generator.standard_normal((dwells.samples, 3))
    if place in states:
        first = (
            states[place] * np.exp(-gap_s / part.time_s) + np.sqrt(-np.expm1(-2 * gap_s / part.time_s)) * sd * fresh[0]
        )
    else:
        first = sd * fresh[0]
    driven = np.sqrt(-np.expm1(-2 * step)) * sd * fresh
    driven[0] = first
    values = np.asarray(lfilter([1.0], [1.0, -np.exp(-step)], driven, axis=0))
    states[place] = values[-1]
    return values


def _walk(part: RandomWalk, dwells: Dwells, states, place: int, gap_s: float, generator) -> np.ndarray:
    K, fresh = part.K, generator.standard_normal((dwells.samples, 3))
    steps = K * np.sqrt(dwells.period_s) * fresh
    steps[0] = states[place] + K * np.sqrt(gap_s) * fresh[0] if place in states else 0.0
    values = np.cumsum(steps, axis=0)
    states[place] = values[-1]
    return values
