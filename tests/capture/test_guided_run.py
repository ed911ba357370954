"""Whole guided runs through real pseudo-terminals, with a scripted operator at the screen and the head."""

import re
import time
from pathlib import Path

import numpy as np
import pytest
from bench import CaptureProcess, Emulator

from tumblecal.capture.journal import JOURNAL_NAME, RAW_NAME, read_journal, replayed
from tumblecal.capture.log import LogWriter
from tumblecal.data import read_positions
from tumblecal.estimation import exact
from tumblecal.estimation.position_problem import problem_of
from tumblecal.ground.errors import InputError
from tumblecal.recordings.reduce import reduced
from tumblecal.recordings.reduction import write_reduction


PLAN = """
[session]
operator = "script"
[port]
url = "imu"
speed = 20.0
[site]
latitude_deg = 48.1
height_m = 520.0
[positions]
beta_deg = [0, 45, 90]
alpha_deg = [0, 45, 90, 135, 180, 225, 270, 315]
[dwell]
seconds = 3.0
settle_s = 1.0
"""
RIG = (Path(__file__).parents[2] / "configs" / "paper24.toml").resolve()
EMULATOR = f"""
rig = "{RIG}"
[site]
latitude_deg = 48.1
height_m = 520.0
[noise]
seed = SEED
[head]
turn_s = 1.0
reaction_s = 0.2
"""
DISTURBED = """
[faults]
unplug_at_s = [75.0, 180.0]
unplug_for_s = 4.0
missing_frames_per_s = 0.1
[[mistake]]
at = 3
alpha_offset_deg = 90.0
"""


