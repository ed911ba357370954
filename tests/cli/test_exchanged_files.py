"""`check` with files in the wrong place: one line that names the file and the remedy, before any computation."""

import pytest


FILES = {
    "calibration.json": '{"schema": "tumblecal.calibration/1"}',
    "plan.json": '{\n "schema": "tumblecal.plan/1"}',
    "rig.toml": 'schema = "tumblecal.rig/1"',
    "log.json": '{"ax": [1, 2]}',
    "positions.csv": "position,alpha_deg\n1,0",
}


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (
            ("positions.csv", "calibration.json"),
            "positions.csv and calibration.json are exchanged: the calibration is the first argument; "
            "run: tumblecal check calibration.json positions.csv",
        ),
        (("calibration.json", "calibration.json"), "calibration.json: this is a calibration, not a recording; give"),
        (("calibration.json", "rig.toml"), "rig.toml: this is a rig file, not a recording; give"),
        (("plan.json", "positions.csv"), "plan.json: this is a plan, not a calibration; give the calibration.json"),
    ],
)
def test_files_in_the_wrong_place(tumblecal, arguments, fault):
    outcome = tumblecal("check", *arguments)
    assert outcome.code == 2 and len(outcome.lines) == 1 and fault in outcome.lines[0]
