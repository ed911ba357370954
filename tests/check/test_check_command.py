"""`tumblecal check` on the example of docs/check.md, run as the page states it; updates, history, rejected recordings."""

import json
import re
import shlex
from pathlib import Path

import pytest


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
