"""`tumblecal check` on the example of docs/check.md, run as the page states it; updates, history, rejected recordings."""

import json
import re
import shlex
from pathlib import Path

import pytest

from tumblecal.data.calibration import read_calibration
from tumblecal.data.sensor_parameters import SENSOR


pytestmark = pytest.mark.long
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "check.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.S | re.M)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("check")


@pytest.fixture
def example(folder, tumblecal, monkeypatch):
    """The folder in which the program and the commands of the page ran, once."""
    monkeypatch.chdir(folder)
    if not Path("printed").exists():
        (program,) = blocks("python")
        exec(compile(program, "check.md", "exec"), {})
        *earlier, last = blocks("sh")[0].splitlines()
        for command in earlier:
            assert tumblecal(*shlex.split(command)[1:]).code == 0
        outcome = tumblecal(*shlex.split(last)[1:], "--history", "lab.db")
        assert outcome.code == 3, outcome.lines
        Path("printed").write_text(outcome.out, encoding="utf-8")
    return folder


def test_the_page_s_example_prints_its_lines(example):
    printed = (example / "printed").read_text(encoding="utf-8")
    (text,) = blocks("text")
    assert text in printed and "written: check17/: check.json, check.html" in printed
    record = json.loads((example / "check17" / "check.json").read_text(encoding="utf-8"))
    assert (record["verdict"], record["use"]["answer"], record["change"]["named"]) == ("changed", "no", ["bias_z"])
    assert record["change"]["explanations"][0]["change"]["bias_z"] == pytest.approx(0.8e-3, abs=0.2e-3)
    assert record["recording"][0]["sha256"] and record["text"] in printed
    page = (example / "check17" / "check.html").read_text(encoding="utf-8")
    assert "bias of the z axis" in page and page.count("<svg") == 2


def test_a_check_is_in_the_history_but_on_no_chart(example, tumblecal):
    listed = tumblecal("history", "lab.db")
    assert re.search(r"2026-09-30.*A-17 +check .*changed: bias_z; use: no", listed.out)
    assert "no result of A-17 has a calibration" in tumblecal("history", "lab.db", "A-17").lines[-1]
    added = tumblecal("history", "other.db", "--add", "check17")
    assert "1 of 1 added" in added.out


def test_the_page_s_update_corrects_the_changed_bias_alone(example, tumblecal):
    refused = tumblecal("check", "unit17/calibration.json", "field.csv", "--update", "new.json", "--out", "refused")
    assert refused.code == 2 and "contradicts the calibration" in refused.lines[-1] and not Path("new.json").exists()
    assert Path("refused/check.json").exists()
    outcome = tumblecal(*shlex.split(blocks("sh")[1])[1:], "--months", "6", "--out", "made")
    assert outcome.code == 3, outcome.lines
    old, new = (read_calibration(path).sensor.of(SENSOR) for path in ("unit17/calibration.json", "updated.json"))
    assert new.values[5] - 1.6e-3 == pytest.approx(0, abs=3 * new.sd[5])
    assert new.sd[5] < 0.1e-3
    others = [0, 1, 2, 3, 4, 6, 7, 8]
    assert abs((new.values - old.values) / old.sd)[others].max() < 3
    provenance = read_calibration("updated.json").provenance
    assert provenance["measured_utc"] == "2026-09-30" and provenance["update"]["freed"] == ["bias_z"]
    assert provenance["update"]["process_noise"]["sd"]["bias_x"] == pytest.approx(0.12e-3)
    # It is checked by new data.
    again = tumblecal("check", "updated.json", "field.csv", "--out", "again")
    assert again.code == 2 and "was made from this file" in again.lines[-1]


def test_recordings_without_rest_or_an_axis_are_one_line(example, tumblecal):
    text = (example / "field.csv").read_text(encoding="utf-8")
    head, rows = "\n".join(text.splitlines()[:3]) + "\n", "\n".join(text.splitlines()[3:])
    for pattern, new, fault in (
        (r"(?s)(.{20000}).*", r"\1", r"only 1 attitude, 4\.\d+ s at rest; a check needs three or more"),
        (r",[^,]*$", ",3.7", "axis z does not respond"),
    ):
        (example / "field2.csv").write_text(head + re.sub(pattern, new, rows, flags=re.M), encoding="utf-8")
        outcome = tumblecal("check", "unit17/calibration.json", "field2.csv", "--out", "refused2")
        assert outcome.code == 2 and re.search(fault, outcome.lines[-1]), outcome.lines
