"""Labels, comments and headers as people and spreadsheets write them."""

import polars as pl
import pytest
from position_text import HEADER, ROWS, faults, written

from tumblecal import InputError
from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.read_model import read_model
from tumblecal.data import read_positions
from tumblecal.data.files import stated
from tumblecal.data.raw import opened_raw, read_raw
from tumblecal.recordings.damage import Damage
from tumblecal.recordings.formats import tables_of
from tumblecal.recordings.options import RecordingOptions


def with_labels(path, name, *labels):
    return written(path, f"{HEADER},{name}", *(f"{row},{label}" for row, label in zip(ROWS, labels, strict=True)))


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
def test_labels_are_what_they_mean(tmp_path, cells, labels):
    assert read_positions(with_labels(tmp_path / "a.csv", "run", *cells)).run == labels


PADDED = [  # as spreadsheets save a comment, and what it states
    ("# serial_number: U1;;;;;", {"serial_number": "U1"}),
    ("# serial_number: U1; ; ,", {"serial_number": "U1"}),
    ("# serial_number:;U1;;;", {"serial_number": "U1"}),
    ('"# note: a, ""b"" c",,,,', {"note": 'a, "b" c'}),
    ('"# note: 1,5; 2";;;', {"note": "1,5; 2"}),
]


@pytest.mark.parametrize("separator", [",", ";"])
@pytest.mark.parametrize(("comment", "stated"), PADDED, ids=[comment for comment, _ in PADDED])
def test_a_spreadsheets_padding_and_quotation_marks_are_no_part_of_a_comment(tmp_path, separator, comment, stated):
    """The three readers of text: position files, tables of readings, recordings of any layout."""
    lines = [line.replace(",", separator) for line in (HEADER, *ROWS * 3)]
    path = written(tmp_path / "a.csv", comment, "# attitudes: unknown" + 5 * separator, *lines)
    assert read_positions(path).comments == stated | {"attitudes": "unknown"}
    assert opened_raw(path)[0].comments == stated | {"attitudes": "unknown"}
    _, (table,) = tables_of(path, RecordingOptions(), Damage())
    assert table.stated == stated | {"attitudes": "unknown"}


def test_contradictory_comments_are_refused(tmp_path):
    path = written(tmp_path / "a.csv", "# gravity_ms2: 9.80", HEADER, *ROWS, "# gravity_ms2: 9.83")
    assert faults(path) == (
        f"{path}:line 6: comment gravity_ms2: '9.83', but line 1 states '9.80'; keep the correct one",
    )
    path = written(
        tmp_path / "b.csv", "# gravity_ms2: 9.80", "# note: a", HEADER, *ROWS, "# gravity_ms2: 9.8", "# note: b"
    )
    assert read_positions(path).comments["gravity_ms2"] == "9.8"


def test_no_row_is_lost_as_a_comment(tmp_path):
    rows = [HEADER, ROWS[0], "#8" + ROWS[1][1:], "# aside, 1 g is 9.81", "# left out: " + ROWS[1], *ROWS[1:]]
    path = written(tmp_path / "a.csv", *rows)
    for read in (read_positions, read_raw):
        with pytest.raises(InputError) as refused:
            read(path)
        (fault,) = refused.value.faults
        assert "a.csv:line 3: begins with # like a comment" in fault and "write '8' without the #" in fault
    assert len(read_positions(written(path, *rows[:2], *rows[3:]))) == 3


def test_a_cell_in_quotation_marks_may_go_over_lines(tmp_path):
    data = read_positions(written(tmp_path / "a.csv", HEADER, ROWS[0], '"b', 'of two",90,0,0.001,1.0,0.003', ROWS[2]))
    assert data.names == ("a", "b of two", "c")
    told = faults(written(tmp_path / "a.csv", HEADER, ROWS[0], '"b,90,0,0.001,1.0,0.003', "c,0,45,x,0.001,0.7"))
    assert told == (f"{tmp_path / 'a.csv'}:line 3: quotation marks within a cell; check the quotation marks",)


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(
    ("name", "meant"),
    [*(("operator", ""), ("gx_dps", ""), ("temprature_degc", "temperature_degc"), ("time", "time_s"))],
)
def test_a_column_that_is_not_needed_is_ignored_and_a_near_miss_is_warned_of(tumblecal, tmp_path, name, meant, own):
    """With --columns for the angles too; in Parquet the same. -v says what else is ignored."""
    options = ["--columns", "alpha_deg=angle"] if own else []
    header = HEADER.replace("alpha_deg", "angle") if own else HEADER
    path = written(tmp_path / "a.csv", f"{header},{name}", *(f"{row},x" for row in ROWS))
    model = read_model(ModelOptions(columns=options[1] if own else None))
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


def test_a_comment_states_a_value_by_one_word_and_a_colon():
    lines = ["# serial_number: U17", "# seen by: Ann", "# a note", '"# temperature: 20 degC"']
    assert stated(lines) == {"serial_number": "U17", "temperature": "20 degC"}
