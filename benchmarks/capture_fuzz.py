"""A million random flips, cuts and insertions in a STIM300 stream, fed in random pieces.

Every frame that was not touched must come out, nothing else may.

    python benchmarks/capture_fuzz.py [--events 1000000]
"""

import argparse
import time

import numpy as np

from tumblecal.capture.decoding.framing import FrameDecoder
from tumblecal.capture.decoding.samples import Counts, Settings, blank
from tumblecal.capture.protocols.stim300 import Stim300Framing
from tumblecal.capture.protocols.stim300_device import encode


SETTINGS = Settings((10.0,) * 3, "acceleration", 2000.0)
BLOCK = 50_000


def block(seed: int) -> tuple[bytes, np.ndarray, int]:
    """A damaged stretch: its bytes, the words that tell each untouched frame, and the number of events."""
    random = np.random.default_rng(seed)
    samples = blank(BLOCK)
    samples.force[:] = 0.5
    number = seed * BLOCK + np.arange(BLOCK)
    samples.rate[:] = np.stack([number // 4096, number % 4096, 0 * number], axis=1) / 2**14
    rows = np.frombuffer(encode(samples, SETTINGS), np.uint8).reshape(BLOCK, 38)
    kind = random.choice(4, BLOCK, p=[0.5, 0.2, 0.15, 0.15])
    where, bit = random.integers(0, 38, BLOCK), random.integers(0, 8, BLOCK)
    lengths = random.integers(1, 60, BLOCK)
    flipped = rows.copy()
    hit = np.flatnonzero(kind == 1)
    flipped[hit, where[hit]] ^= (1 << bit[hit]).astype(np.uint8)
    kind[-1] = 0
    flipped[-1] = rows[-1]
    whole = (kind == 0) | (kind == 3)
    pieces, starts, length = [], np.zeros(BLOCK, np.int64), 0
    for k in range(BLOCK):
        row = flipped[k].tobytes()
        if kind[k] == 2:
            row = row[: where[k]] + row[where[k] + min(int(lengths[k]), 38) :]
        elif kind[k] == 3:
            pieces.append(random.bytes(int(lengths[k])))
            length += len(pieces[-1])
        starts[k] = length
        pieces.append(row)
        length += len(row)
    data = b"".join(pieces)
    # A cut tail may happen to equal what follows it: then this frame is whole, and the next lost its beginning.
    for k in np.flatnonzero(kind == 2):
        if data[starts[k] : starts[k] + 38] == rows[k].tobytes():
            whole[k] = True
            whole[k + 1] &= starts[k + 1] >= starts[k] + 38
    return data, number[whole], int((kind > 0).sum())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--events", type=int, default=1_000_000)
    wanted = parser.parse_args().events
    random = np.random.default_rng(99)
    decoder, counts = FrameDecoder(Stim300Framing(SETTINGS)), Counts()
    events = seed = 0
    everything, came = [], []
    spent = 0.0
    while events < wanted:
        data, whole, hits = block(seed)
        seed += 1
        events += hits
        found = []
        at = 0
        start = time.perf_counter()
        while at < len(data):
            size = int(random.integers(1, 20_000))
            piece = decoder.feed(data[at : at + size])
            counts.add(piece.counts)
            found.append(piece.samples.rate)
            at += size
        spent += time.perf_counter() - start
        everything.append(whole)
        came += found
    came.append(decoder.finish().samples.rate)
    words = np.rint(np.concatenate(came) * 2**14).astype(np.int64)
    numbers, truth = words[:, 0] * 4096 + words[:, 1], np.concatenate(everything)
    missing = len(np.setdiff1d(truth, numbers))
    false = len(np.setdiff1d(numbers, truth)) + len(numbers) - len(np.unique(numbers))
    frames = len(truth)
    print(f"{events} damages (flips, cuts, insertions) in {seed * BLOCK} frames, fed in random pieces")
    print(f"untouched frames {frames}, missing {missing}, false or double {false}")
    print(f"bad checks {counts.check_failures}, resyncs {counts.resyncs}, discarded bytes {counts.discarded}")
    print(f"{seed * BLOCK / spent / 1e3:.0f} thousand frames/s in this wreck of a stream")


if __name__ == "__main__":
    main()
