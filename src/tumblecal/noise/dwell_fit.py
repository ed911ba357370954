"""The noise of a recording in dwells, averaged over every model that its samples allow.

Each dwell is divided into blocks. The contrasts of its block means (without the mean of the dwell) are Gaussian with the
closed-form covariance of `parts`. Their exact likelihood, pooled over dwells, weights the models: white noise with
flicker, with random walk, or with Gauss-Markov noise of any time between a fraction of a block and the whole
measurement. No instrument is exactly white, so every model has a slow part. Its sd at the length of a dwell, over
that of the white noise, is half-Cauchy of scale 1 (Gelman 2006): dwells are about as long as averaging helps, and
small and large ratios are equally probable. The contrasts contain the information of the Allan variances at long
averaging times, with the exact distribution in place of an equivalent number of degrees of freedom. The scale is
integrated out analytically (Jeffreys' prior; Gelman et al. 2013, section 14.2). The average of a covariance over
models is that of the mean squared coefficients (Hoeting et al. 1999), so the result is one sum of parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp, softmax

from tumblecal.noise.parts import Dwells, Flicker, GaussMarkov, Noise, Part, RandomWalk, White


# Number of blocks of a dwell.
_BLOCKS = 32
# Prior of the slow parts: within a dwell a walk and slower Gauss-Markov noise are indistinguishable.
_PRIOR = {"flicker": 0.2, "walk": 0.4, "markov": 0.4}
# Allan variances at the length of a dwell, over that of white noise, that are tried for each: uniform in the logarithm.
_RATIOS = np.geomspace(1e-3, 1e5, 33)
# The ratios of the three axes differ by about this much, in natural logarithms: a factor of two.
_AXES_SPREAD = np.log(2.0)
_MARKOV_TIMES = 28
# Shortest in blocks; longest in dwells, or the whole measurement.
_SHORTEST_MARKOV, _LONGEST_MARKOV = 0.2, 10.0
# Slowest flicker in the model, in lengths of the whole measurement: slower flicker is constant and absorbed by the bias.
_SLOWEST = 10.0
# Parts of the average that add less than this share of the variance at the length of a dwell are omitted.
_SHARE = 1e-3
# A dwell whose sample steps are this much larger than in the others is not used for the noise of the instrument.
_SHAKEN = 1.5
# Samples that do not change at all (coarse quantisation) still have some noise.
LEAST_G = 1e-9


@dataclass(frozen=True)
class _Contrasts:
    """Block means of the dwells of one length: `scatter` (3, blocks - 1, blocks - 1) summed over `dwells`."""

    blocks: int
    dwells: int
    scatter: Float[np.ndarray, "3 contrasts contrasts"]


def ordinary_dwells(
    dwells: Sequence[Float[np.ndarray, "samples 3"]],
) -> list[Float[np.ndarray, "samples 3"]]:
    """The dwells whose noise is like that of the others on all axes."""
    steps = np.array([np.std(np.diff(dwell, axis=0), axis=0) for dwell in dwells])
    calm = np.all(steps <= _SHAKEN * np.median(steps, axis=0), axis=1)
    return [dwell for dwell, ordinary in zip(dwells, calm, strict=True) if ordinary] or list(dwells)


def fit_dwells(dwells: Sequence[Float[np.ndarray, "samples 3"]], rate_hz: float, whole_s: float) -> Noise:
    """The average noise model of a recording.

    **Arguments:**

    - `dwells`: samples of each dwell, g; 8 or more in each.
    - `rate_hz`: sample rate. `whole_s`: from the first dwell to the last.

    **Returns:** white noise, flicker, random walk and Gauss-Markov parts; their squared coefficients are averages over the
    models, weighted by posterior probability, and carry its uncertainty.
    """
    dwells = ordinary_dwells(dwells)
    lengths = np.array([len(dwell) for dwell in dwells])
    size = max(int(np.quantile(lengths, 0.1)) // _BLOCKS, 1)
    block_s, typical_s = size / rate_hz, float(np.median(lengths)) / rate_hz
    # Flicker, walk and Gauss-Markov parts, all with the Allan variance of unit white noise at the length of a dwell.
    unit, tau, shortest_s = np.ones(3), np.array([typical_s]), _SHORTEST_MARKOV * block_s
    longest_s = max(whole_s, _LONGEST_MARKOV * typical_s, 2 * shortest_s)
    slow: list[Part] = [Flicker(unit, 1 / rate_hz, _SLOWEST * max(whole_s, typical_s)), RandomWalk(unit)]
    slow += [GaussMarkov(unit, float(time)) for time in np.geomspace(shortest_s, longest_s, _MARKOV_TIMES)]
    slow = [_scaled(part, unit / np.sqrt(typical_s * part.allan_variance(tau)[0])) for part in slow]
    white, squared = _averaged(_contrasts(dwells, size), slow, size, 1 / rate_hz)
    parts: list[Part] = [White(np.sqrt(np.maximum(white, LEAST_G**2 * typical_s)))]
    for part, squared_size in zip(slow, squared, strict=True):
        if np.any(squared_size > _SHARE * white):
            parts.append(_scaled(part, np.sqrt(squared_size)))
    return Noise(tuple(parts))


def _scaled(part: Part, factor: Float[np.ndarray, "3"]) -> Part:
    """A slow part times a factor for each axis."""
    if isinstance(part, Flicker):
        return Flicker(part.B * factor, part.shortest_s, part.longest_s)
    if isinstance(part, GaussMarkov):
        return GaussMarkov(part.sd * factor, part.time_s)
    assert isinstance(part, RandomWalk)
    return RandomWalk(part.K * factor)


def _contrasts(dwells: Sequence[Float[np.ndarray, "samples 3"]], size: int) -> list[_Contrasts]:
    """Scatter of the contrasts, the dwells grouped by the number of their blocks."""
    means: dict[int, list[np.ndarray]] = {}
    for dwell in dwells:
        count = min(len(dwell) // size, _BLOCKS)
        if count >= 2:
            blocks = (dwell[: count * size] - dwell.mean(axis=0)).reshape(count, size, 3).mean(axis=1)
            means.setdefault(count, []).append(blocks)
    groups = []
    for count, listed in means.items():
        rows = np.einsum("cb,dba->adc", _contrast_matrix(count), np.array(listed))
        groups.append(_Contrasts(count, len(listed), np.einsum("adc,ade->ace", rows, rows)))
    return groups


def _contrast_matrix(count: int) -> Float[np.ndarray, "contrasts blocks"]:
    """Orthonormal contrasts of blocks (Helmert)."""
    return np.linalg.qr(np.eye(count) - 1.0 / count)[0].T[: count - 1]


def _averaged(
    groups: list[_Contrasts], slow: list[Part], size: int, period_s: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "parts 3"]]:
    """Posterior means of N^2 and of the slow parts' ratios times N^2, by axis.

    The slow part is the same for the three axes; its size is each axis's own, equal within `_AXES_SPREAD`.
    """
    rows = sum(group.dwells * (group.blocks - 1) for group in groups)
    # Logarithm of the prior of `_RATIOS`, whose roots are half-Cauchy.
    density = np.log(np.sqrt(_RATIOS) / (1 + _RATIOS))
    common_prior, logs = density - logsumexp(density), np.log(_RATIOS)
    # Probability of the size of an axis (columns) given the size of the triad (rows): log-normal about it.
    near = np.exp(-0.5 * ((logs[:, None] - logs) / _AXES_SPREAD) ** 2)
    near /= np.sum(near, axis=1, keepdims=True)
    evidence, white, ratio = [], [], []
    for part in slow:
        half_log_det, quadratic = np.zeros(len(_RATIOS)), np.full((3, len(_RATIOS)), 1e-300)
        for group in groups:
            # Covariance of the contrasts under a slow part of ratio 1.
            dwell = Dwells(np.arange(group.blocks) * size * period_s, size, period_s)
            contrasts = _contrast_matrix(group.blocks)
            unit_covariance = contrasts @ part.mean_covariance(dwell)[0] @ contrasts.T
            unit, vectors = np.linalg.eigh(unit_covariance)
            variances = 1 / (size * period_s) + _RATIOS[:, None] * unit
            half_log_det += group.dwells / 2 * np.sum(np.log(variances), axis=1)
            quadratic += np.einsum("ik,aij,jk->ak", vectors, group.scatter, vectors) @ (1 / variances).T
        log_likelihood = -half_log_det - rows / 2 * np.log(quadratic)
        largest = np.max(log_likelihood, axis=1, keepdims=True)
        likelihood = np.exp(log_likelihood - largest)
        # By axis (rows) and common size; then the common sizes' weights with all axes together.
        by_common = likelihood @ near.T + 1e-300
        log_common = np.sum(np.log(by_common), axis=0) + common_prior
        evidence.append(np.sum(largest) + logsumexp(log_common))
        weights = (softmax(log_common) / by_common) @ near * likelihood * quadratic / max(rows - 2, 1)
        white.append(np.sum(weights, axis=1))
        ratio.append(weights @ _RATIOS)
    times = len(slow) - 2
    priors = np.array([_PRIOR["flicker"], _PRIOR["walk"], *[_PRIOR["markov"] / times] * times])
    probability = softmax(np.log(priors) + evidence)
    return probability @ np.array(white), probability[:, None] * np.array(ratio)
