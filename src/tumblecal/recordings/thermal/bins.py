"""Bins of equal width over temperature within each stay in an attitude and each branch; one for each soak; with uncertainties.

Every bin is one row, so the weight over temperature is equal, whatever the number of its samples. The standard deviation of a
mean is that of the average of the noise models that fit the blocks of all bins of similar length (as for dwells), without the
change with temperature within a bin: the Allan deviation at the length of the bin. The rounding of the readings, and the
uncertainty of the temperature times the slope of the readings, are added.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from tumblecal.ground.blas import single_blas_thread
from tumblecal.noise.dwell_sd import sd_of_means
from tumblecal.noise.recorded import RecordedNoise
from tumblecal.recordings.dwells.place import angles_of
from tumblecal.recordings.thermal.branches import Branches, branches_of
from tumblecal.recordings.thermal.rounding import noise_before_rounding, rounding_sd
from tumblecal.recordings.thermal.series import ThermalSeries
from tumblecal.recordings.thermal.smoothed_temperature import TemperatureCourse, temperature_course
from tumblecal.recordings.thermal.thermal_table import ThermalTable


# Default width: this share of the range, and at least so many resolution steps and standard deviations of the thermometer.
BINS, _WIDTH_STEPS, _WIDTH_SD = 40, 3.0, 4.0
# Fewest blocks of a bin; a bin at the end of a stay with less than this share of the width belongs to its neighbour.
FEWEST_BLOCKS, _FRAGMENT = 8, 0.25
# Highest order of the polynomial that removes the change with temperature within bins.
_HIGHEST_ORDER = 5
# Rows whose lengths differ by less than this factor have one noise model.
_SIMILAR = 4.0
_LEAST_SD_G, _LEAST_WIDTH_DEGC = 1e-9, 1e-6


def course_of(series: ThermalSeries) -> TemperatureCourse:
    """The smoothed temperature of a recording."""
    return temperature_course(series.course_time_s, series.course_degc, series.resolution)


def default_width(recordings: Sequence[tuple[ThermalSeries, TemperatureCourse]]) -> float:
    """The width of a bin, degC: a fortieth of the range of these recordings at rest, and at least three resolution steps and
    four standard deviations of their thermometers."""
    degc = np.concatenate([course.at(series.time_s)[0] for series, course in recordings])
    finest = max(max(_WIDTH_STEPS * course.resolution, _WIDTH_SD * course.noise) for _, course in recordings)
    return max(float(np.ptp(degc)) / BINS, finest, _LEAST_WIDTH_DEGC)


def binned(
    series: ThermalSeries, course: TemperatureCourse, bin_degc: float, before: int = 0
) -> tuple[ThermalTable, Branches]:
    """The bins of a recording.

    **Arguments:**

    - `before`: number of earlier branches of the same recording.
    """
    branches = branches_of(course, bin_degc)
    degc, rate = course.at(series.time_s)
    cell = np.clip(np.round((series.time_s - course.time_s[0]) / max(course.cell_s, 1e-9)), 0, len(course.degc) - 1)
    cell = cell.astype(int)
    row = row_of_blocks(series.visit, branches.stretch[cell], branches.soak[cell], degc, bin_degc)
    used = row >= 0
    count = int(row.max(initial=-1)) + 1
    blocks = np.bincount(row[used], minlength=count)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(row[used], values[used], minlength=count) / blocks

    readings = np.column_stack([mean(series.force[:, axis]) for axis in range(3)])
    first = np.full(count, len(row))
    np.minimum.at(first, row[used], np.flatnonzero(used))
    warmth, middle = mean(degc), mean(series.time_s)
    attitude = series.attitude[series.visit[first]]
    residuals, slope = _without_slope(series.force, degc, row, readings, warmth, attitude)
    sd, n_eff = _uncertainty(series, residuals, row, blocks)
    sd = np.hypot(sd, slope * _temperature_sd(course, degc, row, series.block_s * blocks.astype(np.float64))[:, None])
    places = [series.places[k] for k in attitude.tolist()]
    alpha, beta = angles_of(places)
    angles = all(place.known for place in places)
    mounted = all(place.mount for place in places)
    table = ThermalTable(
        attitude=tuple(place.name for place in places),
        readings=readings,
        sd=sd,
        n=(blocks * series.size).astype(float),
        temperature_degc=warmth,
        time_s=middle,
        rate_degc_per_s=mean(rate),
        branch=tuple(branches.label(series.name, k, before) for k in branches.stretch[cell[first]].tolist()),
        direction=branches.direction[cell[first]],
        reached_by=branches.reached_by[cell[first]],
        clock=(series.clock,) * count,
        n_eff=n_eff,
        alpha_deg=alpha if angles else None,
        beta_deg=beta if angles else None,
        mount=tuple(place.mount for place in places) if mounted else None,
        source=str(series.recording.path),
        comments=series.comments,
    )
    return table.rows(np.argsort(middle, kind="stable")), branches


def row_of_blocks(
    visit: NDArray[np.int64],
    stretch: NDArray[np.int64],
    soak: NDArray[np.int64],
    degc: NDArray[np.float64],
    bin_degc: float,
) -> NDArray[np.int64]:
    """The row of each block: one for each stay, stretch and bin, or soak; -1 for a stay that is too short.

    A bin with too few blocks, or a fragment at the end of a stay, is joined with its neighbour in temperature.
    """
    bins = np.where(soak >= 0, 0, np.floor(degc / bin_degc)).astype(int)
    keys = np.column_stack([visit, stretch, soak, bins])
    unique, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.reshape(-1)
    counts = np.bincount(group, minlength=len(unique))
    low, high = np.full(len(unique), np.inf), np.full(len(unique), -np.inf)
    np.minimum.at(low, group, degc)
    np.maximum.at(high, group, degc)
    new = np.arange(len(unique))
    begins = np.flatnonzero(np.append(True, (np.diff(unique[:, :3], axis=0) != 0).any(1)))
    for start, stop in zip(begins, np.append(begins[1:], len(unique)), strict=True):
        members = [[k] for k in range(int(start), int(stop))]
        while len(members) > 1:
            sizes = [int(counts[one].sum()) for one in members]
            spans = [float(high[one].max() - low[one].min()) for one in members]
            small = [k for k, size in enumerate(sizes) if size < FEWEST_BLOCKS]
            small += [k for k in (0, len(members) - 1) if spans[k] < _FRAGMENT * bin_degc]
            if not small:
                break
            k = min(small, key=lambda k: sizes[k])
            neighbours = [j for j in (k - 1, k + 1) if 0 <= j < len(members)]
            into = min(neighbours, key=lambda j: sizes[j])
            members[into] = sorted(members[into] + members[k])
            del members[k]
        for one in members:
            new[one] = one[0] if counts[one].sum() >= FEWEST_BLOCKS else -1
    row = new[group]
    numbers = np.unique(row[row >= 0])
    return np.where(row >= 0, np.searchsorted(numbers, row), -1)


def _without_slope(
    force: NDArray[np.float64],
    degc: NDArray[np.float64],
    row: NDArray[np.int64],
    readings: NDArray[np.float64],
    warmth: NDArray[np.float64],
    attitude: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The blocks (blocks, 3) without the change with temperature within their row: that of a polynomial through the means of
    the attitude's rows, so that the noise within a row is not fitted; and its slope at each row (rows, 3), g/degC."""
    residual, slope = np.zeros_like(force), np.zeros_like(readings)
    for one in np.unique(attitude):
        rows = np.flatnonzero(attitude == one)
        blocks = np.flatnonzero(np.isin(row, rows))
        low, high = warmth[rows].min(), warmth[rows].max()
        places = len(np.unique(np.floor(BINS * (warmth[rows] - low) / max(high - low, 1e-12))))
        order = min(_HIGHEST_ORDER, places // 2)
        middle, half = (low + high) / 2, max((high - low) / 2, 1e-12)
        basis = np.polynomial.legendre.legvander((warmth[rows] - middle) / half, order)
        coefficients = np.linalg.lstsq(basis, readings[rows], rcond=1e-8)[0]
        coefficients[0] = 0.0
        # Beyond the means of the outermost rows the polynomial is not continued.
        at = np.clip((degc[blocks] - middle) / half, -1.2, 1.2)
        change = np.polynomial.legendre.legval(at, coefficients).T
        residual[blocks] = force[blocks] - change
        steeper = np.polynomial.legendre.legder(coefficients) / half if order else np.zeros((1, 3))
        slope[rows] = np.polynomial.legendre.legval((warmth[rows] - middle) / half, steeper).T
    return residual, slope


def _temperature_sd(
    course: TemperatureCourse, degc: NDArray[np.float64], row: NDArray[np.int64], length_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Standard deviation of the mean temperature of each row, degC: noise of the thermometer, and its rounding, which averages
    out over the steps that the row spans."""
    low, high = np.full(len(length_s), np.inf), np.full(len(length_s), -np.inf)
    used = row >= 0
    np.minimum.at(low, row[used], degc[used])
    np.maximum.at(high, row[used], degc[used])
    resolution = np.array([course.resolution])
    # `noise` includes the rounding twice: that of the readings, and the least that is assumed for equal readings.
    noise = noise_before_rounding(resolution * np.sqrt(2), np.array([course.noise]))
    rounding = rounding_sd(resolution, noise) / np.maximum((high - low) / max(course.resolution, 1e-12), 1.0)
    return np.hypot(rounding, course.noise / np.sqrt(np.maximum(length_s / max(course.cell_s, 1e-12), 1.0)))


def _uncertainty(
    series: ThermalSeries,
    residuals: NDArray[np.float64],
    row: NDArray[np.int64],
    blocks: NDArray[np.int64],
) -> tuple[Float[np.ndarray, "rows 3"], Float[np.ndarray, "rows 3"]]:
    """Standard deviations of the means, and numbers of independent samples."""
    order = np.argsort(row, kind="stable")
    order = order[row[order] >= 0]
    dwells = [residuals[one] for one in np.split(order, np.cumsum(blocks)[:-1])]
    # The noise within short rows does not determine that of means over long ones: rows of similar length have one model.
    similar = np.round(np.log(blocks) / np.log(_SIMILAR)).astype(int)
    sd = np.zeros((len(blocks), 3))
    for length in np.unique(similar):
        rows = np.flatnonzero(similar == length)
        of_length = [dwells[k] for k in rows]
        with single_blas_thread():
            noise = RecordedNoise.of(of_length, 1 / series.block_s, float(np.ptp(series.time_s)))
        sd[rows] = sd_of_means(noise, of_length, None)
    within = np.column_stack([np.bincount(row[row >= 0], series.squares[row >= 0, axis]) for axis in range(3)])
    freedom = blocks[:, None] * max(series.size - 1, 1)
    sample = within / freedom
    usual = np.sqrt(np.sum(within, axis=0) / np.sum(freedom))
    rounding = rounding_sd(series.quantum, noise_before_rounding(series.quantum, usual))
    whole = np.sqrt(sd**2 + rounding**2)
    least = series.quantum / np.sqrt(12 * blocks[:, None] * series.size)
    whole = np.maximum(whole, np.maximum(least, _LEAST_SD_G))
    n = blocks[:, None] * series.size
    n_eff = np.clip(np.maximum(sample, series.quantum**2 / 12) / whole**2, 1.0, n)
    return whole, n_eff
