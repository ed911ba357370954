"""The recorder process against a virtual port: unplugged, killed, silent, somebody else's, out of disk."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from disk import file_size_limited
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.losses import count_losses
from tumblecal.capture.decoding.samples import Samples, Settings
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.instrument import VirtualInstrument
from tumblecal.capture.log import RecordKind, read_log
from tumblecal.capture.port.live import Recording
from tumblecal.capture.port.transport import Port
from tumblecal.capture.protocols import protocol
from tumblecal.ground.errors import InputError


def sequence_rates(numbers: np.ndarray) -> np.ndarray:
    """Sample numbers hidden in the angular rates, so that the truth travels with the data."""
    return np.stack([numbers // 4096, numbers % 4096, np.zeros(len(numbers))], axis=1) / 2**14


def sequence_of(samples: Samples) -> np.ndarray:
    words = np.rint(samples.rate * 2**14).astype(np.int64)
    return words[:, 0] * 4096 + words[:, 1]


class Traced(VirtualDevice):
    """A device whose samples have their numbers, and whose line damages bytes at a rate, 1/s."""

    damages_per_s = 0.0

    def samples(self, n: int) -> Samples:
        made = super().samples(n)
        made.rate[:] = sequence_rates(self.ledger.generated + np.arange(n))
        return made

    def advance(self, n: int) -> bytes:
        data, random = bytearray(super().advance(n)), self._random
        if len(data) and random.random() < self.damages_per_s * n / self.rate_hz:
            at = int(random.integers(len(data)))
            match int(random.integers(3)):
                case 0:
                    data[at] ^= 1 << int(random.integers(8))
                case 1:
                    del data[at]
                case _:
                    data[at:at] = random.bytes(30)
        return bytes(data)


class Rig:
    """A virtual instrument stepped by hand in this process; its time passes `speed` times as fast as that of the host."""

    def __init__(self, folder: Path, speed: float = 1.0, **config: object):
        content = {"instrument": {"rate_hz": 2000.0}, **config}
        self.instrument = VirtualInstrument(Traced(Emulation.model_validate(content)), folder / "imu")
        self.start, self.rate_hz = time.monotonic(), 2000 * speed

    def run(self, seconds: float) -> None:
        stop = time.monotonic() + seconds
        self.run_until(lambda: time.monotonic() >= stop)

    def run_until(self, reached: Callable[[], bool]) -> None:
        while not reached():
            due = int((time.monotonic() - self.start) * self.rate_hz)
            self.instrument.step(due - self.instrument.device.ledger.generated)
            time.sleep(0.003)


def decoded(log: Path) -> tuple[Samples, np.ndarray, int]:
    records = [r for r in read_log(log) if r.kind == RecordKind.BYTES]
    found = decode_all(protocol("stim300").decoder(Settings((10.0,) * 3)), b"".join(r.payload for r in records))
    stops = np.cumsum([len(r.payload) for r in records])
    stamps = np.array([r.stamp_ns for r in records]) * 1e-9
    return found.samples, stamps[np.searchsorted(stops, found.samples.stop)], found.counts.discarded


def events(log: Path) -> list[dict]:
    return [r.content() for r in read_log(log) if r.kind == RecordKind.EVENT]


def test_unplugs_and_damage_are_counted_exactly(tmp_path: Path) -> None:
    """2000 Hz, two unplugs, flips, lost bytes, missing frames, stalls: the losses are the truth's, to the sample.

    The device runs at half speed: a counter that wraps every 0.26 s, instead of 0.13 s, tolerates late reads of a busy host.
    """
    faults = {
        "missing_frames_per_s": 3.0,
        "stalls_per_s": 0.5,
        "unplug_at_s": [1.5, 3.0],
        "unplug_for_s": 0.4,
    }
    rig = Rig(tmp_path, speed=0.5, faults=faults)
    log = tmp_path / "raw.log"
    recording = Recording(log, str(tmp_path / "imu"), 921600)
    # Quiet seconds at both ends: without them a stall there would rightly be called unresolved.
    faulty, quiet = rig.instrument.faults, Emulation().faults
    rig.instrument.device.damages_per_s = 6.0
    reopened = list[int]()

    def plugged_twice() -> bool:
        notices = [record.content() for record in recording.poll() if record.kind == RecordKind.EVENT]
        reopened.extend(rig.instrument.device.ledger.generated for notice in notices if notice["event"] == "reopened")
        # One and a half seconds of the device follow the second one.
        return len(reopened) == 2 and rig.instrument.device.ledger.generated > reopened[-1] + 3000

    rig.instrument.faults = quiet
    rig.run(1.0)
    rig.instrument.faults = faulty
    rig.run_until(plugged_twice)
    rig.instrument.faults = quiet
    rig.run(2.5)
    recording.stop()
    rig.instrument.port.unplug()
    samples, host_s, _ = decoded(log)
    numbers = sequence_of(samples)
    assert (np.diff(numbers) > 0).all()
    truth = numbers[-1] - numbers[0] + 1 - len(numbers)
    found = count_losses(samples, host_s, 256, 1)
    assert found.lost == truth > 1000
    assert found.unresolved == 0
    assert [e["event"] for e in events(log)].count("reopened") == 2


@pytest.mark.parametrize("kills", [1, pytest.param(10, marks=pytest.mark.long)])
def test_kills_lose_nothing_acknowledged_and_the_recorder_is_started_again(tmp_path: Path, kills: int) -> None:
    """kill -9 at random moments: every log reopens, what was said to be on the disk is there, nothing twice."""
    rig, random = Rig(tmp_path), np.random.default_rng(0)
    log = tmp_path / "raw.log"
    for _ in range(kills):
        recording = Recording(log, str(tmp_path / "imu"), 921600)
        rig.run(float(random.uniform(0.05, 0.6)))
        recording.poll()
        recording.sync()
        acknowledged = recording.position
        os.kill(recording.pid, signal.SIGKILL)
        recording.stop()
        with open(log, "ab") as file:
            file.write(os.urandom(int(random.integers(0, 40))))
        assert log.stat().st_size >= acknowledged
    # Killed while it records, it is started again, as long as the new process takes to start.
    recording = Recording(log, str(tmp_path / "imu"), 921600)
    rig.run(0.3)
    os.kill(recording.pid, signal.SIGKILL)
    rig.run(0.2)
    recording.poll()
    rig.run_until(lambda: any(record.kind == RecordKind.BYTES for record in recording.poll()))
    assert recording.restarts == 1
    # Then nothing comes for a while.
    time.sleep(1.3)
    rig.run(0.3)
    recording.stop()
    rig.instrument.port.unplug()
    samples, _, _ = decoded(log)
    assert (np.diff(sequence_of(samples)) > 0).all() and len(samples) > 200 * kills
    kinds = [event["event"] for event in events(log)]
    assert kinds.count("started") == kills + 2
    assert "data_again" in kinds[kinds.index("silence") :]


def test_the_recorder_ends_when_its_parent_is_gone(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    command = [
        sys.executable,
        "-m",
        "tumblecal.capture.port.recorder",
        str(tmp_path / "raw.log"),
        str(tmp_path / "imu"),
        "9600",
    ]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    rig.run(0.7)
    assert process.stdin is not None and process.stdout is not None
    process.stdin.close()
    assert process.wait(600) == 0
    process.stdout.close()
    assert events(tmp_path / "raw.log")[-1]["event"] == "stopped"
    rig.instrument.port.unplug()


def test_what_is_no_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    def refuse(self: serial.Serial) -> None:
        raise serial.SerialException(13, "could not open port: [Errno 13] Permission denied")

    with pytest.raises(InputError, match="there is no such device"):
        Recording(tmp_path / "raw.log", str(tmp_path / "ttyNONE"), 9600)
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="not a serial device"):
        Port(str(tmp_path / "file"), 9600)
    with pytest.raises(InputError, match=r"port socket://127.0.0.1:1: cannot be opened \("):
        Port("socket://127.0.0.1:1", 9600)
    rig = Rig(tmp_path)
    monkeypatch.setattr(serial.Serial, "open", refuse)
    with pytest.raises(InputError, match=r"no permission; the device belongs to the group \S+: `sudo usermod -aG"):
        Port(str(tmp_path / "imu"), 9600)
    rig.instrument.port.unplug()


HOLD = """
import os, sys
from tumblecal.capture.port.transport import Port
master, slave = os.openpty()
other_end = os.open(os.ttyname(slave), os.O_RDWR | os.O_NOCTTY)
if os.fork() == 0:
    held = Port(os.ttyname(slave), 9600)
    print(os.getpid(), os.ttyname(slave), flush=True)
    sys.stdin.read()
    os._exit(0)
