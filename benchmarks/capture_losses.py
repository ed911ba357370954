"""Half an hour of 2000 Hz data through a pseudo-terminal, faster than real, with faults: is every loss counted?

python benchmarks/capture_losses.py [--minutes 30] [--speed 2.5]
"""

import argparse
import json
import os
import tempfile
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
from tumblecal.capture.log import LogReader, RecordKind
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols.stim300 import Stim300Framing


SETTINGS = Settings((10.0,) * 3, "acceleration", 2000.0)


def sequence_rates(numbers: np.ndarray) -> np.ndarray:
    """Sample numbers hidden in the angular rates: the truth travels with the data."""
    return np.stack([numbers // 65536 - 100.0, numbers % 65536, 0 * numbers], axis=1) / 2**14


def sequence_of(rates: np.ndarray) -> np.ndarray:
    """The numbers hidden in angular rates."""
    hidden = np.rint(rates[:, :2] * 2**14).astype(np.int64)
    return (hidden[:, 0] + 100) * 65536 + hidden[:, 1]


def instrument(link: str, seconds: float, speed: float) -> None:
    random = np.random.default_rng(5)
    quiet = 4 * speed
    faults = {
        "bit_flips_per_s": 2.0,
        "lost_bytes_per_s": 1.0,
        "garbage_per_s": 0.5,
        "missing_frames_per_s": 2.0,
        "stalls_per_s": 0.02,
        "unplug_at_s": sorted(random.uniform(quiet, seconds - 2 * quiet, int(seconds // 100)).tolist()),
        "unplug_for_s": 1.2,
    }
    config = Emulation.model_validate({"instrument": {"rate_hz": 2000.0}, "faults": faults})
    VirtualInstrument(VirtualDevice(config, rates=sequence_rates), Path(link), speed, ledger=Path(link + ".json")).run(
        seconds
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--speed", type=float, default=2.5)
    given = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="tumblecal-losses-"))
    link, log = folder / "imu", folder / "raw.log"
    seconds = given.minutes * 60
    process = get_context("spawn").Process(target=instrument, args=(str(link), seconds, given.speed))
    process.start()
    while not link.exists():
        time.sleep(0.01)
    recording = Recording(log, str(link), 921600)
    pid = recording.pid
    process.join()
    ticks = [int(x) for x in Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[11:13]]
    cpu = sum(ticks) / os.sysconf("SC_CLK_TCK")
    time.sleep(0.5)
    recording.stop()

    decoder, counts = FrameDecoder(Stim300Framing(SETTINGS)), Counts()
    counters, rates, stamps, pending_stops, pending_stamps, total = [], [], [], [], [], 0
    reopened = 0
    with LogReader(log) as reader:
        for record in reader.records():
            if record.kind != RecordKind.BYTES:
                reopened += record.content()["event"] == "reopened"
                continue
            total += len(record.payload)
            pending_stops.append(total)
            pending_stamps.append(record.stamp_ns * 1e-9)
            found = decoder.feed(record.payload)
            counts.add(found.counts)
            if len(found.samples):
                which = np.searchsorted(pending_stops, found.samples.stop)
                stamps.append(np.array(pending_stamps)[which])
                counters.append(found.samples.counter)
                rates.append(found.samples.rate)
                del pending_stops[: which[-1]], pending_stamps[: which[-1]]
    numbers = sequence_of(np.concatenate(rates))
    truth = int(numbers[-1] - numbers[0] + 1 - len(numbers))
    counted = count_losses(np.concatenate(counters), np.concatenate(stamps), 256, 1)
    ledger = json.loads(Path(f"{link}.json").read_text())
    print(f"{given.minutes:g} minutes at 2000 Hz, {given.speed:g} times faster than real; {reopened} unplugs")
    made, late = ledger["generated"], ledger["latest_ms"]
    print(f"device made {made}, {ledger['stalls']} stalls, fell at most {late:.0f} ms behind its clock")
    print(f"log {log.stat().st_size / 1e6:.0f} MB")
    print(f"arrived {len(numbers)}, out of order or twice {int((np.diff(numbers) <= 0).sum())}")
    print(f"lost: truth {truth}, counted {counted.lost}, unresolved gaps {counted.unresolved}")
    difference = np.flatnonzero(np.diff(numbers) > 1)
    single = {int(i): int(np.diff(numbers)[i] - 1) for i in difference}
    right = sum(single.get(g.after, 0) == g.lost for g in counted.gaps)
    print(f"gaps: {len(single)}, each counted right: {right}")
    print(f"bad checks {counts.check_failures}, discarded bytes {counts.discarded}")
    print(f"recorder: {100 * cpu / (seconds / given.speed):.1f} % of a core at {2000 * given.speed:g} samples/s")


if __name__ == "__main__":
    main()
