"""Results of calibrate and diagnose are never mixed in one folder."""

from dataclasses import replace

import pytest

from tumblecal.data import write_positions


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


def test_summaries_and_subfolders_of_several_files_too(tumblecal, tmp_path, table1_file, twin):
    out = tmp_path / "out"
    assert tumblecal("calibrate", table1_file, twin, "--out", out).code == 0
    before = contents(out)
    for files in ([table1_file, twin], [twin, table1_file], [tmp_path / "others.csv", tmp_path / "more.csv"]):
        for path in files:
            path.exists() or path.write_bytes(table1_file.read_bytes() + b"\n" * len(path.name))
        outcome = tumblecal("diagnose", *files, "--out", out)
        assert (
            outcome.code == 2
            and len(outcome.lines) == 1
            and "of tumblecal calibrate, and diagnose would overwrite" in outcome.lines[0]
        )
        assert contents(out) == before
    assert "summary.csv of tumblecal calibrate" in outcome.lines[0]
    assert tumblecal("calibrate", table1_file, twin, "--out", out).code == 0
    assert tumblecal("diagnose", table1_file, "--no-figures", "--out", out / "diagnosis").code == 0


def test_plans_and_figures_of_a_diagnosis_are_of_its_set():
    """So a later diagnosis without them removes them; they are named in other modules."""
    from pathlib import PurePath

    from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET
    from tumblecal.report.diagnosis_page import CAPTIONS
    from tumblecal.report.next_plan_files import LABELS, PLAN

    names = [*CAPTIONS, "finding_1.svg", f"{PLAN}.toml", *(f"{PLAN}_{label}.toml" for label in LABELS.values())]
    assert len(names) > 8
    assert [name for name in names if not any(PurePath(name).match(own) for own in DIAGNOSIS_SET)] == []
