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
        ({"temperature_degc": WARM, "t": RISING}, ""),
        ({"t": RISING, "T": WARM}, ""),
        ({"T": RISING, "Temperature [°C]": WARM}, ""),
        ({"t": RISING, "temp": WARM}, "time=t"),
        ({"t": WARM, "time": RISING}, ""),
        ({"t": WARM, "u": RISING}, "time=u"),
        ({"Time (s)": RISING, "Temp (C)": WARM}, ""),
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


@pytest.mark.parametrize(
    "values", [[f"{23 + k * 2e-5:.5f}" for k in range(ROWS)], [f"{k * k % 977}" for k in range(ROWS)]]
)
def test_t_is_asked_for_where_its_values_tell_nothing(tmp_path, values):
    with pytest.raises(InputError, match=r"column t may be the time or the temperature.*--columns time=t or temp"):
        imported(tmp_path / "log.csv", {"t": values})
    frame, _ = imported(tmp_path / "log.csv", {"t": values}, RecordingOptions(columns="temperature=t"))
    np.testing.assert_array_equal(frame["temperature_degc"], [float(cell) for cell in values])


def test_a_temperature_in_another_unit_is_not_taken_for_degrees_celsius(tmp_path):
    frame, _ = imported(tmp_path / "log.csv", {"temp(F)": WARM, "time": RISING})
    assert "temperature_degc" not in frame.columns


BEGIN = datetime(2026, 3, 29, 23, 59, 59, 700000)


@pytest.mark.parametrize(
    "form",
    [
        *("%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%fZ", "%Y-%m-%dT%H:%M:%S.%f+02:00", "%Y/%m/%d %H:%M:%S.%f"),
        *("%d.%m.%Y %H:%M:%S.%f", "%d.%m.%y %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S.%f"),
        *("%m/%d/%Y %I:%M:%S.%f %p", "%m/%d/%y %H:%M:%S.%f"),
    ],
)
def test_clocks_are_read_over_midnight(tmp_path, form):
    times = [(BEGIN + timedelta(milliseconds=10 * k)).strftime(form) for k in range(ROWS)]
    frame, _ = imported(tmp_path / "log.csv", {"timestamp": times})
    np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / 100, atol=1e-9)


@pytest.mark.parametrize("form", ["%H:%M:%S.%f", "%I:%M:%S.%f %p", "%m/%d/%Y %H:%M:%S.%f", "%d/%m/%Y %I:%M:%S.%f PM"])
def test_the_time_of_day_alone_is_enough(tmp_path, form):
    """Of 04/05 nobody knows day and month; within the day that changes nothing."""
    times = [
        (datetime(2026, 4, 5, 12, 59, 59, 700000) + timedelta(milliseconds=10 * k)).strftime(form) for k in range(ROWS)
    ]
    frame, _ = imported(tmp_path / "log.csv", {"timestamp": times})
    np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / 100, atol=1e-9)


def test_a_clock_set_to_summer_time_goes_on(tmp_path):
    times = [
        f"2026-03-29T{1 if k < 30 else 3}:{59 if k < 30 else 0:02d}:{(5970 + k) % 6000 / 100:05.2f}"
        for k in range(ROWS)
    ]
    times = [time + ("+01:00" if k < 30 else "+02:00") for k, time in enumerate(times)]
    frame, _ = imported(tmp_path / "log.csv", {"timestamp": times})
    np.testing.assert_allclose(frame["time_s"], np.arange(ROWS) / 100, atol=1e-9)


@pytest.mark.parametrize("cell", ["10:05", "n/a", "yesterday", "2026-03-29", "10:05:01:123"])
def test_times_that_cannot_be_read_are_refused_or_left_out_for_a_rate(tmp_path, cell):
    assert form_of([cell]) is None
    with pytest.raises(InputError, match=f"log.csv:line 2, column time: '{cell}' cannot be read as a time; write"):
        imported(tmp_path / "log.csv", {"time": [cell] * ROWS})
    frame, said = imported(tmp_path / "log.csv", {"time": [cell] * ROWS}, RecordingOptions(rate=100.0))
    assert "time_s" not in frame.columns and "ignored, --rate is used" in said


