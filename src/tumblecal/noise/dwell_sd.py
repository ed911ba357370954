"""Standard deviations of the means over dwells: by the recording's noise, by batch means, and as if the noise were white."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.noise.recorded import RecordedNoise


# For a dwell this much noisier (sd of its samples) than the others, the sd is estimated from that dwell.
_NOISIER = 1.5
_BATCHES = 10


def sd_of_means(
    recorded: RecordedNoise,
    dwells: Sequence[Float[np.ndarray, "samples 3"]],
    middle_s: Float[np.ndarray, " positions"] | None,
) -> Float[np.ndarray, "positions 3"]:
    """Sd of each mean relative to its neighbours, g; without `middle_s`, to a mean of equal length just before or after it.

    For a dwell that is noisier than the others, the sd of its samples and batch means is used if it is larger.
    """
    counts = np.array([len(dwell) for dwell in dwells])
    if middle_s is None:
        expected = recorded.noise.allan_deviation(counts / recorded.rate_hz)
    else:
        expected = recorded.sd_of_means(middle_s, counts)
    of_dwell = np.stack([white_sd(dwell) for dwell in dwells])
    spread = of_dwell * np.sqrt(counts)[:, None]
    noisier = spread > _NOISIER * np.median(spread, axis=0)
    batches = np.stack([batch_means_sd(dwell) for dwell in dwells])
    return np.where(noisier, np.fmax(np.maximum(expected, of_dwell), batches), expected)


def white_sd(dwell: Float[np.ndarray, "samples 3"]) -> Float[np.ndarray, "3"]:
    """sd / sqrt(n), g: of the mean of independent samples."""
    return dwell.std(0, ddof=1) / np.sqrt(len(dwell))


def batch_means_sd(dwell: Float[np.ndarray, "samples 3"]) -> Float[np.ndarray, "3"]:
    """Sd of the mean from a few long batches; correct if the batches are longer than the correlation time."""
    size = len(dwell) // _BATCHES
    if size < 1:
        return np.full(3, np.nan)
    means = dwell[: _BATCHES * size].reshape(_BATCHES, size, 3).mean(1)
    return means.std(0, ddof=1) / np.sqrt(_BATCHES)
