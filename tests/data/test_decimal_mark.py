"""Decimal marks of spreadsheets: a comma in a table without commas between cells; separated thousands are refused."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tumblecal import InputError
from tumblecal.data import read_positions


HEADER = ("position", "alpha_deg", "beta_deg", "ax_g", "ay_g", "az_g")
READINGS = (("0.001", "0.002", "1.003"), ("0.001", "1.002", "-0.003"), ("-0.703", "0.001", "0.704"))


def written(path, *more, readings=READINGS, mark=",", separator=";"):
    """A table with readings in this mark, and more columns as they are: name and cells."""
    header = (*HEADER, *(name for name, *_ in more))
    rows = [
        (f"p{k}", "0", "45", *(cell.replace(".", mark) for cell in row), *(cells[k] for _, *cells in more))
        for k, row in enumerate(readings)
    ]
    path.write_text("\n".join(separator.join(row) for row in (header, *rows)) + "\n")
    return path


@pytest.mark.parametrize(
    ("mark", "times", "values"),
    [
        (",", ("0", "600", "1200"), [0, 600, 1200]),
        (",", ("1,200", "2,400", "3,6e1"), [1.2, 2.4, 36]),
        (".", ("1.200", "+2.4", "3.6e1"), [1.2, 2.4, 36]),
    ],
)
def test_one_mark_for_a_whole_file(tmp_path, mark, times, values):
    data = read_positions(written(tmp_path / "a.csv", ("time_s", *times), mark=mark))
    np.testing.assert_array_equal(data.time_s, values)
    np.testing.assert_array_equal(data.readings, np.array(READINGS, float))


@pytest.mark.parametrize(
    ("mark", "column", "words"),
    [
        (
            ",",
            ("time_s", "0", "1200", "2.400"),
            "line 4, column time_s: '2.400' has a point, but '0,001' (line 2, column ax_g)",
        ),
        (".", ("temperature_degc", "20", "20,5", "21"), "line 2, column ax_g: '0.001' has a point, but '20,5' (line 3"),
        (
            ",",
            ("time_s", "0", "1,200,000", "2,4"),
            "line 3, column time_s: '1,200,000' is not a number; use a decimal point, and",
        ),
    ],
)
def test_two_marks_are_refused_with_their_places(tmp_path, mark, column, words):
    with pytest.raises(InputError) as refused:
        read_positions(written(tmp_path / "a.csv", column, mark=mark))
    assert any(words in fault for fault in refused.value.faults), refused.value.faults


TENTHS = st.integers(-5_000_000, 50_000_000)


@given(
    times=st.lists(TENTHS, min_size=1, max_size=6),
    places=st.integers(0, 4),
    german=st.booleans(),
    grouped=st.booleans(),
)
@example(times=[12000, 0], places=0, german=True, grouped=True)
@example(times=[12000], places=3, german=True, grouped=False)
def test_a_spreadsheets_numbers_are_read_or_refused(tmp_path_factory, times, places, german, grouped):
    """However the times are shown, they are never read as others; only separated thousands are refused."""
    shown = [f"{time / 10**places:{',' if grouped else ''}.{places}f}" for time in times]
    values = [float(cell.replace(",", "")) for cell in shown]
    grouped = any("," in cell for cell in shown)
    shown = [cell.translate(str.maketrans(",.", ".,")) for cell in shown] if german else shown
    rows = [READINGS[k % 3] for k in range(len(times))]
    path = written(
        tmp_path_factory.mktemp("times") / "a.csv", ("time_s", *shown), readings=rows, mark="," if german else "."
    )
    if grouped:
        with pytest.raises(InputError, match="separate no thousands"):
            read_positions(path, check_size=False)
    else:
        np.testing.assert_array_equal(read_positions(path, check_size=False).time_s, values)
