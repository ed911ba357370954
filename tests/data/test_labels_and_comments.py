"""Labels, comments and headers as people and spreadsheets write them."""

import math

import polars as pl
import pytest
from position_text import HEADER, ROWS, faults, written

from tumblecal import InputError
from tumblecal.capture.recordings import source_tables
from tumblecal.cli.model_options import StatedModel
from tumblecal.cli.options import ModelOptions
from tumblecal.data import read_positions
from tumblecal.data.raw import opened_raw, read_raw


def with_labels(path, name, *labels):
    return written(path, f"{HEADER},{name}", *(f"{row},{label}" for row, label in zip(ROWS, labels, strict=True)))


@pytest.mark.parametrize("name", ["run", "mount"])
@pytest.mark.parametrize(
    ("cells", "labels"),
    [
        (("1", " 1", "1 "), ("1", "1", "1")),
        (("A", " A ", "b"), ("A", "A", "b")),
        (("1", "1.0", "2.0"), ("1", "1", "2")),
        (("1.0", "2.0", "2.0"), ("1.0", "2.0", "2.0")),
        (("1", "1.0", "1.5"), ("1", "1.0", "1.5")),
        (("", " ", ""), None),
    ],
)
def test_labels_are_what_they_mean(tmp_path, name, cells, labels):
    assert getattr(read_positions(with_labels(tmp_path / "a.csv", name, *cells)), name) == labels


def test_labels_of_parquet(tmp_path):
    """Numbers without a fraction are written as whole ones, and what pandas leaves empty is empty."""
    table = pl.read_csv("\n".join([HEADER, *ROWS]).encode())
    for cells, labels in (([1.0, 1.0, 2.0], ("1", "1", "2")), ([math.nan, None, math.nan], None)):
        table.with_columns(run=pl.Series(cells, dtype=pl.Float64)).write_parquet(tmp_path / "a.parquet")
        assert read_positions(tmp_path / "a.parquet").run == labels


@pytest.mark.parametrize("name", ["run", "mount"])
def test_an_empty_label_is_refused(tmp_path, name):
    (fault,) = faults(with_labels(tmp_path / "a.csv", name, "1", " ", "1"))
    assert f"line 3, column {name}: the cell is empty; write the {name} in every row, or remove the whole" in fault


def test_positions_have_names(tmp_path):
    (fault,) = faults(written(tmp_path / "a.csv", HEADER, ROWS[0], ROWS[1][1:], ROWS[2]))
    assert "line 3, column position: the cell is empty; write the position in every row" in fault


PADDED = [  # as spreadsheets save a comment, and what it states
    ("# serial_number: U1;;;;;", {"serial_number": "U1"}),
    ("# serial_number: U1,,,,,", {"serial_number": "U1"}),
    ("# serial_number: U1\t\t", {"serial_number": "U1"}),
    ("# serial_number: U1; ; ,", {"serial_number": "U1"}),
    ("# serial_number:;U1;;;", {"serial_number": "U1"}),
    ('"# note: a, ""b"" c",,,,', {"note": 'a, "b" c'}),
    ('"# note: 1,5; 2";;;', {"note": "1,5; 2"}),
]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize(("comment", "stated"), PADDED, ids=[comment for comment, _ in PADDED])
def test_a_spreadsheets_padding_and_quotation_marks_are_no_part_of_a_comment(tmp_path, separator, comment, stated):
    """The three readers of text: position files, tables of readings, recordings of any layout."""
    lines = [line.replace(",", separator) for line in (HEADER, *ROWS * 3)]
    path = written(tmp_path / "a.csv", comment, "# attitudes: unknown" + 5 * separator, *lines)
    assert read_positions(path).comments == stated | {"attitudes": "unknown"}
    assert opened_raw(path)[0].comments == stated | {"attitudes": "unknown"}
    _, (table,) = source_tables(path)
    assert table.comments == stated | {"attitudes": "unknown"}


def test_the_lines_before_a_recording_s_header_may_be_padded(tmp_path):
    path = written(tmp_path / "a.csv", "Serial number;U1;;;", "t;x;y;z;", *["1;0;0;1;"] * 3)
    _, (table,) = source_tables(path)
    assert table.comments == {"serial_number": "U1"}


