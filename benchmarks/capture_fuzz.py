"""A million random flips, cuts and insertions in a STIM300 stream, fed in random pieces.

Every frame that was not touched must come out, nothing else may.

    python benchmarks/capture_fuzz.py [--events 1000000]
"""

import argparse
import time

import numpy as np

from tumblecal.capture.framing import FrameDecoder
from tumblecal.capture.protocols.stim300 import Stim300Framing, encode
from tumblecal.capture.samples import Counts, Settings, blank


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
    pieces = []
    for k in range(BLOCK):
        row = flipped[k].tobytes()
        if kind[k] == 2:
            row = row[: where[k]] + row[where[k] + min(int(lengths[k]), 38) :]
        elif kind[k] == 3:
            pieces.append(random.bytes(int(lengths[k])))
        pieces.append(row)
    return b"".join(pieces), number[(kind == 0) | (kind == 3)], int((kind > 0).sum())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--events", type=int, default=1_000_000)
    wanted = parser.parse_args().events
    random = np.random.default_rng(99)
    decoder, counts = FrameDecoder(Stim300Framing(SETTINGS)), Counts()
    events = frames = missing = false = seed = 0
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
        words = np.rint(np.concatenate(found) * 2**14).astype(np.int64)
        numbers = words[:, 0] * 4096 + words[:, 1]
        false += len(np.setdiff1d(numbers, whole)) + len(numbers) - len(np.unique(numbers))
        lost = np.setdiff1d(whole, numbers)
        # The last frame of a block may come out with the next one.
        missing += len(lost[lost < seed * BLOCK - 3])
        frames += len(whole)
    print(f"{events} damages (flips, cuts, insertions) in {seed * BLOCK} frames, fed in random pieces")
    print(f"untouched frames {frames}, missing {missing}, false or double {false}")
    print(f"bad checks {counts.check_failures}, resyncs {counts.resyncs}, discarded bytes {counts.discarded}")
    print(f"{seed * BLOCK / spent / 1e3:.0f} thousand frames/s in this wreck of a stream")


if __name__ == "__main__":
    main()
