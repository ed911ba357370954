"""The error of a mean of rounded readings."""

import numpy as np
from numpy.typing import NDArray


_HARMONICS = np.arange(1, 200)
# Variance of the harmonics beyond these, in squared steps, which matter only without noise.
_REST = (np.pi**2 / 6 - (1 / _HARMONICS**2).sum()) / (2 * np.pi**2)


def rounding_sd(step: NDArray[np.float64], noise_sd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root mean square error of the mean of readings that are rounded to multiples of a step, over all true values.

    A noise of half a step dithers the rounding, and the error vanishes; without noise it is `step / sqrt(12)`. The error is the
    Fourier series `sum of (-1)^k step / (pi k) exp(-2 pi^2 k^2 s^2 / step^2) sin(2 pi k x / step)` (Widrow and Kollar 2008,
    Quantization Noise, chapter 9).

    **Arguments:**

    - `step`, `noise_sd`: of equal shape and unit; the noise before rounding. A step of 0 has no error.
    """
    ratio = noise_sd / np.where(step > 0, step, 1.0)
    damping = np.exp(-4 * np.pi**2 * _HARMONICS**2 * ratio[..., None] ** 2) / _HARMONICS**2
    rest = np.where(ratio < 1e-4, _REST, 0.0) * (step > 0)
    return step * np.sqrt(damping.sum(-1) / (2 * np.pi**2) + rest)


def noise_before_rounding(step: NDArray[np.float64], sample_sd: NDArray[np.float64]) -> NDArray[np.float64]:
    """The noise of readings before rounding from their standard deviation s after it, by Sheppard's correction
    `s^2 - step^2 / 12`; 0 if rounding explains it."""
    return np.sqrt(np.maximum(sample_sd**2 - step**2 / 12, 0.0))
