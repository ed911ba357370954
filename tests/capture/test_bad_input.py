"""What a user gets wrong: each is one clear line, before anything is spoiled."""

from contextlib import closing
from pathlib import Path

import pytest
from streams import some_samples
from test_recorder import Rig

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.decoding.samples import Settings
from tumblecal.capture.decoding.sniff import guesses
from tumblecal.capture.journal import Journal
from tumblecal.capture.port.live import LiveStream, Recording
from tumblecal.capture.protocols import protocol, protocols
from tumblecal.capture.run import contact
from tumblecal.capture.run.run_folder import RunFolder, begin
from tumblecal.ground.errors import InputError


GOOD = '[port]\nurl = "imu"\n[positions]\nalpha_deg = [0, 90]\nbeta_deg = [0]\n'


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        (
            '[port]\nbaud = "fast"\ncolour = 1\n[positions]\nalpha_deg = [0, "x"]\n[dwell]\nseconds = -1\n',
            ("port.baud", "port.colour: unknown key", "positions.alpha_deg.1", "dwell.seconds"),
        ),
        (GOOD + "[[positions.listed]]\nalpha_deg = 1\nbeta_deg = 2\n", ("give either alpha_deg and beta_deg",)),
        (
            f'[port]\nurl = "imu"\n[positions]\nalpha_deg = {[*range(360)]}\nbeta_deg = {[*range(180)]}\n',
            ("64800 positions; give at most 5000",),
        ),
        (
            "[instrument]\nrate_hz = 125\n",
            ("the description of a virtual instrument for tumblecal emulate (it has instrument)",),
        ),
    ],
)
def test_all_faults_of_a_plan_are_told_at_once(tmp_path: Path, text: str, faults: tuple[str, ...]) -> None:
    (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(InputError) as error, begin(tmp_path / "plan.toml", tmp_path / "out"):
        pass
    assert all(any(words in fault for fault in error.value.faults) for words in faults), error.value.faults
    assert not (tmp_path / "out").exists()


def meet_a(rig: Rig, tmp_path: Path, name: str, feed: float = 0.0) -> None:
    plan = CapturePlan.model_validate(
        {
            "port": {"url": str(tmp_path / "imu"), "protocol": name},
            "positions": {"listed": [{"alpha_deg": 0, "beta_deg": 0}]},
        }
    )
    recording = Recording(tmp_path / "raw.log", str(tmp_path / "imu"), 921600)
    stream = LiveStream(recording, protocol(name), Settings())
    try:
        if feed:
            rig.run(feed)
        with closing(Journal(tmp_path)) as journal:
            contact.Contact(RunFolder(tmp_path, plan, journal), stream).meet()
    finally:
        recording.stop()
        rig.instrument.port.unplug()


def test_silence_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no bytes in 4 s: check power, cable and baud rate"):
        meet_a(Rig(tmp_path), tmp_path, "stim300")


def test_wrong_protocol_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the device sends stim300, not xsens"):
        meet_a(Rig(tmp_path), tmp_path, "xsens", feed=0.5)


def test_a_device_that_does_not_tell_its_range(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples come, but the command line to the device is broken: the range is not assumed."""
    monkeypatch.setattr(contact, "WAITS_S", (0.5, 0.7))
    rig = Rig(tmp_path)
    rig.instrument.device.command = lambda data: None  # type: ignore[method-assign]
    with pytest.raises(InputError, match="does not state its range when asked"):
        meet_a(rig, tmp_path, "stim300", feed=0.5)


@pytest.mark.parametrize("name", sorted(protocols()))
def test_sniffing(name: str) -> None:
    how = protocol(name)
    settings = how.settings(how.ranges_g[-1] if how.ranges_g else None, 125.0)
    data = how.encode(some_samples(120), settings)[13:]
    best = guesses(data)[0]
    assert best.name == name and best.explained > 0.95


def test_a_folder_that_holds_a_capture_is_kept(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(GOOD)
    with begin(tmp_path / "plan.toml", tmp_path / "out") as run:
        run.journal.write("device", serial_number="N1", events=[], log_position=0)
    with pytest.raises(InputError, match="contains a capture already"), begin(tmp_path / "plan.toml", tmp_path / "out"):
        pass
