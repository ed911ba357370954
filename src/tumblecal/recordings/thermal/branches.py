"""Branches of a temperature: monotonic stretches between turning points, and soaks.

Rules: a turning point is an extreme from which the temperature later returns by more than a threshold. A soak is a stretch of
time in which the rate is below a fifth of the mean rate of the recording, and in which that mean rate would change the
temperature by one bin or more.
"""

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy import ndimage

from tumblecal.recordings.thermal.series import ThermalSeries


# Return of the temperature at a turning point: in bins, in resolution steps and in standard deviations of the noise.
_RETURN_BINS, _RETURN_STEPS, _RETURN_SD = 3.0, 3.0, 6.0
# Rate of a soak as a share of the mean rate.
_SOAK_RATE = 0.2
_WORDS = np.array(["constant", "up", "down"])


def stretches_of_temperature(
    degc: NDArray[np.float64], bin_degc: float, resolution: float = 0.0, noise: float = 0.0
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The number of the monotonic stretch of each temperature, and its sign: +1, -1, or 0 if nothing changes.

    **Arguments:** `bin_degc`: width of the bins. `resolution`, `noise`: of the temperatures, degC.
    """
    threshold = max(_RETURN_BINS * bin_degc, _RETURN_STEPS * resolution, _RETURN_SD * noise)
    turns, sign = list[int](), 0
    lowest = highest = 0
    for k, value in enumerate(degc.tolist()):
        lowest = k if value < degc[lowest] else lowest
        highest = k if value > degc[highest] else highest
        if sign >= 0 and degc[highest] - value > threshold:
            turns.append(highest)
            sign, lowest = -1, k
        elif sign <= 0 and value - degc[lowest] > threshold:
            turns.append(lowest)
            sign, highest = 1, k
    # The first extreme is no turning point: what precedes it belongs to the first stretch.
    stretch = np.searchsorted(np.array(turns[1:], int), np.arange(len(degc)), side="left")
    return stretch, sign * (-1) ** (max(len(turns) - 1, 0) - stretch)


def branches(stretch: NDArray[np.int64], sign: NDArray[np.int64], soak: NDArray[np.int64]) -> pl.DataFrame:
    """The branch of each temperature; a whole soak is on the stretch by which it was reached.

    Columns: `stretch`, `soak` (-1 for none), `direction` and `reached_by` as of `ThermalTable`, and `branch`, such as `1 up`.

    **Arguments:** `stretch`, `sign`: as of `stretches_of_temperature`. `soak`: its number; -1 for none.
    """
    _, first, group = np.unique(soak, return_index=True, return_inverse=True)
    at = np.where(soak >= 0, first[group], np.arange(len(soak)))
    return pl.DataFrame(
        {
            "stretch": stretch[at],
            "soak": soak,
            "direction": np.where(soak >= 0, 0, sign),
            "reached_by": np.where((soak >= 0) & (at == 0), 0, sign[at]),
            "word": _WORDS[sign[at]],
        }
    ).with_columns(branch=pl.format("{} {}", pl.col("stretch") + 1, pl.col("word")))


def branches_of_course(series: ThermalSeries, bin_degc: float) -> pl.DataFrame:
    """The smoothed temperature of a recording with the columns of `branches`, for bins of this width, degC."""
    degc, cell_s = series.course["temperature_degc"].to_numpy(), series.cell_s
    stretch, sign = stretches_of_temperature(degc, bin_degc, series.resolution, series.noise)
    soak = np.zeros_like(stretch)
    if sign.any():
        edges = np.append(np.flatnonzero(np.diff(stretch, prepend=-1)), len(degc) - 1)
        mean_rate = float(np.abs(np.diff(degc[edges])).sum()) / (cell_s * len(degc))
        least = max(3, round(bin_degc / mean_rate / cell_s))
        # A thermostat's cycle is averaged over half of the least length.
        rate = ndimage.uniform_filter1d(series.course["rate_degc_per_s"].to_numpy(), max(1, least // 2), mode="nearest")
        slow = np.abs(rate) < _SOAK_RATE * mean_rate
        run = np.cumsum(slow & np.diff(slow, prepend=False))
        soak = np.where(slow & (np.bincount(run, slow) >= least)[run], run, -1)
    return series.course.hstack(branches(stretch, sign, soak))
