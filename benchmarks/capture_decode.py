"""Decoding STIM300 frames from a file: this decoder, and the per-byte loop that a script would use.

python benchmarks/capture_decode.py [--frames 1500000]
"""

import argparse
import binascii
import time

import numpy as np

from tumblecal.capture.decoding.framing import FrameDecoder, decode_all
from tumblecal.capture.decoding.samples import Settings, blank
from tumblecal.capture.protocols.stim300 import Stim300Framing
from tumblecal.capture.protocols.stim300_device import encode


SETTINGS = Settings((10.0,) * 3, "acceleration", 2000.0)


def stream(frames: int) -> bytes:
    random = np.random.default_rng(0)
    samples = blank(frames)
    samples.force[:] = random.normal(size=(frames, 3))
    samples.rate[:] = random.normal(size=(frames, 3))
    samples.counter[:] = np.arange(frames)
    return encode(samples, SETTINGS)


REVERSED = bytes(int(f"{i:08b}"[::-1], 2) for i in range(256))


def per_byte_loop(data: bytes) -> int:
    """A state machine over single bytes, with the CRC of the standard library on reversed bits."""
    frames, frame, rows = 0, bytearray(), []
    for byte in data:
        if not frame and byte != 0x93:
            continue
        frame.append(byte)
        if len(frame) == 38:
            check = (binascii.crc32((bytes(frame[:-4]) + b"\0\0").translate(REVERSED)) ^ 0xFFFFFFFF).to_bytes(
                4, "little"
            )
            if check == bytes(frame[-4:]).translate(REVERSED):
                rows.append(
                    [int.from_bytes(frame[11 + 3 * k : 14 + 3 * k], "big", signed=True) * 2.0**-19 for k in range(3)]
                )
                frames += 1
            frame.clear()
    return frames


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=1_500_000)
    frames = parser.parse_args().frames
    data = stream(frames)
    best = 1e9
    for _ in range(5):
        start = time.perf_counter()
        found = decode_all(FrameDecoder(Stim300Framing(SETTINGS)), data)
        best = min(best, time.perf_counter() - start)
        assert len(found.samples) == frames and found.counts.discarded == 0
    few = data[: 38 * 60_000]
    start = time.perf_counter()
    assert per_byte_loop(few) == 60_000
    slow = (time.perf_counter() - start) / 60_000
    print(f"{frames} frames of 38 bytes, CRC checked, scaled: best of 5 runs {best:.3f} s")
    print(f"this decoder   {frames / best / 1e6:8.2f} million frames/s")
    print(f"per-byte loop  {1e-6 / slow:8.2f} million frames/s")
    print(f"ratio          {slow * frames / best:8.1f}")


if __name__ == "__main__":
    main()
