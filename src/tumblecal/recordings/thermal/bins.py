"""Bins of equal width over temperature within each stay in an attitude and each branch; one for each soak; with uncertainties.

Every bin is one row, so the weight over temperature is equal, whatever the number of its samples. The standard deviation of a
mean is that of the average of the noise models that fit the blocks of all bins of similar length (as for dwells), without the
change with temperature within a bin: the Allan deviation at the length of the bin. The rounding of the readings, and the
uncertainty of the temperature times the slope of the readings, are added.
"""

from collections.abc import Sequence

import numpy as np
import polars as pl
from numpy.polynomial import legendre

from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.ground.precision import single_blas_thread
from tumblecal.noise.dwell_sd import sd_of_means
from tumblecal.noise.recorded import RecordedNoise
from tumblecal.recordings.thermal.series import SQUARES, ThermalSeries
from tumblecal.recordings.thermal.temperature import RATE, TEMPERATURE, branches_of_course
from tumblecal.recordings.thermal.thermal_table import INDEPENDENT, READINGS, SDS, ThermalTable


# A change that a thermometer shows: in resolution steps, and in standard deviations. Default width: this share of the range.
_STEPS, _SD, BINS = 3.0, 4.0, 40
# Fewest blocks of a bin; a bin at the end of a stay with less than this share of the width belongs to its neighbour.
FEWEST_BLOCKS, _FRAGMENT = 8, 0.25
# Highest order of the polynomial that removes the change with temperature within bins; range, in halves of that of the rows, in
# which it is used.
_HIGHEST_ORDER, _CONTINUED = 5, 1.2
# Rows whose lengths differ by less than this factor have one noise model.
_SIMILAR = 4.0
_LEAST_SD_G, _LEAST_WIDTH_DEGC = 1e-9, 1e-6
_HARMONICS = np.arange(1, 200)
# Variance of the harmonics beyond these, in squared steps, which matter only without noise.
_REST = (np.pi**2 / 6 - (1 / _HARMONICS**2).sum()) / (2 * np.pi**2)


def finest_of(series: Sequence[ThermalSeries]) -> float:
    """The smallest change that the thermometers of these recordings show, degC: three resolution steps, and four standard
    deviations."""
    return max([_LEAST_WIDTH_DEGC, *(max(_STEPS * one.resolution, _SD * one.noise) for one in series)])


def default_width(degc: Floats, series: Sequence[ThermalSeries]) -> float:
    """The width of a bin, degC: a fortieth of the range of temperatures, and at least `finest_of` recordings."""
    return max(float(np.ptp(degc)) / BINS, finest_of(series))


def binned(series: ThermalSeries, bin_degc: float) -> tuple[ThermalTable, pl.DataFrame]:
    """The bins of a recording for bins of this width, degC; and its temperature with the branches (`branches_of_course`)."""
    course = branches_of_course(series.course, series.cell_s, series.resolution, series.noise, bin_degc)
    cell = np.round((series.blocks["time_s"].to_numpy() - course["time_s"][0]) / series.cell_s).astype(int)
    blocks = series.blocks.hstack(course[cell].select("stretch", "soak", "branch", "direction", "reached_by"))
    blocks = blocks.with_columns(row=_row_of_blocks(blocks, bin_degc)).filter(pl.col("row") >= 0)
    blocks = blocks.sort("row", maintain_order=True)
    row, degc = blocks["row"].to_numpy(), blocks[TEMPERATURE].to_numpy()
    starts = np.flatnonzero(np.diff(row, prepend=-1))
    count = np.diff(np.append(starts, len(row)))
    means = {name: np.bincount(row, blocks[name]) / count for name in (*READINGS, "time_s", TEMPERATURE, RATE)}
    labels = blocks[starts].select(
        "direction", "reached_by", branch=pl.format("{}:{}", pl.lit(series.clock), "branch"), run=pl.lit(series.clock)
    )
    visits = series.visits[blocks["visit"][starts]]
    table = pl.concat([visits, labels, pl.DataFrame(means | {"n": 1.0 * count * series.size})], how="horizontal")
    residuals, slope = _without_slope(blocks, table)
    within = np.column_stack([np.bincount(row, blocks[name]) for name in SQUARES])
    sd, n_eff = _uncertainty(series, np.split(residuals, starts)[1:], within)
    # The thermometer's noise includes its rounding twice: that of the readings, and the least that is assumed for equal
    # readings. The rounding averages out over the steps that a row spans.
    span, step = np.maximum.reduceat(degc, starts) - np.minimum.reduceat(degc, starts), np.array([series.resolution])
    noise = _before_rounding(step * np.sqrt(2), np.array([series.noise]))
    rounding = _rounding_sd(step, noise) / np.maximum(span / np.maximum(step, 1e-12), 1.0)
    of_mean = series.noise / np.sqrt(np.maximum(series.block_s * count / series.cell_s, 1.0))
    sd = np.hypot(sd, slope * np.hypot(rounding, of_mean)[:, None])
    table = table.hstack(pl.DataFrame(np.hstack([sd, n_eff]), [*SDS, *INDEPENDENT])).sort("time_s", maintain_order=True)
    return ThermalTable(table, series.source, series.comments), course


