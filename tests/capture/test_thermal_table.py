"""The table of readings over temperature: from arrays, its rows, several tables as one, and its faults."""

import numpy as np
import pytest

from tumblecal.capture.thermal.thermal_table import joined, table_of
from tumblecal.ground.errors import InputError


def _table(count: int = 4, **more):
    readings = np.column_stack([np.zeros(count), np.zeros(count), 1 + 1e-3 * np.arange(count)])
    return table_of(["up"] * count, readings, 1e-4, np.linspace(0, 30, count), **more)


def test_single_numbers_are_valid_for_all_rows():
    table = _table(direction=1, rate_degc_per_s=0.1, n=50)
    assert len(table) == 4
    assert table.sd.shape == table.n_eff.shape == (4, 3)
    np.testing.assert_array_equal(table.n_eff, 50)
    np.testing.assert_array_equal(table.reached_by, 1)
    assert not table.soak.any()
    assert set(table.columns()) >= {"position", "run", "branch", "temperature_degc", "ax_g", "az_sd_g"}


def test_rows_and_joined_tables():
    table = _table(direction=[1, 1, 0, -1], alpha_deg=0.0, beta_deg=90.0)
    part = table.rows(table.soak)
    assert part.attitude == ("up",)
    np.testing.assert_array_equal(part.temperature_degc, [20.0])
    both = joined([table, _table(2)], "two")
    assert len(both) == 6
    assert both.alpha_deg is None
    assert both.range_degc == (0.0, 30.0)


@pytest.mark.parametrize(
    ("more", "fault"),
    [
        ({"time_s": [0.0, 1.0]}, "time_s has the shape"),
        ({"time_s": [0.0, 1.0, np.nan, 3.0]}, "time_s has numbers that are not finite"),
        ({"branch": ["a"]}, "branch has 1 labels"),
    ],
)
def test_faults_name_the_column(more: dict, fault: str):
    with pytest.raises(InputError, match=fault):
        _table(**more)


def test_sd_of_zero_is_rejected():
    with pytest.raises(InputError, match="sd must be above 0"):
        table_of(["up"], [[0.0, 0.0, 1.0]], 0.0, [20.0])
