"""A file that is given twice, and copies of it."""

import pytest

from other_names import NAMES
from tumblecal.data import write_positions


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.mark.parametrize(
    ("command", "link"),
    [*zip(("calibrate", "diagnose", "diagnose --units", "diagnose --join"), NAMES.values(), strict=True)],
)
def test_a_file_given_twice_is_refused(tumblecal, tmp_path, table1, table1_file, command, link):
    write_positions(tmp_path / "third.csv", table1.chosen(range(20)))
    again = link(table1_file, tmp_path / "again.csv")
    name, *options = command.split()
    outcome = tumblecal(name, table1_file, tmp_path / "third.csv", again, *options, "--out", tmp_path / "out")
    assert outcome.code == 2 and len(outcome.lines) == 1
    assert outcome.lines[0].startswith("tumblecal: ") and ": given twice" in outcome.lines[0]
    assert ("the first time as" in outcome.lines[0]) == (again is not table1_file)
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_a_copy_under_another_name_is_told(tumblecal, tmp_path, table1, table1_file):
    copy, other = tmp_path / "copy.csv", tmp_path / "other.csv"
    copy.write_bytes(table1_file.read_bytes())
    write_positions(other, table1.chosen(range(20)))
    outcome = tumblecal("calibrate", table1_file, other, copy, "-q", "--out", tmp_path / "out")
    assert outcome.code == 0
    assert outcome.lines == [
        f"WARNING: {copy}: same contents as {table1_file}, so these positions are used twice; remove one of these files"
    ]
