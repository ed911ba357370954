"""The capture: speed of the decoder, damage in a stream, losses, and processor time of a guided run.

python benchmarks/capture_bench.py decode    STIM300 frames from a file: this decoder, and the per-byte loop of a script
python benchmarks/capture_bench.py damage    a million random flips, cuts and insertions: every other frame comes out
python benchmarks/capture_bench.py losses    half an hour at 2000 Hz with faults: every loss is counted
python benchmarks/capture_bench.py live      a guided capture at 2000 Hz: processor time of recorder and guide
"""

import argparse
import binascii
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

from tumblecal.capture.decoding.framing import FrameDecoder, decode_all
from tumblecal.capture.decoding.losses import count_losses
from tumblecal.capture.decoding.samples import Counts, Settings, blank
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.instrument import VirtualInstrument
from tumblecal.capture.journal import read_journal
from tumblecal.capture.log import LogReader, RecordKind
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols.stim300 import Stim300Framing
from tumblecal.capture.protocols.stim300_device import encode
from tumblecal.ground.errors import InputError


SETTINGS = Settings((10.0,) * 3, "acceleration", 2000.0)
RATE_HZ, FRAME, BLOCK = 2000.0, 38, 50_000
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


def per_byte_loop(data: bytes, frames: int) -> None:
    """A state machine over single bytes, with the CRC of the standard library on reversed bits."""
    reverse = bytes(int(f"{i:08b}"[::-1], 2) for i in range(256))
    frame, rows = bytearray(), []
    for byte in data:
        if not frame and byte != 0x93:
            continue
        frame.append(byte)
        if len(frame) == FRAME:
            crc = binascii.crc32((bytes(frame[:-4]) + b"\0\0").translate(reverse)) ^ 0xFFFFFFFF
            if crc.to_bytes(4, "little") == bytes(frame[-4:]).translate(reverse):
                fields = (frame[11 + 3 * k : 14 + 3 * k] for k in range(3))
                rows.append([int.from_bytes(field, "big", signed=True) * 2.0**-19 for field in fields])
            frame.clear()
    assert len(rows) == frames


def decode(asked: argparse.Namespace) -> None:
    """Best of five runs."""
    random, samples = np.random.default_rng(0), blank(asked.frames)
    samples.force[:], samples.rate[:] = random.normal(size=(2, asked.frames, 3))
    samples.counter[:] = np.arange(asked.frames)
    data, times = encode(samples, SETTINGS), []
    for _ in range(5):
        start = time.perf_counter()
        found = decode_all(decoder(), data)
        times.append(time.perf_counter() - start)
        assert len(found.samples) == asked.frames and found.counts.discarded == 0
    few = min(60_000, asked.frames)
    start = time.perf_counter()
    per_byte_loop(data[: FRAME * few], few)
    slow = (time.perf_counter() - start) / few
    print(f"{asked.frames} frames of {FRAME} bytes, CRC checked, scaled: {min(times):.3f} s")
    print(f"this decoder   {asked.frames / min(times) / 1e6:8.2f} million frames/s")
    print(f"per-byte loop  {1e-6 / slow:8.2f} million frames/s; ratio {slow * asked.frames / min(times):.1f}")


def damaged_block(seed: int) -> tuple[bytes, np.ndarray, int]:
    """A stretch with damage: its bytes, the numbers of the untouched frames, and the number of events."""
    random, samples = np.random.default_rng(seed), blank(BLOCK)
    number = seed * BLOCK + np.arange(BLOCK)
    samples.force[:], samples.rate[:] = 0.5, sequence_rates(number)
    rows = np.frombuffer(encode(samples, SETTINGS), np.uint8).reshape(BLOCK, FRAME)
    # 0: none, 1: a bit flipped, 2: a stretch cut out, 3: random bytes inserted before it.
    kind = random.choice(4, BLOCK, p=[0.5, 0.2, 0.15, 0.15])
    kind[-1] = 0
    where, bit, length = random.integers(0, FRAME, BLOCK), random.integers(0, 8, BLOCK), random.integers(1, 60, BLOCK)
    flipped, hit = rows.copy(), np.flatnonzero(kind == 1)
    flipped[hit, where[hit]] ^= (1 << bit[hit]).astype(np.uint8)
    pieces, starts, at = [], np.zeros(BLOCK, np.int64), 0
    for k in range(BLOCK):
        row = flipped[k].tobytes()
        if kind[k] == 2:
            row = row[: where[k]] + row[where[k] + min(int(length[k]), FRAME) :]
        before = random.bytes(int(length[k])) if kind[k] == 3 else b""
        starts[k] = at + len(before)
        pieces += [before, row]
        at = starts[k] + len(row)
    data, whole = b"".join(pieces), (kind == 0) | (kind == 3)
    # A cut tail may equal the bytes that follow: then this frame is whole, and the next lost its beginning.
    for k in np.flatnonzero(kind == 2):
        if data[starts[k] : starts[k] + FRAME] == rows[k].tobytes():
            whole[k] = True
            whole[k + 1] &= starts[k + 1] >= starts[k] + FRAME
    return data, number[whole], int((kind > 0).sum())


def damage(asked: argparse.Namespace) -> None:
    """Every untouched frame must come out, and nothing else, in random pieces."""
    random, stream, counts = np.random.default_rng(99), decoder(), Counts()
    events, blocks, truth, came, spent = 0, 0, [], [], 0.0
    while events < asked.events:
        data, whole, hits = damaged_block(blocks)
        events, blocks, at = events + hits, blocks + 1, 0
        truth.append(whole)
        start = time.perf_counter()
        while at < len(data):
            size = int(random.integers(1, 20_000))
            piece = stream.feed(data[at : at + size])
            counts.add(piece.counts)
            came.append(piece.samples.rate)
            at += size
        spent += time.perf_counter() - start
    numbers, expected = sequence_of(np.concatenate([*came, stream.finish().samples.rate])), np.concatenate(truth)
    false = len(np.setdiff1d(numbers, expected)) + len(numbers) - len(np.unique(numbers))
    print(f"{events} flips, cuts and insertions in {blocks * BLOCK} frames, fed in random pieces")
    print(f"untouched frames {len(expected)}, missing {len(np.setdiff1d(expected, numbers))}, false or double {false}")
    print(f"bad checks {counts.check_failures}, resyncs {counts.resyncs}, discarded bytes {counts.discarded}")
    print(f"{blocks * BLOCK / spent / 1e3:.0f} thousand frames/s")


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
    """One of the four parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("decode", "damage", "losses", "live"))
    parser.add_argument("--frames", type=int, default=1_500_000)
    parser.add_argument("--events", type=int, default=1_000_000)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--speed", type=float, default=2.5)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    globals()[asked.part](asked)


if __name__ == "__main__":
    main()