def test_a_named_column_that_cannot_be_read_is_told(tmp_path):
    frame, said = imported(tmp_path / "log.csv", {"temperature_degc": ["23.5C"] * ROWS, "time": RISING})
    assert "temperature_degc" not in frame.columns
    assert "line 2, column temperature_degc: '23.5C': no number; ignored as temperature" in said


def test_accelerations_that_cannot_be_read_are_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,ax,ay,az,temp\n" + "".join(f"{k / 100},0.1,0.2,0.97g,25\n" for k in range(ROWS)))
    with pytest.raises(
        InputError, match=r"log.csv:line 2, column az: '0.97g': no number; write 0.97, without the unit g, or"
    ):
        write_samples(path, tmp_path / "out.parquet", RecordingOptions())


def test_a_column_asked_for_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"log.csv:line 2, column warmth: 'cold': no number"):
        imported(tmp_path / "log.csv", {"warmth": ["cold"] * ROWS}, RecordingOptions(columns="temperature=warmth"))


def test_moments_of_other_formats_are_times_and_dates_alone_are_none(tmp_path):
    times = pl.datetime_range(BEGIN, BEGIN + timedelta(milliseconds=10 * (ROWS - 1)), "10ms", eager=True)
    path, force = tmp_path / "log.parquet", {"ax": [0.1] * ROWS, "ay": [0.2] * ROWS, "az": [0.97] * ROWS}
    for own in (times, times.dt.time().head(20), times - BEGIN):
        rows = {name: values[: len(own)] for name, values in force.items()}
        pl.DataFrame({"time": own, **rows}).write_parquet(path)
        write_samples(path, tmp_path / "out.parquet", RecordingOptions())
        found = pl.read_parquet(tmp_path / "out.parquet")["time_s"]
        np.testing.assert_allclose(found, np.arange(len(own)) / 100, atol=1e-9)
    pl.DataFrame({"time": times.dt.date(), **force}).write_parquet(path)
    with pytest.raises(InputError, match=r"column time: datetime.date.* cannot be read as a time"):
        write_samples(path, tmp_path / "out.parquet", RecordingOptions())


def test_no_row_with_all_three_accelerations_is_a_line(tmp_path):
    rows = "".join(f"{k / 100},{'0.1,0.2,x' if k % 2 else '0.1,y,0.97'},25\n" for k in range(ROWS))
    (tmp_path / "log.csv").write_text("time,ax,ay,az,temp\n" + rows)
    with pytest.raises(InputError, match=r"log.csv: no row has a number in each of ax, ay, az"):
        write_samples(tmp_path / "log.csv", tmp_path / "out.parquet", RecordingOptions())


def test_a_quoted_date_between_spaces_is_one_cell(tmp_path):
    times = [(BEGIN + timedelta(milliseconds=10 * k)).isoformat(" ", "microseconds") for k in range(ROWS)]
    rows = "".join(f'"{time}"  0.1  0.2  0.97\n' for time in times)
    (tmp_path / "log.txt").write_text("time ax ay az\n" + rows)
    write_samples(tmp_path / "log.txt", tmp_path / "out.parquet", RecordingOptions())
    found = pl.read_parquet(tmp_path / "out.parquet")
    np.testing.assert_allclose(found["time_s"], np.arange(ROWS) / 100, atol=1e-9)
    assert set(found["az_g"]) == {0.97}


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


def test_rates_in_different_units_are_refused(tmp_path):
    rates = {f"gyr_{axis} [{unit}]": ["0.1"] * ROWS for axis, unit in zip("xyz", ("dps", "dps", "rad/s"), strict=True)}
    with pytest.raises(InputError, match=r"line 1: gyr_x \[dps\].* are in different units"):
        imported(tmp_path / "log.csv", {"time": RISING} | rates)