os.close(other_end)
os.wait()
"""


def test_holder_is_who_locked_the_port(tmp_path: Path) -> None:
    """The other end of a virtual port has it open as well; it is not the one to end."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdin is not None and process.stdout is not None
    holder, url = process.stdout.readline().split()
    with pytest.raises(InputError, match=rf"in use by \S+ \(process {holder}\)"):
        Port(url, 9600)
    process.stdin.close()
    process.stdout.close()
    assert process.wait(600) == 0


def test_full_disk_stops_cleanly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorder's file may not grow beyond 200 kB: it says so, and all records are whole."""
    rig = Rig(tmp_path)
    launch = subprocess.Popen

    def limited(*arguments: object, **options: object):
        with file_size_limited(200_000):
            return launch(*arguments, **options)

    monkeypatch.setattr(subprocess, "Popen", limited)
    recording = Recording(tmp_path / "raw.log", str(tmp_path / "imu"), 921600)
    with pytest.raises(InputError, match="disk is full; recording stopped"):
        for _ in range(1000):
            rig.run(0.2)
            recording.poll()
    recording.stop()
    rig.instrument.port.unplug()
    records = read_log(tmp_path / "raw.log")
    assert records[-1].stop == (tmp_path / "raw.log").stat().st_size > 190_000


def test_clock_jump_is_told_and_the_stamps_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    from tumblecal.capture.port import recorder

    told: list[tuple[str, dict]] = []
    worker = recorder.Recorder.__new__(recorder.Recorder)
    before = {"monotonic_ns": 10_000_000_000, "wall_ns": 5_000_000_000, "boot_ns": 10_000_000_000}
    worker._anchor = before
    monkeypatch.setattr(worker, "event", lambda what, **content: told.append((what, content)), raising=False)
    now = {"monotonic_ns": 11_000_000_000, "wall_ns": 3_606_000_000_000, "boot_ns": 11_000_000_000}
    monkeypatch.setattr(recorder, "clocks", lambda: now)
    worker._watch_clocks()
    assert told[0][0] == "clock_jump" and told[0][1]["seconds"] == pytest.approx(3600.0)
    monkeypatch.setattr(
        recorder, "clocks", lambda: {k: v + 60_000_000_000 * (k != "monotonic_ns") for k, v in now.items()}
    )
    worker._watch_clocks()
    assert told[1][0] == "suspended" and told[1][1]["seconds"] == pytest.approx(60.0)
