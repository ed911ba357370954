"""Figures and pages supplement results: an error in one is a warning, and costs neither the results nor the other figures."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import tumblecal
from tumblecal.ground.errors import SupplementWarning
from tumblecal.show.figures.calibration import FIGURES
from tumblecal.show.page import write_page
from tumblecal.show.verdict import Finding, Verdict
from tumblecal.show.words import SectionWords, Words


SOURCE = Path(tumblecal.__file__).parent
# A command with a figure and a card that raise.
BROKEN = """
import sys
import numpy as np
from tumblecal.show.figures import calibration
def broken(*_):
    np.zeros(0).max()
calibration.FIGURES["methods.svg"] = calibration.overview_figure = broken
sys.argv[0] = "tumblecal"
from tumblecal.cli import main
main()
"""


def test_a_broken_figure_and_card_are_a_line_each(tumblecal, tmp_path, table1_file):
    """In a process as users start it: exit code and results are those of a run without figures."""
    out, bare = tmp_path / "out", tmp_path / "bare"
    environment = os.environ | {"PYTHONPATH": str(SOURCE.parent)}
    arguments = ["calibrate", str(table1_file), "--noise-sd", "0.5mg"]
    command = [sys.executable, "-c", BROKEN, *arguments, "--out", out]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=600)
    assert done.returncode == 0, done.stderr
    lines = done.stderr.splitlines()
    assert [line.split(" is ")[0] for line in lines] == [
        f"WARNING: {out}/{name}" for name in ("methods.svg", "calibration.html/card 0")
    ]
    assert all("ValueError: zero-size array" in line and line.endswith("; the results are complete") for line in lines)
    without = tumblecal(*arguments, "--out", bare, "--no-figures")
    assert without.code == 0 and not without.lines
    for name in ("result.json", "calibration.json"):
        one, other = (json.loads((folder / name).read_text()) for folder in (out, bare))
        assert one.keys() == other.keys() and one.get("parameters") == other.get("parameters")
    text = (out / "calibration.html").read_text(encoding="utf-8")
    assert "Residuals" in text and text.count("<figure") == 1 and not (out / "methods.svg").exists()
    assert "written:" in done.stdout and "methods.svg" not in done.stdout.splitlines()[-1]


def test_an_error_in_a_figure_is_an_error_in_tests(tumblecal, tmp_path, table1_file, monkeypatch):
    monkeypatch.setitem(FIGURES, "methods.svg", lambda _: 1 / 0)
    with pytest.raises(SupplementWarning, match=r"methods\.svg is missing or incomplete \(ZeroDivisionError"):
        tumblecal("calibrate", table1_file, "--out", tmp_path / "out")


@pytest.mark.filterwarnings("default::tumblecal.ground.errors.SupplementWarning")
def test_a_page_keeps_what_was_made_before_an_error(tmp_path):
    verdict = Verdict("adequate", "Nothing found.", found=(Finding("A finding"),))
    sections = [SectionWords("First", [["Words."], ["[figure broken]", "A caption"]])]
    words = Words({"found": [["A finding", "", "", "card"]]}, sections)
    with pytest.warns(SupplementWarning) as caught:
        figures = {"card": lambda: 1 / 0, "broken": lambda: {}["x"]}
        write_page(tmp_path / "p.html", words, figures, verdict=verdict)
    assert ["ZeroDivisionError" in str(caught[0].message), "KeyError" in str(caught[1].message)] == [True, True]
    text = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert "A finding" in text and "<h2>First</h2>" in text and text.rstrip().endswith("</html>")
