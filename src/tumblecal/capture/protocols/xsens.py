"""Xsens (Movella) MTi, MTData2 messages: big-endian, self-describing fields, 8-bit sum.

0xFA, 0xFF, message 0x36, length, then fields of identifier (2 bytes), size (1) and content; all bytes after the
preamble add up to 0 modulo 256. The low bits of an identifier state its number format.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import byte_sum, ends_with
from tumblecal.capture.decoding.fields import Field, Layout, frames_of, reading
from tumblecal.capture.decoding.framing import FrameDecoder, Frames, column
from tumblecal.capture.decoding.samples import Bytes, Floats, Integers, Samples, Settings, Status
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


MTDATA2 = 0x36
_COUNTER, _TEMPERATURE, _STATUS = 0x1020, 0x0810, 0xE020
_FORCE, _FORCE_HIGH_RATE, _RATE, _RATE_HIGH_RATE = 0x4020, 0x4040, 0x8020, 0x8040
_LARGEST_EXTENDED = 4096
# Number formats by the low bits of an identifier: float32, fixed point 12.20 and 16.32 (fraction first), float64.
FORMATS = (">f4", ">i4", [("fraction", ">u4"), ("whole", ">i2")], ">f8")


def _status(words: Integers) -> Integers:
    return np.where(words & 0x3F00, int(Status.OVERLOAD), 0) + np.where(words & 1, 0, int(Status.ERROR))


def _force(ms2: Floats) -> Floats:
    return ms2 / STANDARD_GRAVITY_MS2


# Quantity of each field, its numbers (a count: in the format of its identifier), and their conversion; the later of two
# fields for one quantity is preferred. All other fields are skipped by their size.
_FIELDS = {
    _COUNTER: ("counter", ">u2", np.asarray),
    0x1060: ("clock", ">u4", np.asarray),
    _TEMPERATURE: ("temperature", 1, np.asarray),
    _FORCE_HIGH_RATE: ("force", 3, _force),
    _FORCE: ("force", 3, _force),
    _RATE_HIGH_RATE: ("rate", 3, np.degrees),
    _RATE: ("rate", 3, np.degrees),
    _STATUS: ("status", ">u4", _status),
}
# Fields of three numbers that resemble a specific force.
_NO_FORCE = {0x4030: "free acceleration (gravity removed)", 0x4010: "velocity increments"}
_OF_MTW = 0xC810


def numbers(words: NDArray) -> Floats:
    """The numbers of a field in one of `FORMATS`; others are not changed."""
    if words.dtype.names:
        return words["whole"] + words["fraction"] / 2.0**32
    return words / 2.0**20 if words.dtype.kind == "i" else words


def _sizes(data: Bytes, places: Integers) -> Integers:
    """Sizes of messages, with one byte of length or, after 0xFF, two."""
    length = data[places + 3].astype(int)
    readable = places + 6 <= len(data)
    long = np.zeros(len(places), int)
    long[readable] = column(data, places[readable], 4, ">u2")
    extended = np.where(long <= _LARGEST_EXTENDED, long + 7, 0)
    return np.where(length == 0xFF, extended, length + 5)


def check(rows: Bytes) -> Bytes:
    """The byte with which all bytes after the preamble add up to 0, shape (n, 1)."""
    return (-byte_sum(rows[:, 1:])).astype(np.uint8)[:, None]


def messages(*sync: bytes) -> Frames:
    """Messages that begin with these bytes."""
    return Frames(sync, header=4, sizes=_sizes, intact=ends_with(check, 1))


def layout_of(message: bytes) -> Layout:
    """The layout of a message; unknown fields, and fields of a wrong size, are skipped."""
    if message[2] != MTDATA2:
        return Layout({}, [2])
    at, stop = 6 if message[3] == 0xFF else 4, len(message) - 1
    describing, sizes, known = [2, 3], list[tuple[int, int]](), dict[int, Field]()
    while at < stop:
        describing += range(at, min(at + 3, stop))
        if at + 3 > stop or at + 3 + message[at + 2] > stop:
            break
        identifier, size = int.from_bytes(message[at : at + 2], "big"), message[at + 2]
        sizes.append((identifier, size))
        _, kind, scaled = _FIELDS.get(identifier & 0xFFF0, ("", 0, np.asarray))
        if isinstance(kind, int):
            kind = np.dtype((FORMATS[identifier & 3], (kind,)))
        if size and size == np.dtype(kind).itemsize:
            known[identifier & 0xFFF0] = Field(at + 3, kind, lambda words, scaled=scaled: scaled(numbers(words)))
        at += 3 + size
    fields = {quantity: known[name] for name, (quantity, _, _) in _FIELDS.items() if name in known}
    counted = any(identifier & 0xFFF0 == _COUNTER for identifier, _ in sizes)
    # A message without a force (for example of satellites) uses a number of the counter: no sample is lost there.
    return Layout(fields, describing, _refused(sizes), "other_message" if counted else "")


def _refused(sizes: list[tuple[int, int]]) -> str:
    """Why a message with fields of these sizes has no readable specific force, if it has something like it."""
    for identifier, size in sizes:
        if identifier & 0xFFF0 in (_FORCE, _FORCE_HIGH_RATE):
            return f"a specific force 0x{identifier:04X} of {size} bytes does not fit its number format: not read"
    for identifier, _ in sizes:
        if identifier == _OF_MTW:
            return "messages have increments of an MTw (0xC810), not accelerations: export them as text with MT Manager"
        if name := _NO_FORCE.get(identifier & 0xFFF0):
            return f"messages have {name}, not the specific force: enable acceleration 0x4020 in the device"
    return ""


def encode(samples: Samples, settings: Settings) -> bytes:
    """Messages with counter, temperature, specific force, rate and status, in float32."""
    clip = np.where(samples.status & Status.OVERLOAD, 0x0700, 0) | np.where(samples.status & Status.ERROR, 0, 1)
    payload = frames_of(
        len(samples),
        _COUNTER.to_bytes(2, "big") + b"\2",
        (samples.counter % 65536).astype(">u2"),
        _TEMPERATURE.to_bytes(2, "big") + b"\4",
        np.nan_to_num(samples.temperature).astype(">f4"),
        _FORCE.to_bytes(2, "big") + b"\14",
        (samples.force * STANDARD_GRAVITY_MS2).astype(">f4"),
        _RATE.to_bytes(2, "big") + b"\14",
        np.radians(np.nan_to_num(samples.rate)).astype(">f4"),
        _STATUS.to_bytes(2, "big") + b"\4",
        clip.astype(">u4"),
    )
    rows = frames_of(len(samples), bytes([0xFA, 0xFF, MTDATA2, payload.shape[1]]), payload)
    return np.hstack([rows, check(rows)]).tobytes()


PROTOCOL = Protocol(
    name="xsens",
    title="Xsens (Movella) MTi, MTData2",
    decoder=lambda settings=None: FrameDecoder(reading(layout_of), messages(b"\xfa", b"\xff"), lock_after=3),
    encode=encode,
    bauds=(115200, 921600, 2000000, 460800),
    counter=DeviceCounter(modulus=65536, ticks_per_s=None),
)
