"""Results of calibrate and diagnose are never mixed in one folder."""

from dataclasses import replace

import pytest

from tumblecal.data import write_positions


pytestmark = pytest.mark.usefixtures("few_effects")


DOCUMENTS = {"calibrate": "result.json", "diagnose": "diagnosis.json"}


@pytest.fixture
def twin(tmp_path, table1):
    """Other readings at the same positions, so that nothing else is compiled for them."""
    path = tmp_path / "twin.csv"
    write_positions(path, replace(table1, readings=table1.readings + 1e-4))
    return path


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("first", "second"), [("calibrate", "diagnose"), ("diagnose", "calibrate")])
def test_another_command_s_folder_is_refused_and_one_s_own_replaced(
    tumblecal, tmp_path, table1_file, twin, first, second
):
    out = tmp_path / "out"
    assert tumblecal(first, table1_file, "--no-figures", "--out", out).code == 0
    before = contents(out)
    outcome = tumblecal(second, table1_file, "--no-figures", "--out", out)
    assert outcome.code == 2 and outcome.lines == [
        f"tumblecal: {out}: has {DOCUMENTS[first]} of tumblecal {first}, and {second} would overwrite its calibration.json "
        "and summary.csv; give a different --out"
    ]
    assert contents(out) == before
    assert tumblecal(first, twin, "--no-figures", "--out", out).code == 0
    assert str(twin) in (out / DOCUMENTS[first]).read_text()
