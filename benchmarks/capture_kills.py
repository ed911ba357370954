"""Kill -9 at random moments while recording 2000 Hz: nothing acknowledged is lost, nothing twice, every log reopens.

python benchmarks/capture_kills.py [--kills 200]
"""

import argparse
import os
import signal
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.run import VirtualInstrument
from tumblecal.capture.framing import decode_all
from tumblecal.capture.log import Kind, LogWriter, read_log
from tumblecal.capture.protocols import protocol
from tumblecal.capture.recording import Recording
from tumblecal.capture.samples import Settings


def sequence_rates(numbers: np.ndarray) -> np.ndarray:
    """Sample numbers hidden in the angular rates: the truth travels with the data."""
    return np.stack([numbers // 65536 - 100.0, numbers % 65536, 0 * numbers], axis=1) / 2**14


def instrument(link: str) -> None:
    config = Emulation.model_validate({"instrument": {"rate_hz": 2000.0}})
    VirtualInstrument(config, Path(link), rates=sequence_rates).run(3600.0)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=200)
    kills = parser.parse_args().kills
    folder = Path(tempfile.mkdtemp(prefix="tumblecal-kills-"))
    link, log = folder / "imu", folder / "raw.log"
    process = get_context("spawn").Process(target=instrument, args=(str(link),), daemon=True)
    process.start()
    while not link.exists():
        time.sleep(0.01)
    random = np.random.default_rng(1)
    acknowledged: list[tuple[int, bytes]] = []
    for _ in range(kills):
        recording = Recording(log, str(link), 921600)
        time.sleep(float(random.uniform(0, 0.4)))
        recording.poll()
        os.kill(recording.pid, signal.SIGKILL)
        recording.stop()
        if recording.synced:
            acknowledged.append((recording.synced, log.read_bytes()[recording.synced - 16 : recording.synced]))
        # What a power cut may leave behind: an unfinished record.
        if random.random() < 0.5:
            whole = log.read_bytes()[-200:]
            with open(log, "ab") as file:
                file.write(whole[: int(random.integers(1, 150))])
    writer = LogWriter(log)
    writer.close()
    process.kill()
    content = log.read_bytes()
    kept = sum(content[stop - 16 : stop] == tail for stop, tail in acknowledged)
    records = read_log(log)
    started = [r.content() for r in records if r.kind == Kind.EVENT and r.content()["event"] == "started"]
    decoder = protocol("stim300").decoder(Settings((10.0,) * 3))
    found = decode_all(decoder, b"".join(r.payload for r in records if r.kind == Kind.BYTES))
    hidden = np.rint(found.samples.rate[:, :2] * 2**14).astype(np.int64)
    numbers = (hidden[:, 0] + 100 * 2**14) * 65536 + hidden[:, 1]
    print(
        f"{kills} kills; the log was reopened {len(started)} times, {sum(e['cut_bytes'] > 0 for e in started)} torn tails cut"
    )
    print(f"acknowledged places {len(acknowledged)}, still there {kept}")
    print(f"samples {len(numbers)}, twice or out of order {int((np.diff(numbers) <= 0).sum())}")
    print(f"bytes outside whole frames {found.counts.discarded}")


if __name__ == "__main__":
    main()
