"""Inputs are never overwritten, and odd names and numbers are one clear line each."""

import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from other_names import NAMES
from tumblecal.data import read_positions, write_positions
from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.ground.strict_toml import toml_string


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.fixture
def inputs(tmp_path, configs, table1):
    """An input of every kind that commands read."""
    write_positions(tmp_path / "data.csv", table1)
    write_calibration(tmp_path / "cal.json", Calibration(np.eye(3), np.zeros(3), np.eye(12) * 1e-12))
    for name in ("paper24", "capture_emulator", "study_coverage"):
        (tmp_path / f"{name}.toml").write_bytes((configs / f"{name}.toml").read_bytes())
    (tmp_path / "log.bin").write_bytes(b"ax,ay,az\n" + b"0.01,0.02,1.0\n" * 50)
    return tmp_path


FILES = {
    "apply to the data": (["apply", "{tmp}/cal.json", "{tmp}/data.csv", "--out"], "data.csv"),
    "apply to the calibration": (["apply", "{tmp}/cal.json", "{tmp}/data.csv", "--out"], "cal.json"),
    "simulate": (["simulate", "{tmp}/paper24.toml", "--out"], "paper24.toml"),
    "decode": (["decode", "{tmp}/log.bin", "--out"], "log.bin"),
    "emulate": (["emulate", "{tmp}/capture_emulator.toml", "--ledger"], "capture_emulator.toml"),
    "port": (["emulate", "{tmp}/capture_emulator.toml", "--port"], "capture_emulator.toml"),
}


@pytest.mark.parametrize(
    ("command", "link"),
    [*((command, "symbolic link") for command in FILES), *(("apply to the data", link) for link in NAMES)],
)
def test_an_output_that_is_an_input(tumblecal, inputs, command, link):
    arguments, name = FILES[command]
    out = NAMES[link](inputs / name, inputs / f"other{Path(name).suffix}")
    before = {path: path.read_bytes() for path in inputs.iterdir()}
    outcome = tumblecal(*(argument.format(tmp=inputs) for argument in arguments), out)
    assert outcome.code == 2
    assert len(outcome.lines) == 1 and "would overwrite the input" in outcome.lines[0], outcome.lines
    assert {path: path.read_bytes() for path in inputs.iterdir()} == before


FOLDERS = {
    "calibrate": (["calibrate", "{tmp}/out/result.json"], "data.csv", "result.json"),
    "its rig": (
        ["diagnose", "{tmp}/data.csv", "--rig", "{tmp}/out/extended_rig.toml"],
        "paper24.toml",
        "extended_rig.toml",
    ),
    "diagnose several": (["diagnose", "{tmp}/data.csv", "{tmp}/out/summary.csv"], "data.csv", "summary.csv"),
    "study": (["study", "coverage", "{tmp}/out/coverage.toml"], "study_coverage.toml", "coverage.toml"),
}


@pytest.mark.parametrize(("arguments", "source", "name"), FOLDERS.values(), ids=FOLDERS)
def test_a_folder_of_results_that_holds_an_input(tumblecal, inputs, arguments, source, name):
    folder = inputs / "out"
    folder.mkdir()
    (folder / "paper24.toml").write_bytes((inputs / "paper24.toml").read_bytes())
    (folder / name).write_bytes((inputs / source).read_bytes())
    before = {path: path.read_bytes() for path in folder.iterdir()}
    outcome = tumblecal(*(argument.format(tmp=inputs) for argument in arguments), "--out", f"{inputs}/./out")
    assert outcome.code == 2
    assert len(outcome.lines) == 1 and "would overwrite the input" in outcome.lines[0], outcome.lines
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_names_with_line_breaks(tumblecal, tmp_path, table1):
    path = tmp_path / "da\nta: [x]\x7f.csv"
    write_positions(path, table1)
    outcome = tumblecal("calibrate", path, tmp_path / "no\nsuch\x1b[31m.csv", "--out", tmp_path / "out")
    refused = "has control characters; rename it, or the file"
    assert outcome.code == 2 and len(outcome.lines) == 2 and all(line.endswith(refused) for line in outcome.lines)
    assert rf"da\nta: [x]\x7f.csv: {refused}" in outcome.lines[0] and r"no\nsuch\x1b[31m.csv" in outcome.lines[1]
    for name in (str(path), 'a"b\\c', "\x7f\x00\x1f", "\u2028ü", "\udcff"):
        assert tomllib.loads(f"name = {toml_string(name)}")["name"] == name.replace("\udcff", "?")
    write_positions(tmp_path / "comment.csv", replace(table1, comments={"operator": "one\nposition,alpha_deg"}))
    assert read_positions(tmp_path / "comment.csv").comments["operator"] == r"one\nposition,alpha_deg"


@pytest.mark.long
def test_damaged_files_of_every_kind():
    """A short run of the benchmark: no traceback, and nothing missing or changed without a line where the format shows it."""
    script = Path(__file__).parents[2] / "benchmarks" / "damaged_files.py"
    run = subprocess.run([sys.executable, script, "--files", "44", "--seed", "7"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-3000:] + run.stdout[-3000:]
    counts = dict(zip(("refused", "reported", "same", "unseen", "silent", "failed"), _all_row(run.stdout), strict=True))
    assert sum(counts.values()) == 44 and counts["silent"] == counts["failed"] == 0 and counts["refused"] > 15


def _all_row(table: str) -> list[int]:
    (row,) = (line for line in table.splitlines() if line.startswith("all "))
    return [int(word) for word in row.split()[1:]]
