"""Temperatures and times that are not in the unit of their column are refused with the row, and no good ones are."""

import numpy as np
import pytest
from position_text import faults, written

from tumblecal.data import read_positions


def file_with(path, column, values):
    """Positions by 45 degrees of the spindle, with one column more."""
    rows = [
        f"p{k},{45 * k % 360},0,0,{np.sin(np.pi / 4 * k):.5f},{np.cos(np.pi / 4 * k):.5f},{value!r}"
        for k, value in enumerate(np.asarray(values, float).tolist())
    ]
    return written(path / "positions.csv", f"position,alpha_deg,beta_deg,ax_g,ay_g,az_g,{column}", *rows)


STEPS = np.arange(24.0)
COUNTS = 2231.0 + 3 * STEPS


def test_raw_counts_are_no_temperatures(tmp_path):
    (told,) = faults(file_with(tmp_path, "temperature_degc", COUNTS))
    assert ":line 2, column temperature_degc: 2231 degC is not a possible temperature of a triad" in told
    assert "raw counts or a different unit, write degC" in told and told.endswith("(also in lines 3, 4 and 21 more)")
    one = np.where(STEPS == 4, 999.0, 23.0)
    (told,) = faults(file_with(tmp_path, "temperature_degc", one))
    assert ":line 6, column temperature_degc: 999 degC is not" in told


@pytest.mark.parametrize("usual", [-60 + STEPS, 150 + 3 * STEPS, 273.15 + 3 * STEPS, 0 * STEPS])
def test_temperatures_of_ovens_and_kelvin_are_read(tmp_path, usual):
    np.testing.assert_array_equal(
        read_positions(file_with(tmp_path, "temperature_degc", usual)).temperature_degc, usual
    )


@pytest.mark.parametrize(
    ("times", "told"),
    [
        (45000 + STEPS * 120 / 86400, "these look like days, as a spreadsheet counts dates; write seconds"),
        (0.4 + STEPS * 120 / 86400, "a head cannot be set in 0.0014 s, so these look like hours or days"),
        (STEPS * 120 / 3600, "a head cannot be set in 0.033 s, so these look like hours or days; write seconds"),
        (1.7e12 + 120e3 * STEPS, "1.7e+12 s, and so on: these look like milliseconds since 1970; write seconds"),
    ],
)
def test_times_in_another_unit_are_told(tmp_path, times, told):
    """A drift came out as 5.93e+03 mg/h."""
    (fault,) = faults(file_with(tmp_path, "time_s", times))
    assert ":line 2, column time_s: " in fault and told in fault


@pytest.mark.parametrize(
    "times", [0.5 * STEPS, 1.7e9 + 0.5 * STEPS, 86400 * STEPS, 0 * STEPS, 0.5 * (STEPS % 6), 0.5 * STEPS[::-1]]
)
def test_seconds_are_read(tmp_path, times):
    np.testing.assert_array_equal(read_positions(file_with(tmp_path, "time_s", times)).time_s, times)
