"""Whether a calibration may be used: stated in its file, and reported or enforced by every command that takes one."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tumblecal.data import write_positions
from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.calibration_use import Use


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.fixture(scope="module")
def exchanged(tmp_path_factory, table1):
    """Table 1 with two rows in each other's place."""
    data, readings = tmp_path_factory.mktemp("exchanged") / "data.csv", table1.readings.copy()
    first, second = 3, 10
    readings[[first, second]] = readings[[second, first]]
    comments = {"serial_number": "A-17", "gravity_ms2": "9.8123", "gravity_source": "gravimeter"}
    write_positions(data, replace(table1, readings=readings, comments=comments))
    return data, f"positions {table1.names[first]} and {table1.names[second]} appear exchanged"


@pytest.fixture
def refused(tmp_path):
    """A calibration file, and a result beside it, that must not be used."""
    use = Use("no", "two rows exchanged", expanded_g=0.0008)
    write_calibration(tmp_path / "calibration.json", of_unit(use))
    return tmp_path / "calibration.json"


def of_unit(use: Use, **more) -> Calibration:
    return Calibration(np.eye(3), np.zeros(3), 1e-8 * np.eye(12), use=use, serial_number="A-17", **more)


def test_calibrate_ends_with_code_3_and_reports_every_judgement(tumblecal, tmp_path, exchanged):
    data, words = exchanged
    outcome = tumblecal("calibrate", data, "--no-figures", "--out", tmp_path / "c", "--history", tmp_path / "lab.db")
    said = " ".join(outcome.out.split())
    assert outcome.code == 3 and "DO NOT USE" in said and f"The readings of {words}" in said.partition("USE")[2]
    content = json.loads((tmp_path / "c" / "result.json").read_text())
    use = json.loads((tmp_path / "c" / "calibration.json").read_text())["use"]
    assert content["use"] == use and use["answer"] == "no" and words in use["reason"]
    assert words in content["judgements"][0]["headline"] and content["judgement"] == content["judgements"][0]
    assert all(judged["use"]["reason"] in said for judged in content["judgements"])
    assert "; use: no" in tumblecal("history", tmp_path / "lab.db").out
    reported = tumblecal("history", tmp_path / "lab.db", "A-17").out
    assert reported.startswith("A-17: results that must not be used (use: no): 1.\nNEXT: Diagnose their data")


@pytest.mark.parametrize("command", ["apply", "export"])
def test_what_must_not_be_used_is_rejected(tumblecal, tmp_path, refused, command):
    log = tmp_path / "log.csv"
    log.write_text("ax_g,ay_g,az_g\n0,0,1\n")
    rest = (
        [log, "--out", tmp_path / "out.csv"] if command == "apply" else ["--to", "csv", "--out", tmp_path / "out.csv"]
    )
    outcome = tumblecal(command, refused, *rest)
    assert outcome.code == 2 and outcome.lines == [
        f"tumblecal: {refused}: use: no: two rows exchanged. Repeat the measurement or the "
        "calibration; --use-anyway overrides this"
    ]
    assert not (tmp_path / "out.csv").exists()
    outcome = tumblecal(command, refused, *rest, "--use-anyway")
    assert outcome.code == 0 and "no: two rows exchanged" in outcome.out
    if command == "export":
        assert "use: no: two rows exchanged" in (tmp_path / "out.csv").read_text()
