"""Inertial Labs user-defined data: little-endian, 16-bit sum.

0xAA 0x55, type, message, length, then (message 0x95) a number of field identifiers, the fields' data, and the sum of
the bytes behind the preamble. 0x23 specific force 1e-6 g, 0x21 rate 1e-5 deg/s, 0x52 temperature 0.1 degC, 0x53 status.
"""

import numpy as np

from tumblecal.capture.decoding.checks import byte_sum, ends_with
from tumblecal.capture.decoding.fields import Field, Layout, Unit, frames_of, reading, scaled
from tumblecal.capture.decoding.framing import FrameDecoder, Frames, column
from tumblecal.capture.decoding.samples import UNKNOWN, Bytes, Integers, Samples, Settings, Status
from tumblecal.capture.protocols import Protocol


_USER_DEFINED, _FORCE = 0x95, 0x23
_FIELDS = {
    _FORCE: Field("force", "3<i4", scaled(1e-6)),
    0x21: Field("rate", "3<i4", scaled(1e-5)),
    0x52: Field("temperature", "<i2", scaled(0.1)),
    0x53: Field("status", "<u2", Unit(lambda words: (words != 0) * Status.ERROR, lambda status: status > 0)),
}


def _sizes(data: Bytes, places: Integers) -> Integers:
    sizes = column(data, places, 4, "<u2").astype(int) + 2
    return sizes * ((sizes >= 8) & (sizes <= 1024))


def _check(rows: Bytes) -> Bytes:
    """The sum behind the preamble, shape (n, 2)."""
    return byte_sum(rows[:, 2:]).astype("<u2")[:, None].view(np.uint8)


_MESSAGES = Frames(
    sync=(b"\xaa", b"\x55"),
    header=6,
    sizes=_sizes,
    intact=ends_with(_check, 2),
)


def _layout(message: bytes) -> Layout:
    stop = len(message) - 2
    if message[3] != _USER_DEFINED or len(message) < 9:
        return Layout({}, [3])
    at = 7 + message[6]
    identifiers, fields, refused = message[7 : min(at, stop)], dict[Field, int](), ""
    for identifier in identifiers:
        field = _FIELDS.get(identifier)
        if field is None and _FORCE in identifiers and _FIELDS[_FORCE] not in fields:
            refused = f"a field 0x{identifier:02X} of unknown size precedes the specific force 0x23: make 0x23 the first field"
        if field is None or at + np.dtype(field.kind).itemsize > stop:
            break
        fields[field], at = at, at + np.dtype(field.kind).itemsize
    return Layout(fields, [3, *range(6, 7 + len(identifiers))], refused)


def encode(samples: Samples, settings: Settings) -> bytes:
    """Messages with specific force, rate, temperature and status."""
    content = frames_of(samples, bytes([len(_FIELDS), *_FIELDS]), *_FIELDS.values())
    head = bytes([0xAA, 0x55, 1, _USER_DEFINED]) + (content.shape[1] + 6).to_bytes(2, "little")
    rows = frames_of(samples, head, content)
    return frames_of(samples, rows, _check(rows)).tobytes()


PROTOCOL = Protocol(
    name="inertial_labs",
    title="Inertial Labs user-defined data",
    decoder=lambda settings=UNKNOWN: FrameDecoder(reading(_layout), _MESSAGES),
    encode=encode,
    bauds=(115200, 460800, 921600),
)