def test_contradictory_comments_are_refused(tmp_path):
    path = written(tmp_path / "a.csv", "# gravity_ms2: 9.80", HEADER, *ROWS, "# gravity_ms2: 9.83")
    assert faults(path) == (
        f"{path}:line 6: comment gravity_ms2: '9.83', but line 1 states '9.80'; keep the correct one",
    )
    path = written(
        tmp_path / "b.csv", "# gravity_ms2: 9.80", "# note: a", HEADER, *ROWS, "# gravity_ms2: 9.8", "# note: b"
    )
    assert read_positions(path).comments["gravity_ms2"] == "9.8"


def test_a_date_is_looked_at_before_anything_is_written(tumblecal, tmp_path):
    path = written(tmp_path / "a.csv", "# measured_utc: 31.03.2026", HEADER, *ROWS)
    outcome = tumblecal("calibrate", path, "--out", tmp_path / "out")
    assert outcome.code == 2 and not (tmp_path / "out").exists()
    assert outcome.lines == [
        f"tumblecal: {path}: comment measured_utc: '31.03.2026' is not a date; write 2026-03-31 or 2026-03-31T10:30:00Z"
    ]


@pytest.mark.parametrize("n", ["0", "-5", "0.5"])
def test_a_mean_is_of_samples(tmp_path, n):
    (fault,) = faults(with_labels(tmp_path / "a.csv", "n", "1", "100", n))
    assert "line 4, column n: a mean has at least one sample" in fault


def test_numpys_header_stands_behind_the_mark_of_a_comment(tmp_path):
    data = read_positions(written(tmp_path / "a.csv", "# serial_number: 9", f"# {HEADER}", "# by savetxt", *ROWS))
    assert data.names == ("a", "b", "c") and data.comments == {"serial_number": "9"}
    named = written(tmp_path / "b.csv", f"# {HEADER}", HEADER, *ROWS)
    assert len(read_positions(named)) == 3


def test_rows_without_a_header(tmp_path):
    (fault,) = faults(written(tmp_path / "a.csv", "# p,alpha,beta,x,y,z", *ROWS))
    assert "line 2: numbers instead of the names of the columns; write the names in the first line" in fault


@pytest.mark.parametrize("first", ["sep=;", '"sep=;"', "SEP=;", "sep=;;;;;;"])
def test_excels_first_line_says_the_separator(tmp_path, first):
    rows = [row.replace(",", ";").replace(".", ",") for row in ROWS]
    data = read_positions(written(tmp_path / "a.csv", first, HEADER.replace(",", ";"), *rows))
    assert data.names == ("a", "b", "c") and data.readings[2].tolist() == [-0.7, 0.001, 0.7]
    (fault,) = faults(written(tmp_path / "b.csv", "sep=:", HEADER.replace(",", ":"), *rows))
    assert "line 1: ':' as separator; write the columns with commas, semicolons, tabs or pipes" in fault


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_comment_with_commas_may_stand_in_quotation_marks(tmp_path, separator):
    """As Excel writes it."""
    quoted = [f'"# {words}"' + 5 * separator for words in ("note: a, b", 'serial_number: U""1')]
    rows = [row.replace(",", separator) for row in (HEADER, *ROWS)]
    data = read_positions(written(tmp_path / "a.csv", *quoted, *rows, f'"# end: a, b"{5 * separator}'))
    assert len(data) == 3 and data.comments["note"] == "a, b" and data.serial_number == 'U"1'
    raw = read_raw(written(tmp_path / "raw.csv", *quoted, *rows))
    assert raw.comments["note"] == "a, b" and raw.readings.tolist() == data.readings.tolist()
    assert raw.place(0, "ax_g").endswith("raw.csv:line 4, column ax_g")


def test_no_row_is_lost_as_a_comment(tmp_path):
    rows = [HEADER, ROWS[0], "#8" + ROWS[1][1:], "# aside, 1 g is 9.81", "# left out: " + ROWS[1], *ROWS[1:]]
    path = written(tmp_path / "a.csv", *rows)
    for read in (read_positions, read_raw):
        with pytest.raises(InputError) as refused:
            read(path)
        (fault,) = refused.value.faults
        assert "a.csv:line 3: begins with # like a comment" in fault and "write '8' without the #" in fault
    assert len(read_positions(written(path, *rows[:2], *rows[3:]))) == 3


