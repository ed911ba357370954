"""The capture: losses of a long recording, and processor time of a guided run.

python benchmarks/capture_bench.py losses    half an hour at 2000 Hz with faults: every loss is counted
python benchmarks/capture_bench.py live      a guided capture at 2000 Hz: processor time of recorder and guide
"""

import argparse
import contextlib
import fcntl
import json
import os
import pty
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tumblecal.capture.decoding.framing import FrameDecoder
from tumblecal.capture.decoding.losses import count_losses
from tumblecal.capture.decoding.samples import Counts, Settings
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.instrument import VirtualInstrument
from tumblecal.capture.journal import read_journal
from tumblecal.capture.log import LogReader, RecordKind
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols.stim300 import Stim300Framing
from tumblecal.ground.errors import InputError


SETTINGS = Settings((10.0,) * 3, "acceleration", 2000.0)
RATE_HZ = 2000.0
PLAN = """
[port]
url = "imu"
[positions]
listed = [{{ alpha_deg = 0, beta_deg = 0 }}]
[dwell]
seconds = {seconds}
settle_s = 2.0
"""
GUIDE = (
    "from pathlib import Path; from tumblecal.cli.capture import capture; capture(Path('plan.toml'), out=Path('run'))"
)


def decoder() -> FrameDecoder:
    """A decoder of STIM300 frames."""
    return FrameDecoder(Stim300Framing(SETTINGS))


def sequence_rates(numbers: np.ndarray) -> np.ndarray:
    """Sample numbers hidden in the angular rates: the truth is in the data."""
    return np.stack([numbers // 65536 - 100.0, numbers % 65536, 0 * numbers], axis=1) / 2**14


def sequence_of(rates: np.ndarray) -> np.ndarray:
    """The numbers hidden in angular rates."""
    hidden = np.rint(rates[:, :2] * 2**14).astype(np.int64)
    return (hidden[:, 0] + 100) * 65536 + hidden[:, 1]


def instrument(link: str, seconds: float, speed: float, faulty: bool) -> None:
    """A virtual device at 2000 Hz, with stalls, losses and unplugging."""
    random, quiet = np.random.default_rng(5), 4 * speed
    faults = {
        "bit_flips_per_s": 2.0,
        "lost_bytes_per_s": 1.0,
        "garbage_per_s": 0.5,
        "missing_frames_per_s": 2.0,
        "stalls_per_s": 0.02,
        "unplug_at_s": sorted(random.uniform(quiet, max(seconds - 2 * quiet, quiet), int(seconds // 100)).tolist()),
        "unplug_for_s": 1.2,
    }
    config = Emulation.model_validate({"instrument": {"rate_hz": RATE_HZ}} | ({"faults": faults} if faulty else {}))
    device = VirtualDevice(config, rates=sequence_rates)
    VirtualInstrument(device, Path(link), speed, ledger=Path(link + ".json")).run(seconds)


def started(link: Path, *arguments: object):
    """The virtual device in a process of its own."""
    process = get_context("spawn").Process(target=instrument, args=(str(link), *arguments), daemon=True)
    process.start()
    while not link.exists():
        time.sleep(0.01)
    return process


def cpu_s(pid: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def losses(asked: argparse.Namespace) -> None:
    """Faster than real, through a pseudo-terminal."""
    folder, seconds = Path(tempfile.mkdtemp(prefix="tumblecal-losses-")), asked.minutes * 60
    link, log = folder / "imu", folder / "raw.log"
    process = started(link, seconds, asked.speed, True)
    recording = Recording(log, str(link), 921600)
    process.join()
    cpu = cpu_s(recording.pid)
    time.sleep(0.5)
    recording.stop()
    stream, counts, reopened, total = decoder(), Counts(), 0, 0
    counters, rates, stamps, stops, times = [], [], [], [], []
    with LogReader(log) as reader:
        for record in reader.records():
            if record.kind != RecordKind.BYTES:
                reopened += record.content()["event"] == "reopened"
                continue
            total += len(record.payload)
            stops.append(total)
            times.append(record.stamp_ns * 1e-9)
            found = stream.feed(record.payload)
            counts.add(found.counts)
            stamps.append(np.array(times)[np.searchsorted(stops, found.samples.stop)])
            counters.append(found.samples.counter)
            rates.append(found.samples.rate)
            # A frame may end some records later.
            del stops[:-50], times[:-50]
    numbers = sequence_of(np.concatenate(rates))
    counted = count_losses(np.concatenate(counters), np.concatenate(stamps), 256, 1)
    ledger, steps = json.loads(Path(f"{link}.json").read_text()), np.diff(numbers)
    gaps = {int(i): int(steps[i] - 1) for i in np.flatnonzero(steps > 1)}
    print(f"{asked.minutes:g} minutes at 2000 Hz, {asked.speed:g} times faster than real; {reopened} unplugs")
    print(f"device made {ledger['generated']}, {ledger['stalls']} stalls, at most {ledger['latest_ms']:.0f} ms late")
    print(
        f"log {log.stat().st_size / 1e6:.0f} MB; arrived {len(numbers)}, out of order or twice {int((steps <= 0).sum())}"
    )
    truth = int(numbers[-1] - numbers[0] + 1 - len(numbers))
    print(f"lost: truth {truth}, counted {counted.lost}, unresolved gaps {counted.unresolved}")
    print(f"gaps: {len(gaps)}, each counted right: {sum(gaps.get(gap.after) == gap.lost for gap in counted.gaps)}")
    print(f"bad checks {counts.check_failures}, discarded bytes {counts.discarded}")
    print(f"recorder: {100 * cpu / (seconds / asked.speed):.1f} % of a core at {RATE_HZ * asked.speed:g} samples/s")


def live(asked: argparse.Namespace) -> None:
    """In real time, the guide with its redrawn screen."""
    folder = Path(tempfile.mkdtemp(prefix="tumblecal-live-"))
    (folder / "plan.toml").write_text(PLAN.format(seconds=asked.seconds + 10))
    process = started(folder / "imu", 36000.0, 1.0, False)
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 45, 110, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color"}
    guide = subprocess.Popen(
        [sys.executable, "-c", GUIDE], cwd=folder, stdin=slave, stdout=slave, stderr=slave, env=environment
    )
    threading.Thread(target=lambda: [os.read(master, 65536) for _ in iter(int, 1)], daemon=True).start()
    last = ""
    while last != "recording":
        time.sleep(0.2)
        with contextlib.suppress(InputError):  # no journal, or an empty one
            last = read_journal(folder / "run")[-1]["entry"]
    # The recorder is the one child of the guide.
    pids = int(Path(f"/proc/{guide.pid}/task/{guide.pid}/children").read_text().split()[0]), guide.pid
    before, start = [cpu_s(pid) for pid in pids], time.monotonic()
    time.sleep(asked.seconds)
    shares = [100 * (cpu_s(pid) - own) / (time.monotonic() - start) for pid, own in zip(pids, before, strict=True)]
    guide.kill()
    process.kill()
    print(f"2000 Hz: recorder {shares[0]:.1f} % of a core, guide {shares[1]:.1f} %, together {sum(shares):.1f} %")


def main() -> None:
    """One of the two parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("losses", "live"))
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--speed", type=float, default=2.5)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    globals()[asked.part](asked)


if __name__ == "__main__":
    main()
