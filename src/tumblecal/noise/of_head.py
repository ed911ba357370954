"""Noise that dwells share, as `[head.noise]` of a rig states it: flicker, Gauss-Markov, random walk, linear drift, warm-up.

Drift and warm-up are signals of a known shape and a random size; as noise they have a covariance of rank one, which is the same
as a nuisance parameter with a prior.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from tumblecal.chain.head_ability import SlowNoise, Times
from tumblecal.noise.parts import Dwells, Flicker, GaussMarkov, Noise, Part, RandomWalk


# Slow noise is evaluated with so many samples in a dwell: its means do not depend on the rate of the samples.
_SAMPLES = 60
# Knots of the tabulated covariance over the logarithm of the time between two dwells: interpolation errs by 1e-6 of it.
_KNOTS = 8192
_HOUR_S = 3600.0

# Covariance of the means of dwells that begin at some instants, g^2, the same on each axis.
OfStarts = Callable[[Float[np.ndarray, "*n positions"]], Float[np.ndarray, "*n positions positions"]]


def slow_noise(stated: SlowNoise, times: Times) -> Noise:
    """The random processes that neighbouring dwells share, without drift and warm-up."""
    unit, parts = np.ones(3), list[Part]()
    if stated.bias_instability_g:
        shortest = times.dwell_s / _SAMPLES
        parts.append(Flicker(unit * stated.bias_instability_g, shortest_s=shortest))
    if stated.markov_sd_g:
        parts.append(GaussMarkov(unit * stated.markov_sd_g, stated.markov_time_s))
    if stated.random_walk_g_per_rts:
        parts.append(RandomWalk(unit * stated.random_walk_g_per_rts))
    return Noise(tuple(parts))


def drift_shapes(
    stated: SlowNoise, times: Times, start_s: Float[np.ndarray, "*n positions"]
) -> Float[np.ndarray, "*n positions shapes"]:
    """Means over the dwells of one standard deviation of drift and of warm-up, g; without columns if neither is stated.

    Drift is zero at the mean time of the dwells, warm-up is full at the start of the first dwell and fades to zero.
    """
    shapes = []
    if stated.drift_g_per_h:
        shapes.append(stated.drift_g_per_h * (start_s - np.mean(start_s, axis=-1, keepdims=True)) / _HOUR_S)
    if stated.warm_up_g:
        dwell = times.dwell_s / stated.warm_up_time_s
        mean = -np.expm1(-dwell) / dwell
        since = start_s - np.min(start_s, axis=-1, keepdims=True)
        shapes.append(stated.warm_up_g * mean * np.exp(-since / stated.warm_up_time_s))
    return np.stack(shapes, axis=-1) if shapes else np.zeros((*start_s.shape, 0))


def slow_covariance(
    stated: SlowNoise, times: Times, start_s: Float[np.ndarray, " positions"]
) -> Float[np.ndarray, "3 positions positions"]:
    """Covariance of the means of dwells on each axis, g^2."""
    dwells = Dwells(start_s, _SAMPLES, times.dwell_s / _SAMPLES)
    shapes = drift_shapes(stated, times, start_s)
    return slow_noise(stated, times).mean_covariance(dwells) + shapes @ shapes.T


def tabulated_covariance(stated: SlowNoise, times: Times, longest_s: float) -> OfStarts:
    """`slow_covariance` on one axis as a function of the starts, tabulated over the time between two dwells up to `longest_s`:
    for a search that needs it many times."""
    period = times.dwell_s / _SAMPLES
    terms = [term for term in slow_noise(stated, times).processes if isinstance(term, GaussMarkov)]
    pair = Dwells(np.array([0.0, times.dwell_s]), _SAMPLES, period)
    logarithm = np.linspace(np.log(times.dwell_s), np.log(max(longest_s, 2 * times.dwell_s)), _KNOTS)
    table, variance = np.zeros(_KNOTS + 1), 0.0
    for term in terms:
        here = term.mean_covariance(pair)[0]
        variance += here[0, 0]
        table[:-1] += here[0, 1] * np.exp(-(np.exp(logarithm) - times.dwell_s) / term.time_s)
    table[-1] = table[-2]
    step, walk = logarithm[1] - logarithm[0], stated.random_walk_g_per_rts**2

    def covariance(start_s: Float[np.ndarray, "*n positions"]) -> Float[np.ndarray, "*n positions positions"]:
        shapes, same = drift_shapes(stated, times, start_s), np.eye(start_s.shape[-1], dtype=bool)
        total = shapes @ shapes.swapaxes(-1, -2)
        if terms:
            lag = np.where(same, times.dwell_s, np.abs(start_s[..., :, None] - start_s[..., None, :]))
            at = np.clip((np.log(lag) - logarithm[0]) / step, 0.0, _KNOTS - 1.0)
            below = at.astype(np.intp)
            at -= below
            total += np.where(same, variance, table[below] * (1 - at) + table[below + 1] * at)
        if walk:
            # `RandomWalk.mean_covariance` for dwells of one length that do not overlap.
            since = walk * (start_s - start_s.min(axis=-1, keepdims=True))
            common = np.minimum(since[..., :, None], since[..., None, :]) + walk * (_SAMPLES - 1) / 2 * period
            alone = since[..., None] + walk * (_SAMPLES - 1) * (2 * _SAMPLES - 1) / (6 * _SAMPLES) * period
            total += np.where(same, alone, common)
        return total

    return covariance
