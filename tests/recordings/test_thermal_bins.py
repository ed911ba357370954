"""Bins over temperature from arrays: smoothing, branches, soaks, sums in pieces, means with uncertainties, rounding."""

import numpy as np
import polars as pl
import pytest

from tumblecal.recordings.thermal.bins import binned, default_width
from tumblecal.recordings.thermal.series import SQUARES, ThermalSeries
from tumblecal.recordings.thermal.temperature import resolution_of
from tumblecal.recordings.thermal.thermal_table import INDEPENDENT, READINGS, ThermalTable


def _triangle(time_s: np.ndarray, low: float, high: float) -> np.ndarray:
    """Up to the middle of the time, and down."""
    share = time_s / time_s[-1]
    return low + (high - low) * (1 - np.abs(2 * share - 1))


def _table(
    time_s: np.ndarray,
    force: np.ndarray,
    degc: np.ndarray,
    size: int,
    sd: float,
    width: float = 0.0,
    resolution: float = 0.0,
) -> ThermalTable:
    """The bins of blocks at rest in one attitude."""
    blocks = pl.DataFrame(np.column_stack([force, np.full_like(force, (size - 1) * sd**2)]), [*READINGS, *SQUARES])
    blocks = blocks.with_columns(time_s=time_s, temperature_degc=degc, visit=0)
    known = {"block_s": float(time_s[1] - time_s[0]), "size": size, "quantum": np.zeros(3), "resolution": resolution}
    visits = pl.DataFrame({"position": ["a1"]})
    series = ThermalSeries.of(blocks, clock="f", source="f.csv", comments={}, visits=visits, **known)
    return binned(series, width or default_width(degc, [series]))[0]


def _bias(degc: np.ndarray) -> np.ndarray:
    x = degc / 40
    return np.stack([2e-3 * x + 3e-3 * x**2, -4e-3 * x**3, 1 + 6e-3 * x], axis=1)


@pytest.mark.parametrize("correlation_s", [0.0, 1.0])
def test_bin_means_are_covered_by_their_uncertainties(correlation_s: float):
    """White noise, and Gauss-Markov noise that is shorter than a bin: errors of all bins of six recordings."""
    rng = np.random.default_rng(4)
    block_s, size, sd = 0.5, 20, 1e-3
    time = block_s * np.arange(2400)
    degc = _triangle(time, -20, 60)
    ratios, tables = [], []
    for _ in range(6):
        noise = sd / np.sqrt(size) * rng.standard_normal((len(time), 3))
        if correlation_s:
            phi = np.exp(-block_s / correlation_s)
            driven = np.sqrt(1 - phi**2) * rng.standard_normal((len(time), 3))
            slow = np.zeros(3)
            for k, row in enumerate(driven):
                slow = phi * slow + row
                noise[k] += 3e-4 * slow
        table = _table(time, _bias(degc) + noise, degc, size, sd)
        tables.append(table)
        ratios.append((table.readings - _bias(table.temperature_degc)) / table.sd)
    # 80 degC in fortieths, up and down.
    table = tables[0]
    assert 78 <= len(table) <= 82
    assert set(table.branch) == {"f:1 up", "f:2 down"}
    scores = np.concatenate(ratios).ravel()
    assert 0.925 < np.mean(np.abs(scores) < 1.96) < 0.975
    assert 0.9 < np.std(scores) < 1.1
    independent = np.mean([np.median(one.frame.select(pl.col(INDEPENDENT) / pl.col("n"))) for one in tables])
    if correlation_s:
        assert independent < 0.5
    else:
        np.testing.assert_allclose(independent, 1.0, atol=0.2)


def test_soaks_of_a_staircase_and_their_uncertainties():
    """Soaks of ten minutes up and down, each reached exponentially; white noise of 1 mg a sample.

    Every row has 1 mg / sqrt(n): the uncertainties of long soaks are not extrapolated from short bins.
    """
    rng, step, levels = np.random.default_rng(8), np.arange(0, 600, 0.5), [15, 30, 45, 60, 45, 30, 15]
    degc = np.concatenate([a + (b - a) * np.exp(-step / 40) for a, b in zip(levels, [0, *levels[:-1]], strict=True)])
    time = 0.5 * np.arange(len(degc))
    noise = 1e-3 / np.sqrt(20) * rng.standard_normal((len(time), 3))
    read = np.round((degc + 0.02 * rng.standard_normal(len(time))) * 16) / 16
    table = _table(time, _bias(degc) + noise, read, 20, 1e-3, 1.5)
    soaks = table.rows(table.soak)
    np.testing.assert_allclose(soaks.temperature_degc, levels, atol=0.3)
    assert soaks.reached_by.tolist() == [1, 1, 1, 1, -1, -1, -1]
    assert soaks.branch == ("f:1 up",) * 4 + ("f:2 down",) * 3
    n = table.frame["n"].to_numpy()
    ratio = table.sd * np.sqrt(n)[:, None] / 1e-3
    assert n[table.soak].min() > 50 * n[~table.soak].min()
    assert ratio.min() > 0.9
    assert np.median(ratio[~table.soak]) < 1.2
    assert ratio[table.soak].max() < 1.5


def test_the_resolution_of_the_thermometer_is_part_of_the_uncertainty():
    # Soaks at temperatures that a thermometer with steps of 0.5 degC shows in error by up to 0.25 degC; a quiet sensor.
    rng = np.random.default_rng(10)
    step = np.arange(0, 400, 0.5)
    true = np.concatenate([level - 15 * np.exp(-step / 30) for level in (15.2, 30.1, 44.8, 60.05, 75.2, 90.15)])
    time = 0.5 * np.arange(len(true))
    read = np.round(true * 2) / 2
    force = _bias(true) + 1e-7 * rng.standard_normal((len(time), 3))
    table = _table(time, force, read, 10, 3e-7, 2.0, resolution_of(read))
    soaks = table.rows(table.soak)
    assert len(soaks) == 6
    errors = (soaks.readings - _bias(soaks.temperature_degc)) / soaks.sd
    # Uniform errors: at most sqrt(3) standard deviations; the slope of a quiet axis may be small.
    assert np.abs(errors[:, [0, 2]]).max() < 2.2
    assert np.abs(errors[:, 2]).max() > 0.5
