"""What is printed: words, nothing, or JSON; that work goes on, on a terminal alone."""

import json
import os
import pty
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tumblecal.data import write_positions
from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.calibration_use import Use


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.mark.parametrize(("name", "file"), [("calibrate", "result.json"), ("diagnose", "diagnosis.json")])
def test_words_nothing_or_json(tumblecal, table1_file, tmp_path, name, file):
    command = [name, table1_file, "--out", tmp_path / "out", "--no-figures"]
    assert "written:" in tumblecal(*command).out
    silent = tumblecal(*command, "-q")
    assert (silent.code, silent.out, silent.lines) == (0, "", [])
    as_json = tumblecal(*command, "--json")
    written = json.loads((tmp_path / "out" / file).read_text())
    assert as_json.code == 0 and as_json.lines == [] and json.loads(as_json.out) == written
    assert as_json.out.count("\n") == 1


def test_every_command_that_ends_by_itself_can_be_quiet(tumblecal, table1_file, tmp_path):
    rig = Path(__file__).parents[2] / "configs" / "paper24.toml"
    lab, log = tmp_path / "lab.db", tmp_path / "log.csv"
    log.write_text("ax_g,ay_g,az_g,temperature_degc\n0,0,1,80\n0,0,1,20\n")
    (tmp_path / "bytes.bin").write_bytes(b"0.1,0.2,0.9\r\n" * 400)
    (tmp_path / "cal").mkdir()
    own, use = tmp_path / "cal" / "calibration.json", Use("within", "measured there alone", (15.0, 25.0))
    write_calibration(own, Calibration(np.eye(3), np.zeros(3), np.eye(12) * 1e-9, use=use))
    commands = {
        "simulate": [rig, "--out", tmp_path / "simulated.csv"],
        "apply": [own, log],
        "export": [own, "--to", "csv", "--out", tmp_path / "unit.csv"],
        "compare": [own, own],
        "history": [lab, "--example"],
        "decode": [tmp_path / "bytes.bin", "--columns", "ax,ay,az", "--unit", "g"],
    }
    said = {name: tumblecal(name, *words, "-q") for name, words in commands.items()}
    assert all((outcome.code, outcome.out) == (0, "") for outcome in said.values()), [*said.values()]
    assert any("temperatures in 1 of 2 rows" in line for line in said["apply"].lines)
    assert tumblecal("export", own, "--to", "csv", "-q").lines == [
        "tumblecal: --quiet prints nothing, so the export would be lost; add --out"
    ]
    assert "--quiet" in tumblecal("certificate", "-q", "--help").out


KELVIN, EXCHANGED, MISREAD = "kelvin", "exchanged", "misread"


def slipped(data, slip):
    """Table 1 with a temperature in kelvin, with two axes exchanged, or with a reading half a g off."""
    degc = 295.0 + np.arange(len(data)) / 10
    readings = data.readings.copy()
    readings[3] += 0.5 * (slip == MISREAD)
    if slip == EXCHANGED:
        readings = readings[:, [1, 0, 2]]
    return replace(data, readings=readings, temperature_degc=degc if slip == KELVIN else None)


MUST_BE_READ = [
    ("calibrate", "", ["--noise-sd", "0.01mg"], ["Do not use it: the data contradict the model (p "]),
    ("calibrate", KELVIN, [], ["corrected: the temperatures, 295 to 297.3, are in kelvin"]),
    ("calibrate", MISREAD, [], ["Do not use it: position 0-4, axis ", "Do not use it: the fit requires parameter values far",
                                "IMPLAUSIBLE: scatter = "]),
    ("diagnose", EXCHANGED, [], ["use: no: no calibration is written", "corrected: axis_map: column x is y"]),
]  # fmt: skip


@pytest.mark.parametrize(("name", "slip", "options", "words"), MUST_BE_READ)
def test_what_must_not_go_unread_is_a_line_each(tumblecal, table1, tmp_path, name, slip, options, words):
    """With -q and --json; the words say it anyway."""
    file = tmp_path / "data.csv"
    write_positions(file, slipped(table1, slip))
    command = [name, file, "--out", tmp_path / "out", "--no-figures", *options]
    for how in ("-q", "--json"):
        outcome = tumblecal(*command, how)
        refused = name == "calibrate" and slip != KELVIN
        assert outcome.code == (3 if refused else 0) and len(outcome.lines) == len(words)
        for line, said in zip(outcome.lines, words, strict=True):
            assert line.startswith(f"WARNING: {file}: {said}")
        assert json.loads(outcome.out) if how == "--json" else outcome.out == ""
    assert tumblecal(*command).lines == []


def test_work_is_shown_on_a_terminal(table1_file, tmp_path):
    """A real terminal for stderr. And -v says what is done."""
    leader, follower = pty.openpty()
    command = ["calibrate", str(table1_file), "--out", str(tmp_path / "out"), "--no-figures", "-v"]
    arguments = [sys.executable, "-m", "tumblecal.cli", *command]
    environment = os.environ | {"TERM": "xterm"}
    with subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=follower, env=environment) as run:
        os.close(follower)
        shown = b""
        while True:
            try:
                chunk = os.read(leader, 4096)
            except OSError:
                break
            if not chunk:
                break
            shown += chunk
    os.close(leader)
    assert run.returncode == 0 and b"calibrating" in shown
    assert b"24 positions" in shown and b" ms tumblecal." in shown


@pytest.mark.parametrize("closed", [">&-", ">&- 2>&- <&-"])
def test_closed_standard_streams_cost_no_result(tmp_path, closed):
    """As services and cron start it: the files are complete, and no line of output is in them."""
    (tmp_path / "log.csv").write_text("time_s,ax_g,ay_g,az_g\n" + "".join(f"{k / 100},0,0,1\n" for k in range(50)))
    command = f"{sys.executable} -m tumblecal import log.csv --out out.csv {closed}"
    done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "Traceback" not in done.stderr
    lines = [line for line in (tmp_path / "out.csv").read_text().splitlines() if line[0] != "#"]
    assert lines[0] == "time_s,ax_g,ay_g,az_g" and len(lines) == 51
