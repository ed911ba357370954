"""Another instrument, the same one that does not answer, and one that answers late: after an unplug and on resuming."""

import contextlib
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bench import CaptureProcess, Emulator

from tumblecal.capture.decoding.samples import Event
from tumblecal.capture.journal import read_journal, replayed
from tumblecal.capture.run.identity import WAITS_S, Answer, Identity
from tumblecal.capture.run.instrument_doubt import LEAST_P, compare, mean_variance
from tumblecal.capture.run.stationarity import BlockCutter
from tumblecal.data import read_positions
from tumblecal.ground.errors import InputError
from tumblecal.recordings.reduction.reduce import reduce
from tumblecal.recordings.reduction.reduction import write_reduction


PLAN = """
[port]
url = "imu"
speed = 20.0
range_g = 10.0
[positions]
beta_deg = [0]
alpha_deg = [0, 90, 180, 270]
[dwell]
seconds = 8.0
settle_s = 1.0
"""
QUESTIONS = "0.2 0.3 0.4"


def emulator(*, answers: bool = True, gravity_ms2: float = 9.80665) -> str:
    """A STIM300 whose head follows the capture; a wrong gravity is an error of all its scale factors."""
    return (
        f"[instrument]\nanswers = {str(answers).lower()}\n[site]\ngravity_ms2 = {gravity_ms2}\n"
        "[head]\nturn_s = 0.5\nreaction_s = 0.2\n"
    )


def accepted(folder: Path, count: int) -> Callable[[], bool]:
    def seen() -> bool:
        with contextlib.suppress(InputError):  # not begun yet
            return sum(entry["entry"] == "accepted" for entry in read_journal(folder)) >= count
        return False

    return seen


@pytest.mark.long
def test_an_instrument_that_does_not_answer_is_compared_and_another_one_stops_the_run(tmp_path: Path) -> None:
    """Unplugged twice: first the same instrument comes back, then one with scale factors 0.4e-3 larger; neither answers."""
    (tmp_path / "plan.toml").write_text(PLAN)
    run, words = tmp_path / "run", ("--plain", "--yes")
    with Emulator(tmp_path, emulator(), follow="run"):
        capture = CaptureProcess(tmp_path, "plan.toml", "--out", "run", *words, questions=QUESTIONS)
        capture.wait_for(accepted(run, 1))
    with Emulator(tmp_path, emulator(answers=False), follow="run"):
        capture.wait_for(accepted(run, 2))
    with Emulator(tmp_path, emulator(answers=False, gravity_ms2=9.80665 + 0.004), follow="run"):
        assert capture.close() == 2
        fault = next(line for line in capture.seen if line.startswith("FAULT"))
        assert re.search(r"position 2 measured again differs: largest difference \+0\.4\d\d mg in y", fault), fault
        assert any("identity not confirmed" in line for line in capture.seen)
        entries = read_journal(run)
        kinds = [entry["entry"] for entry in entries]
        assert kinds.count("identity_not_confirmed") == 2 and kinds.count("accepted") == 2
        assert [entry["agrees"] for entry in entries if entry["entry"] == "compared"] == [True, False]

        # The operator may vouch for it; what follows is not written as the first one's.
        capture = CaptureProcess(tmp_path, "--resume", "run", *words, "--trust-instrument", questions=QUESTIONS)
        assert capture.close() == 0, capture.seen[-9:]
    serials = [attempt.serial_number for _, attempt in sorted(replayed(read_journal(run)).accepted.items())]
    assert serials == ["N25581846020020", None, None, None]
    reduction = reduce(run)
    write_reduction(reduction, run)
    comments = read_positions(run / "positions.csv").comments
    assert "serial_number" not in comments and comments["serial_number_not_confirmed"] == "N25581846020020"
    assert comments["identity_not_confirmed"].startswith("position 2, 3, 4: identity not confirmed: no serial number")
    assert reduction.entries["identity"]["positions_not_confirmed"] == ["2", "3", "4"]


def test_questions_are_bounded_and_grow_and_a_late_answer_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    now, sent = [0.0], []
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    identity = Identity(lambda query: sent.append(now[0]), (b"I\r",), "N1", "aa", confirmed=True)
    identity.interrupted()
    while identity.look([]) == Answer.ASKED:
        now[0] += 0.01
    np.testing.assert_allclose(sent, np.concatenate([[0], np.cumsum(WAITS_S)[:-1]]), atol=0.1)
    assert identity.answer == Answer.NONE and identity.tries == len(WAITS_S) and (np.diff(WAITS_S) > 0).all()
    assert identity.look([Event(0, "serial_number", {"serial_number": "N1"})]) == Answer.CONFIRMED
    assert identity.look([Event(0, "configuration", {"raw": "aa"})]) == Answer.CONFIRMED
    assert identity.look([Event(0, "configuration", {"raw": "bb"})]) == Answer.OTHER_SETTINGS
    assert identity.look([Event(0, "serial_number", {"serial_number": "N2"})]) == Answer.OTHER


def test_the_comparison_keeps_its_level_in_white_and_slow_noise_and_finds_ten_sd() -> None:
    rng = np.random.default_rng(0)
    disagree = {"white": 0, "slow": 0, "other": 0}
    for kind in disagree:
        for _ in range(60):
            means, variances, blocks = [], [], []
            for dwell in range(2):
                slow = rng.normal(size=(60, 3)).cumsum(0) * 2e-6 if kind == "slow" else np.zeros((60, 3))
                samples = 2e-4 * rng.normal(size=(1500, 3)) + np.repeat(slow, 25, axis=0) + [0.0, 0.6, 0.8]
                samples += 1e-4 * (kind == "other") * dwell
                blocks = BlockCutter(25).add(samples)
                means.append(samples.mean(0))
                variances.append(mean_variance(blocks))
            disagree[kind] += not compare(means[0], variances[0], blocks).agrees
    assert disagree["white"] == 0 and disagree["slow"] == 0 and LEAST_P < 1e-5
    assert disagree["other"] == 60
