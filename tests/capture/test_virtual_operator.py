"""The operator of the virtual head follows the journal of a capture."""

import shutil

from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.operator import Follower
from tumblecal.capture.journal import Journal


def test_a_turn_is_repeated_if_no_recording_begins_and_a_new_journal_is_taken_up(tmp_path, monkeypatch):
    config, run = Emulation.model_validate({"head": {"reaction_s": 1, "turn_s": 2}}), tmp_path / "run"
    device, follower, turns, turn = VirtualDevice(config), Follower(run, config), [], None

    def noted(alpha_deg: float, beta_deg: float, now_s: float) -> None:
        turns.append((round(now_s), alpha_deg, beta_deg))
        turn(alpha_deg, beta_deg, now_s)

    turn = device.head.turn
    monkeypatch.setattr(device.head, "turn", noted)

    def follow(seconds: int) -> None:
        for _ in range(seconds):
            device.advance(round(config.instrument.rate_hz))
            assert follower(device)

    for alpha in (45.0, 60.0):
        run.mkdir()
        journal = Journal(run)
        journal.write("session")
        journal.write("prompted", position=0, name="a", alpha_deg=alpha, beta_deg=90.0, log_position=0)
        begun = round(device.time_s)
        follow(130)
        assert turns == [(begun + second, alpha, 90.0) for second in (2, 62, 122)]
        journal.write("recording", position=0, attempt=1, log_position=0)
        follow(70)
        assert len(turns) == 3
        turns.clear()
        journal.close()
        shutil.rmtree(run)
    follower.close()