def test_the_unit_that_some_axes_state_is_that_of_all(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time_s,ax,ay_mg,az", *(f"{k / 100},100,200,970" for k in range(60))]))
    write_samples(path, tmp_path / "out.parquet", RecordingOptions())
    assert pl.read_parquet(tmp_path / "out.parquet").columns[1:] == ["ax_mg", "ay_mg", "az_mg"]


def test_a_column_twice_is_refused(tmp_path):
    """Not told by values what the names contradict; by numbers a user may say which counts."""
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time_s,ax_g,ax_g,az_g", *(f"{k / 100},0.1,0.2,0.97" for k in range(60))]))
    with pytest.raises(InputError, match=r"log.csv:line 1, column ax_g: this name occurs twice; remove one, or give"):
        write_samples(path, tmp_path / "out.parquet", RecordingOptions())
    write_samples(path, tmp_path / "out.parquet", RecordingOptions(columns="time=1,ax=2,ay=3,az=4"))
    assert pl.read_parquet(tmp_path / "out.parquet")["ay_g"][0] == 0.2


def test_columns_without_a_name_do_not_hide_the_others(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time_s,ax_g,,ay_g,,az_g", *(f"{k / 100},0.1,7,0.2,8,0.97" for k in range(60))]))
    write_samples(path, tmp_path / "out.parquet", RecordingOptions())
    assert pl.read_parquet(tmp_path / "out.parquet").columns == ["time_s", "ax_g", "ay_g", "az_g"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"columns": "ax=ax,ay=ax,az=az"}, "--columns ay=ax: column ax is ax already; name another column for each"),
        ({"columns": "ax=2,ay=2,az=4"}, "--columns ay=2: column ax is ax already"),
        ({"columns": "time=t,temperature=t"}, "--columns temperature=t: column t is time already"),
        ({"columns": "ax=ax,ax_g=ay"}, "--columns ax_g=ay: column ax is ax already"),
        ({"columns": "ax=ax,ax=ay"}, "--columns ax=ax,ax=ay: ax is given twice; keep one"),
        *(
            ({"scale": text}, f"--scale {text}: must be finite and other than 0")
            for text in ("0", "nan", "inf", "ax=0")
        ),
        ({"offset": "nan"}, "--offset nan: must be finite"),
    ],
)
def test_options_that_cannot_be_meant_are_refused(tmp_path, options, words):
    with pytest.raises(InputError, match=f"^{words}"):
        imported(tmp_path / "log.csv", {"t": RISING}, RecordingOptions(**options))


def test_angles_in_minutes_are_refused(tmp_path):
    cells = ["45:30"] * ROWS
    with pytest.raises(InputError, match=r"line 2, column alpha_deg: '45:30': no number; write degrees with decimals"):
        imported(tmp_path / "log.csv", {"alpha_deg": cells, "beta_deg": ["0"] * ROWS})
    with pytest.raises(
        InputError, match=r"59 of 60 rows cannot be read as .*; the first for column alpha_deg, '45:30'"
    ):
        imported(tmp_path / "log.csv", {"alpha_deg": ["45", *cells[1:]], "beta_deg": ["0"] * ROWS})


def test_angles_are_told_by_their_unit(tmp_path):
    """Not without one: phones write their attitude as alpha and beta."""
    frame, _ = imported(tmp_path / "log.csv", {"alpha [deg]": RISING, "beta (°)": WARM, "alpha": WARM})
    assert {"alpha_deg", "beta_deg"} < set(frame.columns)
    np.testing.assert_array_equal(frame["alpha_deg"], [float(cell) for cell in RISING])
    frame, _ = imported(tmp_path / "log.csv", {"alpha": RISING, "beta": WARM})
    assert not {"alpha_deg", "beta_deg"} & set(frame.columns)


@pytest.mark.parametrize("warmth", [["", ""], ["", "25.5"], ["25.5", ""]])
def test_a_last_column_that_is_empty_has_its_name_all_the_same(tmp_path, warmth):
    path = tmp_path / "log.csv"
    rows = [f"{k / 100},0.1,0.2,0.97,{warmth[k % 2]}" for k in range(60)]
    path.write_text("\n".join(["time_s,ax_g,ay_g,az_g,temperature_degc", *rows[:30], ",,,,", *rows[30:]]))
    contents = write_samples(path, tmp_path / "out.parquet", RecordingOptions())
    frame = pl.read_parquet(tmp_path / "out.parquet")
    assert len(frame) == 60 and not contents.unreadable and frame["az_g"].to_list() == [0.97] * 60
    told = frame["temperature_degc"].drop_nulls().to_list() if "temperature_degc" in frame.columns else []
    assert told == [25.5] * (30 if any(warmth) else 0)
