"""Branches of a course of temperature: monotonic stretches between turning points, and soaks.

Rules: a turning point is an extreme from which the temperature later returns by more than a threshold. A soak is a stretch of
time in which the rate is below a fifth of the mean rate of the recording, and in which that mean rate would change the
temperature by one bin or more.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tumblecal.recordings.thermal.smoothed_temperature import TemperatureCourse


# Return of the temperature at a turning point: in bins, in resolution steps and in standard deviations of the noise.
_RETURN_BINS, _RETURN_STEPS, _RETURN_SD = 3.0, 3.0, 6.0
# Rate of a soak as a share of the mean rate.
_SOAK_RATE = 0.2
_WORDS = {1: "up", -1: "down", 0: "constant"}


@dataclass(frozen=True)
class Branches:
    """The branch of each point of a course of temperature.

    - `stretch` (points): number of the monotonic stretch, from 0. `sign` (stretches): +1 rising, -1 falling, 0 constant.
    - `soak` (points): number of the soak, from 0; -1 in none. `reached_by` (points): sign of the stretch by which the point was
      reached; 0 in a soak before any change.
    """

    stretch: NDArray[np.int64]
    sign: NDArray[np.int64]
    soak: NDArray[np.int64]
    reached_by: NDArray[np.int64]

    @property
    def direction(self) -> NDArray[np.int64]:
        """+1 while the temperature rises, -1 while it falls, 0 in a soak (points)."""
        return np.where(self.soak >= 0, 0, self.sign[self.stretch])

    def label(self, name: str, stretch: int, before: int = 0) -> str:
        """The label of a stretch of a recording with `before` earlier stretches: `name:1 up`."""
        return f"{name}:{before + stretch + 1} {_WORDS[int(self.sign[stretch])]}"


def threshold_of(bin_degc: float, resolution: float, noise: float) -> float:
    """The return of the temperature that shows a turning point, degC."""
    return max(_RETURN_BINS * bin_degc, _RETURN_STEPS * resolution, _RETURN_SD * noise)


def branches_of(course: TemperatureCourse, bin_degc: float) -> Branches:
    """The branches of a smoothed temperature, for bins of this width."""
    stretch, sign = stretches_of_temperature(course.degc, threshold_of(bin_degc, course.resolution, course.noise))
    runs = _soak_runs(course, stretch, sign, bin_degc)
    soak = np.full(len(stretch), -1)
    for number, (start, stop) in enumerate(runs):
        soak[start:stop] = number
    return with_soaks(stretch, sign, soak)


def with_soaks(stretch: NDArray[np.int64], sign: NDArray[np.int64], soak: NDArray[np.int64]) -> Branches:
    """Branches with each whole soak on the stretch by which it was reached."""
    stretch, reached_by = stretch.copy(), sign[stretch]
    for number in range(int(soak.max(initial=-1)) + 1):
        rows = np.flatnonzero(soak == number)
        stretch[rows] = stretch[rows[0]]
        reached_by[rows] = sign[stretch[rows[0]]] if rows[0] > 0 else 0
    return Branches(stretch, sign, soak, reached_by)


def stretches_of_temperature(
    degc: NDArray[np.float64], threshold: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The number of the monotonic stretch of each point, and the sign of each stretch: +1, -1, or 0 if nothing changes."""
    turns, sign, extreme = list[int](), 0, 0
    lowest = highest = 0
    for k, value in enumerate(degc.tolist()):
        if sign == 0:
            lowest = k if value < degc[lowest] else lowest
            highest = k if value > degc[highest] else highest
            if degc[highest] - degc[lowest] > threshold:
                sign, extreme = (1, highest) if highest > lowest else (-1, lowest)
                # The start of the first stretch: what precedes its first extreme belongs to it.
        elif sign * (value - degc[extreme]) > 0:
            extreme = k
        elif sign * (degc[extreme] - value) > threshold:
            turns.append(extreme)
            sign, extreme = -sign, k
    first = sign * (-1) ** len(turns)
    signs = np.array([first * (-1) ** k for k in range(len(turns) + 1)])
    return np.searchsorted(np.array(turns, int), np.arange(len(degc)), side="left"), signs


def _soak_runs(
    course: TemperatureCourse, stretch: NDArray[np.int64], sign: NDArray[np.int64], bin_degc: float
) -> list[tuple[int, int]]:
    """First and last cell (exclusive) of each soak."""
    count = len(stretch)
    if not sign.any():
        return [(0, count)]
    edges = np.append(np.flatnonzero(np.diff(stretch, prepend=-1)), count - 1)
    travel = float(np.abs(np.diff(course.degc[edges])).sum())
    mean_rate = travel / (course.cell_s * count)
    least = max(3, round(bin_degc / mean_rate / course.cell_s))
    if least >= count:
        return []
    # A thermostat's cycle is averaged over half of the least length.
    rate = ndimage.uniform_filter1d(course.rate, max(1, least // 2), mode="nearest")
    slow = np.abs(rate) < _SOAK_RATE * mean_rate
    ends = np.flatnonzero(np.diff(np.concatenate([[False], slow, [False]]).astype(int))).reshape(-1, 2)
    return [(int(start), int(stop)) for start, stop in ends if stop - start >= least]