def _row_of_blocks(blocks: pl.DataFrame, bin_degc: float) -> Integers:
    """The row of each block: one for each stay, stretch and bin, or soak; -1 for a stay that is too short.

    A bin with too few blocks, or a fragment at the end of a stay, is joined with its neighbour in temperature.

    **Arguments:** `blocks`: with the columns `visit`, `stretch`, `soak` and `TEMPERATURE`.
    """
    stay, degc = ("visit", "stretch", "soak"), blocks[TEMPERATURE].to_numpy()
    place = pl.Series(np.where(blocks["soak"] >= 0, 0.0, np.floor(degc / bin_degc)))
    bins = blocks.select(*stay, place=place, block=pl.int_range(pl.len()))
    bins = bins.group_by(*stay, "place").agg("block").sort(*stay, "place")
    row, count = np.full(len(blocks), -1), 0
    for listed in bins.group_by(*stay, maintain_order=True).agg("block")["block"].to_list():
        parts = [np.array(one) for one in listed]
        while len(parts) > 1:
            # Without a neighbour on one side, that on the other side is the smaller one.
            sizes = [np.inf, *map(len, parts), np.inf]
            fragment = [k for k in (0, len(parts) - 1) if np.ptp(degc[parts[k]]) < _FRAGMENT * bin_degc]
            small = [k for k, part in enumerate(parts) if len(part) < FEWEST_BLOCKS or k in fragment]
            if not small:
                break
            k = min(small, key=lambda k: len(parts[k]))
            first = k - 1 if sizes[k] <= sizes[k + 2] else k
            parts[first : first + 2] = [np.concatenate(parts[first : first + 2])]
        for part in parts:
            if len(part) >= FEWEST_BLOCKS:
                row[part], count = count, count + 1
    return row


def _without_slope(blocks: pl.DataFrame, rows: pl.DataFrame) -> tuple[Floats, Floats]:
    """The readings of the blocks (blocks, 3), g, without the change with temperature within their row: that of a polynomial
    through the means of the attitude's rows, so that the noise within a row is not fitted; and its slope at each row (rows, 3),
    g/degC."""
    residual, readings = (frame.select(READINGS).to_numpy(order="c").copy() for frame in (blocks, rows))
    degc, warmth = blocks[TEMPERATURE].to_numpy(), rows[TEMPERATURE].to_numpy()
    attitude, slope = rows["position"].to_numpy(), np.zeros_like(readings)
    for one in np.unique(attitude):
        which = attitude == one
        inside, low, high = which[blocks["row"]], warmth[which].min(), warmth[which].max()
        middle, half = (low + high) / 2, max((high - low) / 2, 1e-12)
        order = min(_HIGHEST_ORDER, len(np.unique(np.floor(BINS * (warmth[which] - low) / (2 * half)))) // 2)
        at = (warmth[which] - middle) / half
        coefficients = np.linalg.lstsq(legendre.legvander(at, order), readings[which], rcond=1e-8)[0]
        coefficients[0] = 0.0
        of_block = np.clip((degc[inside] - middle) / half, -_CONTINUED, _CONTINUED)
        residual[inside] -= legendre.legval(of_block, coefficients).T
        slope[which] = legendre.legval(at, legendre.legder(coefficients) / half).T
    return residual, slope


def _uncertainty(series: ThermalSeries, rows: Sequence[Floats], within: np.ndarray) -> tuple[Floats, Floats]:
    """Standard deviations of the means, and numbers of independent samples.

    **Arguments:** `rows`: the blocks (blocks, 3) of each row. `within` (rows, 3): sums of their `SQUARES`.
    """
    blocks, quantum = np.array([len(one) for one in rows]), series.quantum
    # The noise within short rows does not determine that of means over long ones: rows of similar length have one model.
    similar = np.round(np.log(blocks) / np.log(_SIMILAR))
    sd, whole_s = np.zeros((len(rows), 3)), float(np.ptp(series.blocks["time_s"].to_numpy()))
    with single_blas_thread():
        for length in np.unique(similar):
            of_length = np.flatnonzero(similar == length).tolist()
            dwells = [rows[k] for k in of_length]
            sd[of_length] = sd_of_means(RecordedNoise.of(dwells, 1 / series.block_s, whole_s), dwells, None)
    freedom, samples = blocks[:, None] * (series.size - 1), blocks[:, None] * series.size
    usual = np.sqrt(np.sum(within, axis=0) / max(np.sum(freedom), 1))
    sd = np.hypot(sd, _rounding_sd(quantum, _before_rounding(quantum, usual)))
    sd = np.maximum(sd, np.maximum(quantum / np.sqrt(12 * samples), _LEAST_SD_G))
    return sd, np.clip(np.maximum(within / freedom, quantum**2 / 12) / sd**2, 1.0, samples)


def _rounding_sd(step: Floats, noise_sd: Floats) -> Floats:
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


def _before_rounding(step: Floats, sample_sd: Floats) -> Floats:
    """The noise of readings before rounding from their standard deviation s after it, by Sheppard's correction
    `s^2 - step^2 / 12`; 0 if rounding explains it."""
    return np.sqrt(np.maximum(sample_sd**2 - step**2 / 12, 0.0))
