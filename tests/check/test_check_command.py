"""`tumblecal check` on the example of docs/check.md, run as the page states it; updates, history, rejected recordings."""

import json
from pathlib import Path

import pytest

from pages import blocks, run_example


pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("check")


@pytest.fixture
def example(folder, tumblecal, monkeypatch):
    """The folder in which the program and the commands of the page ran, once."""
    monkeypatch.chdir(folder)
    if not Path("printed").exists():
        printed = run_example("check", tumblecal, "--history", "lab.db", code=3)
        Path("printed").write_text(printed, encoding="utf-8")
    return folder


def test_the_page_s_example_prints_its_lines(example):
    printed = (example / "printed").read_text(encoding="utf-8")
    (text,) = blocks("check", "text")
    assert text in printed and "written: check17/: check.json, check.html" in printed
    record = json.loads((example / "check17" / "check.json").read_text(encoding="utf-8"))
    assert (record["verdict"], record["use"]["answer"], record["change"]["named"]) == ("changed", "no", ["bias_z"])
    assert record["change"]["explanations"][0]["change"]["bias_z"] == pytest.approx(0.8e-3, abs=0.2e-3)
    assert record["recording"][0]["sha256"] and record["text"] in printed
    page = (example / "check17" / "check.html").read_text(encoding="utf-8")
    assert "bias of the z axis" in page and page.count("<svg") == 2
