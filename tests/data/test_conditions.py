"""Temperatures and times that are not in the unit of their column are refused with the row, and no good ones are."""

import numpy as np
import pytest
from position_text import faults, written


def file_with(path, column, values):
    """Positions by 45 degrees of the spindle, with one column more."""
    rows = [
        f"p{k},{45 * k % 360},0,0,{np.sin(np.pi / 4 * k):.5f},{np.cos(np.pi / 4 * k):.5f},{value!r}"
        for k, value in enumerate(np.asarray(values, float).tolist())
    ]
    return written(path / "positions.csv", f"position,alpha_deg,beta_deg,ax_g,ay_g,az_g,{column}", *rows)


STEPS = np.arange(24.0)


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
