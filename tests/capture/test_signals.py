"""Signals and terminals: a run that is ended from outside leaves a whole journal and a terminal that can be used."""

import re
import signal
import termios
from pathlib import Path

import pytest
from bench import CaptureProcess, Emulator

from tumblecal.capture.journal import JOURNAL_NAME, read_journal
from tumblecal.capture.log import read_log


PLAN = """
[port]
url = "imu"
speed = 20.0
[positions]
beta_deg = [0]
alpha_deg = [0, 90]
[dwell]
seconds = 400.0
settle_s = 1.0
"""


def entries_of(folder: Path) -> list[str]:
    """What the journal holds by now; nothing before it was begun."""
    path = folder / JOURNAL_NAME
    return [r.content()["entry"] for r in read_log(path)] if path.exists() else []


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.long)])
def test_a_signal_restores_the_terminal_and_is_written_down(tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    with Emulator(tmp_path, "") as emulator:
        capture = CaptureProcess(tmp_path, "plan.toml", "--out", "run", rows=24, columns=80)
        before = capture.flags()
        capture.wait_for(lambda: capture.raw.count(b"RECORDING") > 3)
        assert not capture.flags() & termios.ECHO and emulator.port.exists()
        capture.process.send_signal(number)
        assert capture.wait() == -number
        assert capture.flags() == before
    capture.close()
    for on, off in ((b"\x1b[?1049h", b"\x1b[?1049l"), (b"\x1b[?25l", b"\x1b[?25h")):
        assert 0 < capture.raw.rfind(on) < capture.raw.rfind(off)
    last = read_journal(tmp_path / "run")[-2:]
    assert [e["entry"] for e in last] == ["rejected", "stopped"] and last[1]["why"] == number.name

    # What 80 columns and 24 lines show: the last whole screen has its counters and its keys.
    screens = re.sub(rb"\x1b\[[0-9;?]*[a-zA-Z]|\a", b"\f", capture.raw).decode().split("RECORDING ")
    shown = [s for s in screens if "good samples" in s][-2]
    for words in ("frames ", "bad checks", "lost >=", "q: interrupt", "r: repeat this position", "expected mg"):
        assert words in " ".join(shown.replace("\f", "").split()), shown
    assert shown.count("\n") <= 24


def test_a_closed_terminal_ends_the_run_in_order(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    with Emulator(tmp_path, ""):
        capture = CaptureProcess(tmp_path, "plan.toml", "--out", "run")
        capture.wait_for(lambda: "recording" in entries_of(tmp_path / "run"))
        capture.hang_up()
        assert capture.process.wait(600) == -signal.SIGHUP
    assert read_journal(tmp_path / "run")[-1]["why"] == "SIGHUP"
