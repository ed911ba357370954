"""The operator of the virtual head repeats a turn that a capture did not see."""

from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.operator import Follower
from tumblecal.capture.journal import Journal


def test_a_turn_is_repeated_if_no_recording_begins(tmp_path, monkeypatch):
    config = Emulation.model_validate({"head": {"reaction_s": 1, "turn_s": 2}})
    device, follower, journal = VirtualDevice(config), Follower(tmp_path, config), Journal(tmp_path)
    turns: list[tuple[int, float, float]] = []
    turn = device.head.turn

    def noted(alpha_deg: float, beta_deg: float, now_s: float) -> None:
        turns.append((round(now_s), alpha_deg, beta_deg))
        turn(alpha_deg, beta_deg, now_s)

    monkeypatch.setattr(device.head, "turn", noted)

    def follow(seconds: int) -> None:
        for _ in range(seconds):
            device.advance(round(config.instrument.rate_hz))
            assert follower(device)

    journal.write("prompted", position=0, name="a", alpha_deg=45.0, beta_deg=90.0, log_position=0)
    follow(130)
    assert turns == [(2, 45.0, 90.0), (62, 45.0, 90.0)]
    journal.write("recording", position=0, attempt=1, log_position=0)
    follow(70)
    assert len(turns) == 2
    journal.close()
    assert follower._reader is not None
    follower._reader.close()
