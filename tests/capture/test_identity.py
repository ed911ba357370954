"""Another instrument, the same one that does not answer, and one that answers late: after an unplug and on resuming."""

import contextlib
import json
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench import CaptureProcess, Emulator

from tumblecal.capture.decoding.samples import Event
from tumblecal.capture.journal import Journal, read_journal, replayed
from tumblecal.capture.protocols import protocol
from tumblecal.capture.run.contact import WAITS_S, Contact
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.data import read_positions
from tumblecal.ground.errors import InputError
from tumblecal.recordings.reduce import reduced
from tumblecal.recordings.reduction import write_reduction


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


def emulator(number: str, answers: bool = True) -> str:
    """A STIM300 whose head follows the capture."""
    instrument = f'[instrument]\nserial_number = "{number}"\nanswers = {str(answers).lower()}\n'
    return f"{instrument}[head]\nturn_s = 0.5\nreaction_s = 0.2\n"


@pytest.mark.long
def test_an_instrument_that_does_not_answer_is_confirmed_and_another_one_stops_the_run(tmp_path):
    """Unplugged twice: first the same instrument comes back without an answer, then another one."""
    (tmp_path / "plan.toml").write_text(PLAN)
    run, words = tmp_path / "run", ("--plain", "--yes")

    def kinds() -> list[str]:
        with contextlib.suppress(InputError):  # not begun yet
            return [entry["entry"] for entry in read_journal(run)]
        return []

    with Emulator(tmp_path, emulator("N25581846020020"), follow="run"):
        capture = CaptureProcess(tmp_path, "plan.toml", "--out", "run", *words, questions="0.2 0.3 0.4")
        capture.wait_for(lambda: "accepted" in kinds())
    with Emulator(tmp_path, emulator("N25581846020020", answers=False), follow="run"):
        # On a slow machine the line may be interrupted more than once.
        for number in range(9):
            capture.wait_for(
                lambda n=number: kinds().count("identity_not_confirmed") > n or kinds().count("accepted") == 2
            )
            if kinds().count("accepted") == 2:
                break
            assert kinds().count("accepted") == 1
            capture.wait_for(lambda: any("press Enter if it is the same one" in line for line in capture.seen))
            capture.press("\n")
    with Emulator(tmp_path, emulator("N25581846020021"), follow="run"):
        assert capture.close() == 2
        fault = next(line for line in capture.seen if line.startswith("FAULT"))
        assert "this run began with serial number N25581846020020, but N25581846020021 is connected" in fault
    # The operator may vouch for it; what follows is not written as the first one's.
    with Emulator(tmp_path, emulator("N25581846020020", answers=False), follow="run"):
        capture = CaptureProcess(tmp_path, "--resume", "run", *words, "--trust-instrument", questions="0.2 0.3 0.4")
        assert capture.close() == 0, capture.seen[-9:]
    serials = [attempt.serial_number for _, attempt in sorted(replayed(read_journal(run)).accepted.items())]
    assert serials == ["N25581846020020", None, None, None]
    write_reduction(reduced([run]), run)
    comments = read_positions(run / "positions.csv").comments
    assert "serial_number" not in comments and comments["serial_number_not_confirmed"] == "N25581846020020"
    assert comments["identity_not_confirmed"].startswith("position 2, 3, 4: identity not confirmed: no serial number")
    identity = json.loads((run / "reduction.json").read_text())["identity"]
    assert identity["positions_not_confirmed"] == ["2", "3", "4"]


def test_questions_are_bounded_and_grow_and_a_late_answer_counts(tmp_path, monkeypatch):
    now, sent = [0.0], []
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    journal = Journal(tmp_path)
    journal.write("device", serial_number="N1", events=[{"kind": "configuration", "raw": "aa"}])
    journal.write("accepted", position=0, attempt=1, log_start=0, log_stop=1, sha256="", summary={})
    plan = SimpleNamespace(port=SimpleNamespace(speed=1.0))
    recording = SimpleNamespace(send=lambda query: sent.append(now[0]))
    stream = SimpleNamespace(recording=recording, protocol=replace(protocol("stim300"), queries=(b"I\r",)))
    identity = Contact(RunFolder(tmp_path, plan, journal), stream)  # type: ignore[arg-type]
    identity.interrupted({"event": "reopened"})
    while not identity.hear([], 1):
        now[0] += 0.01
    np.testing.assert_allclose(sent, np.concatenate([[0], np.cumsum(WAITS_S)[:-1]]), atol=0.1)
    assert (np.diff(WAITS_S) > 0).all() and identity.doubted and not identity.asking
    assert not identity.hear([Event(0, "serial_number", {"serial_number": "N1"})], 1) and not identity.doubted
    with pytest.raises(InputError, match="began with other settings of the instrument"):
        identity.hear([Event(0, "configuration", {"raw": "bb"})], 1)
    with pytest.raises(InputError, match="N2 is connected"):
        identity.hear([Event(0, "serial_number", {"serial_number": "N2"})], 1)
    journal.close()


def test_an_older_run_that_was_to_compare_its_instrument_is_to_be_confirmed():
    accepted = dict(entry="accepted", position=0, attempt=1, log_start=0, log_stop=1, sha256="", summary={})
    entries = [accepted | {"wall_ns": 1}, {"entry": "identity_not_confirmed"}]
    assert replayed(entries).to_confirm
    assert not replayed([*entries, {"entry": "compared", "agrees": True}]).to_confirm
    assert replayed([*entries, {"entry": "compared", "agrees": False}]).to_confirm
    assert not replayed([*entries, {"entry": "device", "serial_number": "N1"}]).to_confirm