def parameters(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    data = read_positions(folder / "positions.csv")
    fitted = exact.fit(problem_of(data))
    return fitted.values, np.sqrt(np.diag(fitted.covariance))


@pytest.mark.long
def test_disturbed_run_ends_in_the_same_calibration(tmp_path: Path) -> None:
    """A wrong position, an unplug and a kill -9 in the middle change the result by no more than its sd allows."""
    (tmp_path / "plan.toml").write_text(PLAN)
    with Emulator(tmp_path, EMULATOR.replace("SEED", "1"), follow="quiet"):
        capture = CaptureProcess(tmp_path, "plan.toml", "--out", "quiet", "--plain")
        assert capture.close() == 0, capture.seen[-20:]
    with Emulator(tmp_path, EMULATOR.replace("SEED", "2") + DISTURBED, follow="rough") as emulator:
        capture = CaptureProcess(tmp_path, "plan.toml", "--out", "rough", "--plain")
        capture.wait_for(lambda: any("RECORDING position 7," in line for line in capture.seen))
        capture.kill()
        before = replayed(read_journal(tmp_path / "rough"))
        assert 5 <= len(before.accepted) <= 7
        for _ in range(3):
            while not emulator.port.exists():
                time.sleep(0.01)
            capture = CaptureProcess(tmp_path, "--resume", "rough", "--plain", "--yes")
            # On a slow machine the next unplugging may come just as the run is resumed: plugged in, it is resumed again.
            code = capture.close()
            if code == 0:
                break
        assert code == 0, capture.seen[-20:]
    entries = read_journal(tmp_path / "rough")
    after = replayed(entries)
    assert len(after.accepted) == 24 and entries[-1]["entry"] == "finished"
    # What had been accepted before the kill is the same recording.
    assert all(after.accepted[k] == before.accepted[k] for k in before.accepted)
    assert any(e["entry"] == "wrong_position" and "looks like alpha 180" in e["text"] for e in entries)
    assert max(e["tally"].get("reopened", 0) for e in entries if "tally" in e) >= 1

    for name in ("quiet", "rough"):
        write_reduction(reduced([tmp_path / name]), tmp_path / name)
    quiet, quiet_sd = parameters(tmp_path / "quiet")
    rough, rough_sd = parameters(tmp_path / "rough")
    z = (rough - quiet) / np.hypot(quiet_sd, rough_sd)
    assert np.abs(z).max() < 4, z
    truth = np.array([0.2, -0.12, 0.3, 1.1, -0.75, 0.8, 0.22, -0.18, 0.09, 0.13, -0.12, 0.22, 1.5, -1.8, -2.1]) * 1e-3
    assert np.abs((quiet - truth) / quiet_sd).max() < 5


ONE = """
[port]
url = "imu"
speed = 20.0
[positions]
beta_deg = [0]
alpha_deg = [0, 90, 180]
[dwell]
seconds = 4.0
settle_s = 1.0
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small finished capture, with a redo, a skip and a repeat by keys."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "plan.toml").write_text(ONE)
    with Emulator(folder, "[noise]\nseed = 3\n") as emulator:
        capture = CaptureProcess(folder, "plan.toml", "--out", "run", "--plain")
        done: set[str] = set()
        turned = "0"  # where the head is at first: a turn there might come while it is recorded
        deadline = time.monotonic() + 600
        while capture.running and time.monotonic() < deadline:
            for line in capture.lines():
                found = re.match(
                    r"(TURN|SETTLING|RECORDING) position (\S+), \d of 3 done: alpha (\S+) beta (\S+)", line
                )
                if not found:
                    continue
                phase, name, alpha, beta = found.groups()
                if phase == "TURN" and name == "2" and "skip" not in done:
                    capture.press("s")
                    done.add("skip")
                elif phase == "RECORDING" and name == "3" and "repeat" not in done:
                    capture.press("r")
                    done.add("repeat")
                elif phase == "TURN" and name == "2" and len(done) == 2:
                    capture.press("b")
                    done.add("redo")
                if phase == "TURN" and turned != alpha:
                    emulator.turn(float(alpha), float(beta))
                    turned = alpha
            time.sleep(0.01)
        assert capture.close() == 0, capture.seen[-20:]
        assert done == {"skip", "repeat", "redo"}
    return folder / "run"


def test_reduction_of_a_run(finished: Path) -> None:
    paths = write_reduction(reduced([finished]), finished)
    data = read_positions(paths[0])
    np.testing.assert_allclose(data.readings, [[0, 0, 1], [0, 1, 0], [0, 0, -1]], atol=4e-4)
    assert data.sd is not None and (data.sd > 0).all()
    np.testing.assert_array_equal(read_positions(paths[1]).readings, data.readings)
    assert data.comments["serial_number"] == "N25581846020020"


def test_changed_raw_data_are_refused(finished: Path, tmp_path: Path) -> None:
    for name in (JOURNAL_NAME, RAW_NAME, "plan.toml"):
        (tmp_path / name).write_bytes((finished / name).read_bytes())
    raw = bytearray((tmp_path / RAW_NAME).read_bytes())
    attempt = replayed(read_journal(tmp_path)).accepted[0]
    raw[(attempt.log_start + attempt.log_stop) // 2] ^= 1
    (tmp_path / RAW_NAME).write_bytes(raw)
    with pytest.raises(InputError, match="were changed after recording"):
        reduced([tmp_path])


def test_resume_refuses_a_changed_plan(finished: Path, tmp_path: Path) -> None:
    from tumblecal.capture.run.run_folder import resume

    (tmp_path / JOURNAL_NAME).write_bytes((finished / JOURNAL_NAME).read_bytes())
    (tmp_path / "plan.toml").write_text(ONE + "# changed\n")
    with pytest.raises(InputError, match="was changed after the capture began"), resume(tmp_path):
        pass


def test_journal_with_a_torn_tail_resumes(finished: Path, tmp_path: Path) -> None:
    """Whatever byte the power cut stopped at, the journal tells a consistent story."""
    whole = (finished / JOURNAL_NAME).read_bytes()
    for length in np.linspace(400, len(whole) - 1, 40).astype(int):
        (tmp_path / JOURNAL_NAME).write_bytes(whole[:length])
        LogWriter(tmp_path / JOURNAL_NAME).close()
        try:
            state = replayed(read_journal(tmp_path))
        except InputError:
            continue
        assert all(a.number <= state.attempts[p] for p, a in state.accepted.items())
