"""Many small hostile files through all decoders: no exception, no warning, and the same samples however cut.

Each file is a stream of one protocol: good frames, frames with a right check around random content (fields of any
identifier and size), and damage (flips, cuts, insertions). It goes through the protocol's decoder in one piece and in
random pieces, now and then through the guessing of the protocol.

    python benchmarks/fuzz_decoders.py [--files 100000] [--seed 0]
"""

import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from command_line import asked
from tumblecal.capture.decoding.checks import crc16_xmodem, crc32_mpeg2, exclusive_or
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.samples import Counts, Settings, blank, joined
from tumblecal.capture.decoding.sniff import guesses
from tumblecal.capture.protocols import protocol, protocols
from tumblecal.capture.protocols.stim300 import SIZES
from tumblecal.capture.protocols.vectornav import FIELD_SIZES


def content(random: np.random.Generator, size: int) -> bytes:
    """Random bytes, or the corners of numbers."""
    kind = random.integers(4)
    if kind == 0:
        return bytes([random.choice([0x00, 0x7F, 0x80, 0xFF])]) * size
    if kind == 1:
        return (np.array([np.nan, np.inf, -np.inf, 3e38, 1e-45], ">f4")[random.integers(5)]).tobytes() * (size // 4 + 1)
    return random.bytes(size)


def stim300(random: np.random.Generator) -> bytes:
    identifier = int(random.choice(np.flatnonzero(SIZES)))
    row = np.frombuffer(bytes([identifier]) + content(random, 80), np.uint8)[None, : SIZES[identifier] - 4]
    crlf = b"\r\n" if random.random() < 0.3 else b""
    return row.tobytes() + crc32_mpeg2(row, -row.shape[1] % 4).astype(">u4").tobytes() + crlf


def fields(random: np.random.Generator, identifiers: list[bytes], sizes: list[int], extra: int) -> bytes:
    """Identifier, size and content of some fields, not all of which end where they should."""
    made = b""
    for _ in range(random.integers(0, 5)):
        size = int(random.choice([*sizes, random.integers(0, 60)]))
        name = identifiers[random.integers(len(identifiers))] if random.random() < 0.8 else random.bytes(2)
        head = name + bytes([size]) if extra == 3 else bytes([size]) + name[:1]
        made += head + content(random, size)[: size if extra == 3 else max(size - 2, 0)]
    return made[: int(random.integers(len(made) + 1))] if random.random() < 0.1 else made


def xsens(random: np.random.Generator) -> bytes:
    names = [bytes([high, low | int(random.integers(16))]) for high, low in ((0x40, 0x20), (0x40, 0x40), (0x80, 0x20))]
    names += [b"\x10\x20", b"\x08\x10", b"\xe0\x20", b"\x70\x10", b"\x40\x30", b"\x40\x10"]
    payload = fields(random, names, [0, 1, 2, 4, 12, 18, 24, 94], 3)
    length = bytes([len(payload)]) if len(payload) < 255 else b"\xff" + len(payload).to_bytes(2, "big")
    body = b"\xff" + bytes([0x36 if random.random() < 0.9 else random.integers(256)]) + length + payload
    return b"\xfa" + body + bytes([-sum(body) % 256])


def mip(random: np.random.Generator) -> bytes:
    payload = fields(random, [b"\x04.", b"\x05.", b"\x07.", b"\xd5."], [0, 1, 2, 14, 14, 6], 2)[:255]
    body = b"\x75\x65" + bytes([0x80 if random.random() < 0.9 else random.integers(256), len(payload)]) + payload
    running = np.cumsum(np.frombuffer(body, np.uint8), dtype=np.int64)
    return body + bytes([int(running[-1] % 256), int(running.sum() % 256)])


def inertial_labs(random: np.random.Generator) -> bytes:
    names = bytes(int(random.choice([0x23, 0x21, 0x52, 0x53, random.integers(256)])) for _ in range(random.integers(6)))
    count = len(names) if random.random() < 0.8 else int(random.integers(256))
    payload = bytes([count]) + names + content(random, int(random.choice([12, 24, 28, random.integers(60)])))
    kind = 0x95 if random.random() < 0.9 else int(random.integers(256))
    body = bytes([1, kind]) + (len(payload) + 6).to_bytes(2, "little") + payload
    return b"\xaa\x55" + body + (sum(body) % 65536).to_bytes(2, "little")


def witmotion(random: np.random.Generator) -> bytes:
    row = bytes([0x55, int(random.integers(0x50, 0x60))]) + content(random, 8)[:8]
    return row + bytes([sum(row) % 256])


_NUMBERS = ["+1.0", "-09.81", "nan", "inf", "-inf", "1e999", "1e308", "1_0", "9" * 400]
WORDS = [*_NUMBERS, "", "T01", "V1", "abc", "0x1", "\x1b[2J"]


def vectornav(random: np.random.Generator) -> bytes:
    if random.random() < 0.5:
        name = "VN" + str(
            random.choice(["IMU", "QMR", "YMR", "YIA", "ACC", "ERR", "RRG,03", "XYZ", "QTA", "YCM", "MAR"])
        )
        words = [str(random.choice(WORDS)) if random.random() < 0.2 else "+1.5" for _ in range(random.integers(0, 16))]
        body = ",".join([name, *words]).encode()
        check = f"{crc16_xmodem(body):04X}" if random.random() < 0.3 else f"{exclusive_or(body):02X}"
        return b"$" + body + f"*{check}\r\n".encode()
    groups = int(random.integers(1, 128)) if random.random() < 0.3 else int(random.choice([1, 4, 5, 16, 20, 32]))
    words, size = b"", 0
    for group in range(7):
        if groups >> group & 1:
            bits = [b for b in range(len(FIELD_SIZES[group])) if random.random() < 0.25] or [0]
            words += sum(1 << b for b in bits).to_bytes(2, "little")
            size += sum(FIELD_SIZES[group][b] for b in bits)
    row = bytes([groups]) + words + content(random, size)[:size]
    return b"\xfa" + row + crc16_xmodem(row).to_bytes(2, "big")


def text(random: np.random.Generator) -> bytes:
    lines = b""
    width = int(random.integers(3, 9))
    checked = random.random() < 0.3
    for _ in range(random.integers(1, 40)):
        kind = random.random()
        if kind < 0.05:
            names = ["ax", "ay [mg]", "az", "t", "gx", "counter", "time", "foo", "accel_x (g)"]
            body = ",".join(str(random.choice(names)) for _ in range(width))
        elif kind < 0.08:
            body = "time,ax,ay,az" if random.random() < 0.5 else "az [m/s2];ay;ax"
        else:
            numbers = [f"{random.normal():.3f}" for _ in range(width - 1)] + ["9.81"]
            body = ",".join(str(random.choice(WORDS)) if random.random() < 0.02 else n for n in numbers)
        lines += (f"${body}*{exclusive_or(body.encode()):02X}\n" if checked else f"{body}\n").encode()
    return lines


HOSTILE: dict[str, Callable[[np.random.Generator], bytes]] = {
    f.__name__: f for f in (stim300, xsens, mip, inertial_labs, witmotion, vectornav, text)
}


def good(name: str, random: np.random.Generator) -> bytes:
    n = int(random.integers(1, 6))
    samples = blank(n)
    samples.force[:] = random.normal(size=(n, 3))
    samples.rate[:] = random.normal(size=(n, 3))
    samples.counter[:] = random.integers(2**31) + np.arange(n)
    return protocol(name).encode(samples, settings(name))


def settings(name: str) -> Settings:
    own = protocol(name)
    return own.settings(own.ranges_g[0] if own.ranges_g else None, 125.0)


def damaged(data: bytes, random: np.random.Generator) -> bytes:
    """Some bits flipped, stretches cut out, garbage put in."""
    spoiled = bytearray(data)
    for _ in range(random.integers(1, 6)):
        at = int(random.integers(len(spoiled) + 1))
        kind = random.integers(3)
        if kind == 0 and at < len(spoiled):
            spoiled[at] ^= 1 << int(random.integers(8))
        elif kind == 1:
            del spoiled[at : at + int(random.integers(1, 30))]
        else:
            spoiled[at:at] = content(random, int(random.integers(1, 30)))
    return bytes(spoiled)


def hostile_file(name: str, random: np.random.Generator) -> bytes:
    pieces = [
        good(name, random) if random.random() < 0.3 else HOSTILE[name](random) * int(random.integers(1, 5))
        for _ in range(random.integers(1, 12))
    ]
    data = b"".join(pieces)
    return damaged(data, random) if random.random() < 0.5 else data


def try_file(name: str, data: bytes, random: np.random.Generator) -> int:
    """Decode in one piece and in many; the number of samples."""
    known = replace(settings(name) if random.random() < 0.5 else Settings(), whole=True)
    whole = decode_all(protocol(name).decoder(known), data)
    decoder, at, parts, counts = protocol(name).decoder(known), 0, [], Counts()
    while at < len(data):
        size = int(random.integers(1, 200))
        piece = decoder.feed(data[at : at + size])
        parts.append(piece.samples)
        counts.add(piece.counts)
        at += size
    last = decoder.finish()
    counts.add(last.counts)
    stops = joined([*parts, last.samples]).stop
    assert counts.frames == len(stops), "frames and samples differ"
    assert counts == whole.counts, "the cut changes the counts"
    assert np.array_equal(stops, whole.samples.stop), "the cut changes the samples"
    assert whole.counts.discarded <= len(data) + 8, "more discarded than there was"
    bad = ~np.isfinite(whole.samples.force).all(1) & (whole.samples.status == 0)
    assert name == "stim300" or not bad.any(), "not a number and not said"
    return len(stops)


def run(files: int, seed: int, guess_every: int = 50) -> Counter:
    """Files and samples of each protocol. **Raises:** what a decoder raises, with protocol, number and bytes."""
    tried: Counter = Counter()
    names = sorted(protocols())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in range(files):
            random = np.random.default_rng([seed, number])
            name = names[number % len(names)]
            data = hostile_file(name, random)
            try:
                tried[f"{name} samples"] += try_file(name, data, random)
                if number % guess_every == 0:
                    guesses(data)
            except Exception as error:
                error.add_note(f"{name}, --seed {seed}, file {number}: {data.hex()}")
                raise
            tried[f"{name} files"] += 1
    return tried


def main() -> None:
    options = asked(__doc__, files=100_000, seed=0)
    start = time.perf_counter()
    tried = run(options.files, options.seed)
    for name in sorted(protocols()):
        print(f"{name:14s} {tried[f'{name} files']:7d} files, {tried[f'{name} samples']:8d} samples")
    print(
        f"{options.files} files in {time.perf_counter() - start:.0f} s: no exception, no warning, the same however cut"
    )


if __name__ == "__main__":
    main()
