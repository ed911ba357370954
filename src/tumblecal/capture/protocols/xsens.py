"""Xsens (Movella) MTi, MTData2 messages: big-endian, self-describing fields, 8-bit sum.

0xFA, 0xFF, message 0x36, length, then fields of identifier (2 bytes), size (1) and content; all bytes after the
preamble add up to 0 modulo 256. The low bits of an identifier state its number format.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import byte_sum, ends_with
from tumblecal.capture.decoding.fields import MS2, RADIANS, Field, Layout, Unit, frames_of, reading
from tumblecal.capture.decoding.framing import FrameDecoder, Frames, column
from tumblecal.capture.decoding.samples import UNKNOWN, Bytes, Floats, Integers, Samples, Settings, Status
from tumblecal.capture.protocols import DeviceCounter, Protocol


MTDATA2, _COUNTER, _LARGEST_EXTENDED = 0x36, 0x1020, 4096
# Number formats by the low bits of an identifier: float32, fixed point 12.20 and 16.32 (fraction first), float64.
_FORMATS = (">f4", ">i4", [("fraction", ">u4"), ("whole", ">i2")], ">f8")
# Bits of the status word: any axis is clipping; the self-test was passed.
_STATUS = Unit(
    lambda word: ((word & 0x3F00) > 0) * Status.OVERLOAD + ((word & 1) == 0) * Status.ERROR,
    lambda status: ((status & Status.OVERLOAD) > 0) * 0x0700 + ((status & Status.ERROR) == 0),
)
# The later of two fields for one quantity is preferred. All other fields are skipped by their size.
_FIELDS = {
    _COUNTER: Field("counter", ">u2"),
    0x1060: Field("clock", ">u4"),
    0x0810: Field("temperature", ">f4"),
    0x4040: Field("force", "3>f4", MS2),
    0x4020: Field("force", "3>f4", MS2),
    0x8040: Field("rate", "3>f4", RADIANS),
    0x8020: Field("rate", "3>f4", RADIANS),
    0xE020: Field("status", ">u4", _STATUS),
}
# Fields that resemble a specific force.
_NO_FORCE = {
    0xC810: "increments of an MTw (0xC810), not accelerations: export them as text with MT Manager",
    0x4030: "free acceleration (gravity removed), not the specific force: enable acceleration 0x4020 in the device",
    0x4010: "velocity increments, not the specific force: enable acceleration 0x4020 in the device",
}


def _sizes(data: Bytes, places: Integers) -> Integers:
    """Sizes of messages, with one byte of length or, after 0xFF, two."""
    length = data[places + 3].astype(int)
    readable = places + 6 <= len(data)
    long = np.zeros(len(places), int)
    long[readable] = column(data, places[readable], 4, ">u2")
    return np.where(length == 0xFF, (long + 7) * (long <= _LARGEST_EXTENDED), length + 5)


def _check(rows: Bytes) -> Bytes:
    """The byte with which all bytes after the preamble add up to 0, shape (n, 1)."""
    return (-byte_sum(rows[:, 1:])).astype(np.uint8)[:, None]


def messages(*sync: bytes) -> Frames:
    """Messages that begin with these bytes."""
    return Frames(sync, header=4, sizes=_sizes, intact=ends_with(_check, 1))


def _in_format(field: Field, code: int) -> Field:
    """A field of floating-point numbers in one of the formats."""

    def numbers(words: NDArray) -> Floats:
        exact = words["whole"] + words["fraction"] / 2.0**32 if words.dtype.names else words
        return field.unit.read(exact / 2.0**20 if words.dtype.kind == "i" else exact)

    return Field(field.quantity, np.dtype((_FORMATS[code], np.dtype(field.kind).shape)), Unit(numbers))


def layout_of(message: bytes) -> Layout:
    """The layout of a message; unknown fields, and fields of a wrong size, are skipped."""
    if message[2] != MTDATA2:
        return Layout({}, [2])
    at, stop = 6 if message[3] == 0xFF else 4, len(message) - 1
    describing, present, places = [2, 3], dict[int, str](), dict[int, tuple[Field, int]]()
    while at < stop:
        describing += range(at, min(at + 3, stop))
        if at + 3 > stop or at + 3 + message[at + 2] > stop:
            break
        identifier, size = int.from_bytes(message[at : at + 2], "big"), message[at + 2]
        name, at = identifier & 0xFFF0, at + 3
        present.setdefault(
            name, f"a specific force 0x{identifier:04X} of {size} bytes does not fit its number format: not read"
        )
        if field := _FIELDS.get(name):
            field = _in_format(field, identifier & 3) if np.dtype(field.kind).base.kind == "f" else field
            if size == np.dtype(field.kind).itemsize:
                places[name] = field, at
        at += size
    wrong = [words for name, words in present.items() if name in (0x4020, 0x4040)]
    wrong += [f"messages have {_NO_FORCE[name]}" for name in present if name in _NO_FORCE]
    # A message without a force (for example of satellites) uses a number of the counter: no sample is lost there.
    event = "other_message" if _COUNTER in present else ""
    return Layout(dict(places[name] for name in _FIELDS if name in places), describing, next(iter(wrong), ""), event)


def encode(samples: Samples, settings: Settings) -> bytes:
    """Messages with counter, temperature, specific force, rate and status, in float32."""
    parts = list[bytes | Field]()
    for name in (_COUNTER, 0x0810, 0x4020, 0x8020, 0xE020):
        parts += [name.to_bytes(2, "big") + bytes([np.dtype(_FIELDS[name].kind).itemsize]), _FIELDS[name]]
    payload = frames_of(samples, *parts)
    rows = frames_of(samples, bytes([0xFA, 0xFF, MTDATA2, payload.shape[1]]), payload)
    return frames_of(samples, rows, _check(rows)).tobytes()


PROTOCOL = Protocol(
    name="xsens",
    title="Xsens (Movella) MTi, MTData2",
    decoder=lambda settings=UNKNOWN: FrameDecoder(reading(layout_of), messages(b"\xfa", b"\xff"), lock_after=3),
    encode=encode,
    bauds=(115200, 921600, 2000000, 460800),
    counter=DeviceCounter(modulus=65536, ticks_per_s=None),
)
