"""History and compare with a budget's uncertainties, where a budget lies beside the calibration."""

import json
from dataclasses import replace

import numpy as np
import pytest
from test_history import results

from tumblecal.data import write_positions
from tumblecal.data.calibration import read_calibration
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.history.database import add, of_unit
from tumblecal.history.repeatability import PAPER_LIMITS, unit_history
from tumblecal.show.history import words_of_history


@pytest.fixture
def folder(tumblecal, tmp_path, table1, configs):
    """A calibration of Table 1, kept in a history, and then its budget beside it."""
    data = tmp_path / "data.csv"
    write_positions(data, replace(table1, comments={"serial_number": "A-17"}))
    kept = ["--history", tmp_path / "lab.db", "--out", tmp_path / "c"]
    assert tumblecal("calibrate", data, "--noise-sd", "0.1mg", "--no-figures", *kept).code == 0
    lab = configs / "considered_lab.toml"
    assert tumblecal("budget", data, lab, "--noise-sd", "0.1mg", "--out", tmp_path / "c").code == 0
    return tmp_path / "c"


@pytest.mark.long
def test_which_uncertainties_were_used_is_said_and_they_are_the_budget_s(tumblecal, tmp_path, folder):
    path, budget = tmp_path / "lab.db", json.loads((folder / "budget.json").read_text())

    def page(name):
        assert tumblecal("history", path, "A-17", "--out", tmp_path / name).code == 0
        return (tmp_path / name / "history.html").read_text()

    assert "Uncertainties: of the noise alone (type A)" in page("before")
    assert "1 of 1 added" in tumblecal("history", path, "--add", folder).out
    assert "Uncertainties: combined (noise and budget)" in page("after")
    alone, combined = (entry.parameters for entry in of_unit(path, "A-17"))
    assert [entry.combined for entry in of_unit(path, "A-17")] == [False, True]
    u = [budget["parameters"][name]["u"] for name in combined.names]
    np.testing.assert_allclose(combined.sd, u, rtol=1e-9)
    assert np.all(combined.sd >= alone.sd) and np.max(combined.sd / alone.sd) > 1.2
    np.testing.assert_array_equal(combined.values, alone.values)


def test_compare_takes_the_budget_beside_a_calibration_and_says_so(tumblecal, tmp_path, folder):
    (tmp_path / "alone.json").write_text((folder / "calibration.json").read_text())
    outcome = tumblecal("compare", tmp_path / "alone.json", folder / "calibration.json")
    assert "alone.json: its uncertainty includes only the noise (type A)" in outcome.out
    assert "calibration.json: combined standard uncertainty of the noise and budget.json in its folder" in outcome.out
    u = json.loads((folder / "budget.json").read_text())["parameters"]["bias_y"]["u"]
    sd = read_calibration(folder / "calibration.json").sensor.of(SENSOR).sd[SENSOR.index("bias_y")]
    row = next(line.split() for line in outcome.out.splitlines() if line.startswith("bias_y"))
    assert float(row[4]) == pytest.approx(1e3 * np.hypot(u, sd), abs=5e-4)  # two significant digits


def test_a_budget_of_other_data_is_not_taken(tumblecal, tmp_path, folder):
    budget = json.loads((folder / "budget.json").read_text())
    budget["source"]["sha256"] = "0" * 64
    (folder / "budget.json").write_text(json.dumps(budget))
    outcome = tumblecal("compare", folder / "calibration.json", folder / "calibration.json")
    assert outcome.code == 0 and "combined" not in outcome.out
    assert "0 of 1 added" in tumblecal("history", tmp_path / "lab.db", "--add", folder).out
    (folder / "budget.json").write_text("{}")
    outcome = tumblecal("compare", folder / "calibration.json", folder / "calibration.json")
    assert outcome.code == 2 and "budget.json: schema is None, not 'tumblecal.budget_result/1'" in outcome.lines[0]


def test_kinds_of_uncertainties_are_stated(tmp_path, snapshot):
    """`calibration.json` of a diagnosis lists its contributions; a budget in the same folder adds its inputs."""
    diagnosed = {"calibration.json": json.dumps({"provenance": {"uncertainty_parts": {}}})}
    budget, texts = {"budget.json": "{}"}, {}
    for title, documents in {"budget": ({}, budget, {}), "diagnosis": ({}, diagnosed, diagnosed | budget)}.items():
        for entry, beside in zip(results(3), documents, strict=True):
            add(tmp_path / f"{title}.db", replace(entry, documents=beside))
        judged = unit_history(of_unit(tmp_path / f"{title}.db", "A-17"), PAPER_LIMITS)
        texts[title] = "\n".join(words_of_history("A-17", judged, 0.05).lines("evidence")[1:])
    snapshot("uncertainties", texts)
