"""The virtual instrument: what it sends is what a device on a dividing head would send, and its ledger is right."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.samples import Decoded, Status
from tumblecal.capture.emulator import instrument
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.instrument import VirtualInstrument
from tumblecal.capture.emulator.operator import Typist
from tumblecal.capture.protocols import protocols
from tumblecal.ground.frames import gravity_in_head
from tumblecal.noise.allan import overlapping_allan


def sent(device: VirtualDevice, seconds: float) -> Decoded:
    rate = device.config.instrument.rate_hz
    decoder = device.protocol.decoder(replace(device.settings, whole=True))
    return decode_all(decoder, device.advance(round(seconds * rate)))


@pytest.mark.parametrize("name", sorted(protocols()))
def test_every_protocol_shows_the_position(name: str) -> None:
    content = {"instrument": {"protocol": name, "range_g": 10.0 if name == "stim300" else 16.0, "start_up_s": 0.0}}
    device = VirtualDevice(Emulation.model_validate({**content, "head": {"alpha_deg": 30.0, "beta_deg": 20.0}}))
    found = sent(device, 4.0)
    assert len(found.samples) == 500 and found.counts.discarded == 0
    np.testing.assert_allclose(
        found.samples.force.mean(0), gravity_in_head(np.radians(30.0), np.radians(20.0)), atol=4e-4
    )


@pytest.mark.parametrize("part", ["flicker_g", "markov_sd_g", "walk_g_per_rts"])
def test_its_noise_is_that_of_the_parts(part: str) -> None:
    """Allan deviation of what is sent against the closed form, one part beside white noise."""
    content = {"instrument": {"start_up_s": 0.0}, "noise": {part: 2e-4, "markov_time_s": 2.0, "seed": 5}}
    config = Emulation.model_validate(content)
    force = sent(VirtualDevice(config), 60.0).samples.force
    tau = np.array([0.08, 0.4, 2.0])
    for axis in range(3):
        found = overlapping_allan([force[:, axis]], 125.0, np.rint(tau * 125).astype(int))
        expected = config.noise.model.allan_deviation(tau)[:, axis]
        np.testing.assert_array_less(np.abs(found.deviation / expected - 1), 4 / np.sqrt(2 * found.dof) + 0.02)


def test_faults_and_their_ledger() -> None:
    faults = {"missing_frames_per_s": 2.0, "overloads_per_s": 1.0}
    device = VirtualDevice(Emulation.model_validate({"faults": faults, "instrument": {"start_up_s": 0.3}}))
    found = sent(device, 60.0)
    ledger = device.ledger
    assert len(found.samples) == ledger.intact == ledger.generated - ledger.missing and ledger.missing > 80
    assert int((found.samples.status & Status.OVERLOAD > 0).sum()) <= ledger.overloads
    device.restart()
    again = sent(device, 1.0)
    assert {e.kind for e in again.events} == {"part_number", "serial_number", "configuration"}
    assert again.samples.counter[0] < 256 and (again.samples.status & Status.STARTING).any()


class Clock:
    """A clock that goes on by itself never: only who sleeps lets time pass."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_a_late_emulator_drifts_with_the_clock_and_says_so(tmp_path: Path, monkeypatch) -> None:
    """A computer too slow for the speed: what drifts has gone on meanwhile, and the ledger tells how late it was."""
    speed, asked, clock = 20.0, [], Clock()
    monkeypatch.setattr(instrument, "time", clock)

    def truth_with_a_pause(alpha: float, beta: float, time_s: float, temperature: float) -> np.ndarray:
        asked.append((time_s, (clock.now - 100.0) * speed))
        clock.sleep(0.6 if len(asked) == 2 else 0.0)
        return np.array([0.0, 0.0, 1.0])

    device = VirtualDevice(Emulation(), truth_with_a_pause)
    VirtualInstrument(device, tmp_path / "imu", speed, ledger=tmp_path / "ledger.json").run(30.0)
    # The pause is 12 s of the device's time, in which two refreshes would have been due.
    emulated, passed = np.array(asked[2:]).T
    assert np.abs(emulated - passed).max() < 2.0, asked
    ledger = json.loads((tmp_path / "ledger.json").read_text())
    assert ledger["longest_behind_s"] > 5.0 and "fell behind by up to" in ledger["warning"]
    device = VirtualDevice(Emulation())
    device.advance(1000)
    assert device.ledger.as_dict()["warning"] == ""


def test_typed_commands_act_on_the_head_and_the_chamber(monkeypatch, capsys) -> None:
    device, typist = VirtualDevice(Emulation.model_validate({"instrument": {"start_up_s": 0.0}})), Typist()
    end, start = os.pipe()
    with open(end) as terminal, open(start, "wb", buffering=0) as keys:
        monkeypatch.setattr("sys.stdin", terminal)
        keys.write(b"45 3")
        assert typist(device) and not capsys.readouterr().out  # the line is not complete
        keys.write(b"0\nchamber 40\nturn left\n")
        assert typist(device)
        printed = capsys.readouterr().out.splitlines()
        assert printed[:2] == ["turning to alpha 45, beta 30", "chamber set to 40 degC"]
        assert "type ALPHA BETA" in printed[2]
        device.advance(125 * 60)
        assert tuple(device.angles()) == (45.0, 30.0)
        keys.write(b"restart\nknock\nq\n")
        assert not typist(device)