def test_a_number_with_its_unit_says_what_to_write(tmp_path):
    warm = with_labels(tmp_path / "a.csv", "temperature_degc", "23.5C", "23 °C", "23.7")
    first, second = faults(warm)
    assert "line 2, column temperature_degc: '23.5C' is not a number; write 23.5, without the unit C" in first
    assert "line 3, column temperature_degc" in second and "write 23, without the unit °C" in second
    with pytest.raises(InputError, match=r"line 2, column temperature_degc: '23.5C' .* write 23.5, without the unit C"):
        read_raw(warm).numbers("temperature_degc")


def test_a_decimal_comma_of_gravity_is_told(tmp_path):
    (fault,) = faults(written(tmp_path / "a.csv", "# gravity_ms2: 9,8123", HEADER, *ROWS))
    assert "comment gravity_ms2: '9,8123' has a decimal comma; write 9.8123" in fault


def test_rows_of_parquet_are_called_rows(tmp_path):
    table = pl.read_csv("\n".join([HEADER, *ROWS]).encode()).with_columns(ay_g=pl.Series([0.1, None, 0.2]))
    table.write_parquet(tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"a.parquet:row 2, column ay_g: the cell is empty"):
        read_raw(tmp_path / "a.parquet")


@pytest.mark.parametrize(
    ("column", "cell", "words"),
    [
        ("alpha_deg", "45°30'10", "write degrees with decimals, such as 45.5 for 45°30'"),
        ("time_s", "10:05:00", "write a number, such as the seconds since the first position"),
        ("time_s", "01.05.2024", "write a number, such as the seconds"),
        ("time_s", "−0.5", "write -0.5"),
        ("time_s", "1'200", "write 1200"),
        ("time_s", "1\u202f200.5", "write 1200.5"),
        ("approach", "up", "write +1 or -1"),
        ("time_s", "north", "write one"),
        ("alpha_deg", "45:00:00", "write degrees with decimals, such as 45.5 for 45°30'"),
        ("beta_deg", "-45 30", "write degrees with decimals, such as 45.5 for 45°30'"),
        ("approach", "-", "write +1 or -1"),
        ("ax_g", "up", "write one"),
    ],
)
def test_what_people_write_for_numbers_is_told_how_to_be_written(tmp_path, column, cell, words):
    names = HEADER.replace(column, "run").split(",")
    path = written(tmp_path / "a.csv", ",".join([*names, column]), *(f"{row},{cell}" for row in ROWS))
    assert f"line 2, column {column}: {cell!r} is not a number; {words}" in faults(path)[0]


@pytest.mark.parametrize("cell", ["-", "--", "n/a", "NA"])
def test_a_missing_reading_is_called_so(tmp_path, cell):
    (fault,) = faults(written(tmp_path / "a.csv", HEADER, ROWS[0], f"b,90,0,0,1,{cell}", ROWS[2]))
    assert f"line 3, column az_g: {cell!r} is a missing reading; measure the position again or remove the row" in fault


def test_empty_columns_without_a_name_are_none(tmp_path):
    rows = [",".join([*row.split(",")[:3], "", *row.split(",")[3:], "", ""]) for row in (HEADER, *ROWS)]
    data = read_positions(written(tmp_path / "a.csv", *rows))
    assert len(data) == 3 and data.readings[2].tolist() == [-0.7, 0.001, 0.7]
    (fault,) = faults(written(tmp_path / "a.csv", *rows[:2], rows[2] + "0.3", rows[3]))
    assert "line 1, column (no name): unknown column" in fault


@pytest.mark.parametrize(
    ("above", "line"),
    [
        (["Measurement of unit 17"], 2),
        (["% by MATLAB"], 2),
        (["Measurement of unit 17,,,,,", ""], 3),
        (["position,angles,,readings,,"], 2),
    ],
)
def test_a_title_above_the_header_is_told_once(tmp_path, above, line):
    (fault,) = faults(written(tmp_path / "a.csv", *above, HEADER, *ROWS * 10))
    assert f"a.csv:line 1: '{above[0].rstrip(',')}' is not a header: line {line} names the columns" in fault
    assert fault.endswith("write # before line 1")
    assert len(read_positions(written(tmp_path / "a.csv", "# " + above[0], *above[1:], HEADER, *ROWS))) == 3


@pytest.mark.parametrize(
    ("row", "words"), [(HEADER, "the names of the columns again"), ("-,deg,deg,g,g,g", "a line of units, not a row")]
)
def test_a_line_of_names_or_units_is_told_once(tmp_path, row, words):
    (fault,) = faults(written(tmp_path / "a.csv", HEADER, ROWS[0], row, *ROWS[1:]))
    assert f"a.csv:line 3: {words}" in fault


