"""Figures and pages supplement results: an error in one is a warning, and costs neither the results nor the other figures."""

import json
import os
import subprocess
import sys
from pathlib import Path

import tumblecal


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
