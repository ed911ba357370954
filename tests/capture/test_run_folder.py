"""One folder, one run: another start harms nothing, and a folder that goes away is told at once."""

import errno
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bench import CaptureProcess, Emulator
from test_signals import PLAN, entries_of

from disk import file_size_limited
from tumblecal.capture.journal import Journal, read_journal, replayed
from tumblecal.capture.log import LogWriter
from tumblecal.ground.errors import InputError
from tumblecal.recordings.dwells.captured import _middle_s
from tumblecal.recordings.reduce import reduced


QUICK = PLAN.replace("400.0", "2.0")
OPTIONS = ("plan.toml", "--out", "run", "--plain")


def test_a_second_start_harms_nothing(tmp_path: Path) -> None:
    """Also both commands pasted in one go: the instrument appears later, and a failed try before leaves no trace."""
    (tmp_path / "plan.toml").write_text(QUICK)
    first = CaptureProcess(tmp_path, *OPTIONS, "--wait", "0.2")
    assert first.close() == 2
    assert b"waiting up to 0.2 s" in first.raw and b"there is no such device" in first.raw
    assert entries_of(tmp_path / "run") == ["session", "stopped"]
    capture = CaptureProcess(tmp_path, *OPTIONS)
    capture.wait_for(lambda: b"waiting up to 30 s" in capture.raw)
    for arguments in (OPTIONS, ("--resume", "run", "--plain", "--yes")):
        second = CaptureProcess(tmp_path, *arguments)
        assert second.close() == 2
        assert b"journal.log: another capture is writing this log" in second.raw
    with Emulator(tmp_path, "[head]\nturn_s = 1.0\n", follow="run"):
        assert capture.close() == 0, capture.raw
    state = replayed(read_journal(tmp_path / "run"))
    assert sorted(state.accepted) == [0, 1] and entries_of(tmp_path / "run")[-1] == "finished"
    assert len(reduced([tmp_path / "run"]).data) == 2
    # What is done is done: nothing is waited for, nothing asked and nothing written.
    done, whole = CaptureProcess(tmp_path, "--resume", "run", "--plain"), entries_of(tmp_path / "run")
    assert done.close() == 0 and b"all 2 positions are recorded; next: tumblecal reduce run" in done.raw
    assert b"waiting" not in done.raw and entries_of(tmp_path / "run") == whole


@pytest.mark.parametrize("what", ["deleted", pytest.param("moved", marks=pytest.mark.long), "full"])
def test_a_folder_that_goes_away_ends_the_run_at_once(tmp_path: Path, what: str) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    with Emulator(tmp_path, ""):
        with file_size_limited(300_000 if what == "full" else 1 << 40):
            capture = CaptureProcess(tmp_path, *OPTIONS[:3])
        before = capture.flags()
        capture.wait_for(lambda: "recording" in entries_of(tmp_path / "run"))
        if what == "deleted":
            shutil.rmtree(tmp_path / "run")
        elif what == "moved":
            (tmp_path / "run").rename(tmp_path / "elsewhere")
        assert capture.wait() == 2
        assert capture.flags() == before
        capture.close()
    told = capture.raw.replace(b"\r\n", b"")
    if what == "deleted":
        assert b"was deleted while capturing; recording stopped" in told and not (tmp_path / "run").exists()
        return
    words = (
        b"the disk is full; recording stopped" if what == "full" else b"was moved while capturing; recording stopped"
    )
    assert words in told
    last = read_journal(tmp_path / {"moved": "elsewhere", "full": "run"}[what])[-1]
    assert last["entry"] in ("stopped", "rejected")


def refuse(*_: object) -> int:
    raise OSError(errno.EROFS, os.strerror(errno.EROFS))


@pytest.mark.parametrize(
    ("replaced", "words"),
    [
        ({"access": lambda path, mode: False}, "was made read-only while capturing; recording stopped"),
        ({"write": refuse, "ftruncate": refuse}, r"journal.log: cannot be written any more \(Read-only file system\)"),
    ],
)
def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path, monkeypatch, replaced: dict, words: str) -> None:
    journal = Journal(tmp_path)
    for name, function in replaced.items():
        monkeypatch.setattr(os, name, function)
    with pytest.raises(InputError, match=words):
        journal.write("session")
    journal.close()


def test_a_writer_waits_for_one_that_is_ending(tmp_path: Path) -> None:
    """Resumed just after a kill -9 of the guide, whose recorder is still finishing."""
    first = LogWriter(tmp_path / "raw.log")
    with pytest.raises(InputError, match="another capture"):
        LogWriter(tmp_path / "raw.log", 0.1)
    first.close()
    LogWriter(tmp_path / "raw.log", 0.1).close()


def test_the_pause_of_an_interrupted_run_is_kept():
    """Two hours lie between two sittings. The second one's monotonic clock starts again with the machine; in it the machine
    sleeps for 10 minutes before the attempt, during which that clock stops."""
    second, hour = 10**9, 3600 * 10**9
    sittings = [
        {"log_position": 0, "clocks": {"wall_ns": 5 * hour, "monotonic_ns": 9 * hour, "boot_ns": 9 * hour}},
        {"log_position": 1000, "clocks": {"wall_ns": 7 * hour, "monotonic_ns": 40 * second, "boot_ns": 40 * second}},
    ]
    state = SimpleNamespace(devices=sittings, device=sittings[1])
    before = SimpleNamespace(log_start=500, clocks={})
    after = SimpleNamespace(log_start=1500, clocks={"monotonic_ns": 100 * second, "boot_ns": 700 * second})
    assert _middle_s(np.array([9 * 3600 + 10.0, 9 * 3600 + 30.0]), before, state) == pytest.approx(20.0)
    assert _middle_s(np.array([95.0, 105.0]), after, state) == pytest.approx(2 * 3600 + 60 + 600)