def test_rows_of_empty_cells_are_blank_lines(tmp_path):
    assert (
        len(read_positions(written(tmp_path / "a.csv", ",,,,,", HEADER, ROWS[0], ",,,,,", " , ,,,,", *ROWS[1:]))) == 3
    )


@pytest.mark.parametrize("name", ["time_s", "temperature_degc", "approach", "n", "ax_sd_g,ay_sd_g,az_sd_g"])
def test_columns_that_are_empty_throughout_are_none(tmp_path, name):
    """Of sd columns all or none."""
    empty = "," * name.count(",")
    data = read_positions(with_labels(tmp_path / "a.csv", name, *[empty] * 3))
    assert data.temperature_degc is None and data.sd is None and data.n is None and data.approach is None
    (fault,) = faults(with_labels(tmp_path / "a.csv", "temperature_degc", "", "20", "20"))
    assert "line 2, column temperature_degc: the cell is empty" in fault
    (fault, *_) = faults(with_labels(tmp_path / "a.csv", "ax_sd_g,ay_sd_g,az_sd_g", *["1e-4,,1e-4"] * 3))
    assert "line 2, column ay_sd_g: the cell is empty" in fault


def test_a_cell_in_quotation_marks_may_go_over_lines(tmp_path):
    data = read_positions(written(tmp_path / "a.csv", HEADER, ROWS[0], '"b', 'of two",90,0,0.001,1.0,0.003', ROWS[2]))
    assert data.names == ("a", "b of two", "c")
    told = faults(written(tmp_path / "a.csv", HEADER, ROWS[0], '"b,90,0,0.001,1.0,0.003', "c,0,45,x,0.001,0.7"))
    assert told == (f"{tmp_path / 'a.csv'}:line 3: unexpected end of data; check the quotation marks",)


def test_temperatures_below_absolute_zero_are_none(tmp_path):
    (fault,) = faults(with_labels(tmp_path / "a.csv", "temperature_degc", "20", "-300", "20"))
    assert "line 3, column temperature_degc: -300 degC is below absolute zero; correct it or remove the row" in fault
    with pytest.raises(InputError, match="line 3, column temperature_degc: -300 degC is below absolute zero"):
        read_raw(tmp_path / "a.csv").temperature_degc()
    assert read_raw(with_labels(tmp_path / "a.csv", "temperature_degc", "", "", "")).temperature_degc() is None


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(
    ("name", "meant"),
    [
        *(("operator", ""), ("note", ""), ("humidity", ""), ("ax_raw", ""), ("gx_dps", "")),
        *(("temprature_degc", "temperature_degc"), ("Temperature_degC", "temperature_degc"), ("aproach", "approach")),
        *(("time", "time_s"), ("runs", "run")),
    ],
)
def test_a_column_that_is_not_needed_is_ignored_and_a_near_miss_is_warned_of(tumblecal, tmp_path, name, meant, own):
    """With --columns for the angles too; in Parquet the same. -v says what else is ignored."""
    options = ["--columns", "alpha_deg=angle"] if own else []
    header = HEADER.replace("alpha_deg", "angle") if own else HEADER
    path = written(tmp_path / "a.csv", f"{header},{name}", *(f"{row},x" for row in ROWS))
    model = StatedModel.of(ModelOptions(columns=options[1] if own else None))
    data = read_positions(path, names=model.columns)
    assert data.ignored == (name,) and len(data) == 3
    pl.read_csv(path).write_parquet(tmp_path / "a.parquet")
    assert read_positions(tmp_path / "a.parquet", names=model.columns).ignored == (name,)
    out = tmp_path / "out"
    said = [
        line for line in tumblecal("calibrate", path, *options, "--out", out, "-q").lines if f"column {name} " in line
    ]
    cure = f"did you mean {meant}? Rename it, or give --columns {meant}={name}"
    assert said == ([f"WARNING: {path}: column {name} is not used; {cure}"] if meant else [])


def test_an_ignored_column_is_said_with_v(tumblecal, tmp_path, caplog):
    path = written(tmp_path / "a.csv", f"{HEADER},operator", *(f"{row},Ann" for row in ROWS))
    with caplog.at_level("INFO", logger="tumblecal"):
        StatedModel().read(path)
    assert [record.message for record in caplog.records if record.levelname == "INFO"] == [
        f"{path}: column operator is not used"
    ]
