"""Which column of a text recording is what, and the clock's forms: by names, by what stands beside, by values, or asked for."""

from datetime import datetime, timedelta

import numpy as np
import polars as pl
import pytest

from tumblecal.capture.columns.clock_text import form_of
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.rows.sample_file import write_samples
from tumblecal.ground.errors import InputError


ROWS = 60
RISING = [f"{10 + k / 100:.2f}" for k in range(ROWS)]
WARM = [f"{25 + k * 7 % 5 / 10:.1f}" for k in range(ROWS)]


def imported(path, columns, options: RecordingOptions = RecordingOptions()) -> tuple[pl.DataFrame, str]:
    """The samples of a log with these columns and three accelerations, and what was said."""
    columns |= {"ax": ["0.1"] * ROWS, "ay": ["0.2"] * ROWS, "az": ["0.97"] * ROWS}
    rows = [",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]
    path.write_text("\n".join(rows) + "\n")
    contents = write_samples(path, path.with_suffix(".parquet"), options)
    return pl.read_parquet(path.with_suffix(".parquet")), "\n".join(contents.layout.guesses)


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
        ([str(10 * k + k % 2) for k in range(ROWS)], "time"),
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


@pytest.mark.parametrize("cell", ["10:05", "n/a", "yesterday", "2026-03-29", "10:05:01:123"])
def test_times_that_cannot_be_read_are_refused_or_left_out_for_a_rate(tmp_path, cell):
    assert form_of([cell]) is None
    with pytest.raises(InputError, match=f"log.csv:line 2, column time: '{cell}' cannot be read as a time; write"):
        imported(tmp_path / "log.csv", {"time": [cell] * ROWS})
    frame, said = imported(tmp_path / "log.csv", {"time": [cell] * ROWS}, RecordingOptions(rate=100.0))
    assert "time_s" not in frame.columns and "ignored, --rate is used" in said


@pytest.mark.parametrize("units", ["g mg g", "mg g g", "g ms2 g"])
def test_axes_in_different_units_are_refused(tmp_path, units):
    """As `calibrate` refuses them; a user may say in which unit all of them are."""
    path = tmp_path / "log.csv"
    names = [f"a{axis}_{unit}" for axis, unit in zip("xyz", units.split(), strict=True)]
    path.write_text(
        "\n".join(["# a: b", ",".join(["time_s", *names]), *(f"{k / 100},0.1,0.2,0.97" for k in range(60))])
    )
    fault = rf"log.csv:line 2: {', '.join(names)} are in different units; give the three axes in one unit"
    for columns in ("", f"ax={names[0]},ay={names[1]},az={names[2]}"):
        with pytest.raises(InputError, match=fault):
            write_samples(path, tmp_path / "out.parquet", RecordingOptions(columns=columns))
    write_samples(path, tmp_path / "out.parquet", RecordingOptions(unit="g"))
    assert pl.read_parquet(tmp_path / "out.parquet")["az_g"][0] == 0.97


def test_a_column_twice_is_refused(tmp_path):
    """Not told by values what the names contradict; by numbers a user may say which counts."""
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time_s,ax_g,ax_g,az_g", *(f"{k / 100},0.1,0.2,0.97" for k in range(60))]))
    with pytest.raises(InputError, match=r"log.csv:line 1, column ax_g: this name occurs twice; remove one, or give"):
        write_samples(path, tmp_path / "out.parquet", RecordingOptions())
    write_samples(path, tmp_path / "out.parquet", RecordingOptions(columns="time=1,ax=2,ay=3,az=4"))
    assert pl.read_parquet(tmp_path / "out.parquet")["ay_g"][0] == 0.2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"columns": "ax=ax,ay=ax,az=az"}, "--columns ay=ax: column ax is ax already; name another column for each"),
        ({"columns": "ax=ax,ax=ay"}, "--columns ax=ax,ax=ay: ax is given twice; keep one"),
        ({"scale": "ax=0"}, "--scale ax=0: must be finite and other than 0"),
        ({"offset": "nan"}, "--offset nan: must be finite"),
    ],
)
def test_options_that_cannot_be_meant_are_refused(tmp_path, options, words):
    with pytest.raises(InputError, match=f"^{words}"):
        imported(tmp_path / "log.csv", {"t": RISING}, RecordingOptions(**options))
