"""Which column of a text recording is what, and the clock's forms: by names, by what stands beside, by values, or asked for."""

from datetime import datetime, timedelta

import numpy as np
import polars as pl
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording as write_samples


ROWS = 60
RISING = [f"{10 + k / 100:.2f}" for k in range(ROWS)]
WARM = [f"{25 + k * 7 % 5 / 10:.1f}" for k in range(ROWS)]


def imported(path, columns, options: RecordingOptions = RecordingOptions()) -> tuple[pl.DataFrame, str]:
    """The samples of a log with these columns and three accelerations, and what was said."""
    columns |= {"ax": ["0.1"] * ROWS, "ay": ["0.2"] * ROWS, "az": ["0.97"] * ROWS}
    rows = [",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]
    path.write_text("\n".join(rows) + "\n")
    contents = write_samples(path, path.with_suffix(".parquet"), options)
    return pl.read_parquet(path.with_suffix(".parquet")), "\n".join(contents.layout.notes)


@pytest.mark.parametrize(
    ("columns", "options"),
    [
        ({"t": RISING, "temp": WARM}, ""),
        ({"t": RISING, "T": WARM}, ""),
        ({"T": RISING, "Temperature [°C]": WARM}, ""),
        ({"t": WARM, "u": RISING}, "time=u"),
        ({"Zeit [s]": RISING, "Temperatur [°C]": WARM}, ""),
    ],
)
def test_t_is_the_time_beside_a_temperature_and_the_other_way_round(tmp_path, columns, options):
    frame, _ = imported(tmp_path / "log.csv", dict(columns), RecordingOptions(columns=options))
    np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / 100, atol=1e-9)
    np.testing.assert_array_equal(frame["temperature_degc"], [float(cell) for cell in WARM])


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        (RISING, "time"),
        (WARM, "temperature"),
        (["23.5"] * ROWS, "temperature"),
    ],
)
def test_t_alone_is_told_by_its_values(tmp_path, values, kind):
    frame, said = imported(tmp_path / "log.csv", {"t": values})
    other = {"time": "temperature_degc", "temperature": "time_s"}[kind]
    assert other not in frame.columns and f"column t is the {kind}, by its values" in said


BEGIN = datetime(2026, 3, 29, 23, 59, 59, 700000)


@pytest.mark.parametrize(
    "form",
    [
        *("%Y-%m-%dT%H:%M:%S.%f+02:00", "%Y/%m/%d %H:%M:%S.%f", "%d.%m.%y %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S.%f"),
        *("%m/%d/%Y %I:%M:%S.%f %p", "%H:%M:%S.%f", "%I:%M:%S.%f %p"),
    ],
)
def test_clocks_are_read_over_midnight(tmp_path, form):
    """Without a date, over noon."""
    begin = BEGIN if "d" in form else datetime(2026, 4, 5, 12, 59, 59, 700000)
    times = [(begin + timedelta(milliseconds=10 * k)).strftime(form) for k in range(ROWS)]
    frame, _ = imported(tmp_path / "log.csv", {"timestamp": times})
    np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / 100, atol=1e-9)


def test_no_row_with_all_three_accelerations_is_a_line(tmp_path):
    rows = "".join(f"{k / 100},{'0.1,0.2,x' if k % 2 else '0.1,y,0.97'},25\n" for k in range(ROWS))
    (tmp_path / "log.csv").write_text("time,ax,ay,az,temp\n" + rows)
    with pytest.raises(InputError, match=r"log.csv: no row has a number in each of ax, ay, az"):
        write_samples(tmp_path / "log.csv", tmp_path / "out.parquet", RecordingOptions())
