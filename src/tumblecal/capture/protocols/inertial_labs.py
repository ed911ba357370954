"""Inertial Labs user-defined data: little-endian, 16-bit sum.

0xAA 0x55, type, message, length, then (message 0x95) a number of field identifiers, the fields' data, and the sum of
the bytes behind the preamble. 0x23 specific force 1e-6 g, 0x21 rate 1e-5 deg/s, 0x52 temperature 0.1 degC, 0x53 status.
"""

import numpy as np

from tumblecal.capture.decoding.checks import byte_sum, ends_with
from tumblecal.capture.decoding.fields import Field, Layout, frames_of, reading
from tumblecal.capture.decoding.framing import FrameDecoder, Frames, column
from tumblecal.capture.decoding.samples import Bytes, Integers, Samples, Settings, Status
from tumblecal.capture.protocols import Protocol


_USER_DEFINED, _FORCE, _LARGEST = 0x95, 0x23, 1024
# Quantity of each field identifier, with its numbers.
_FIELDS = {
    _FORCE: ("force", "3<i4", lambda words: words * 1e-6),
    0x21: ("rate", "3<i4", lambda words: words * 1e-5),
    0x52: ("temperature", "<i2", lambda words: words * 0.1),
    0x53: ("status", "<u2", lambda words: np.where(words != 0, Status.ERROR, 0)),
}


def _sizes(data: Bytes, places: Integers) -> Integers:
    sizes = column(data, places, 4, "<u2").astype(int) + 2
    return np.where((sizes >= 8) & (sizes <= _LARGEST), sizes, 0)


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
    identifiers = message[7 : min(at, stop)]
    describing = [3, *range(6, 7 + len(identifiers))]
    fields, refused = dict[str, Field](), ""
    for identifier in identifiers:
        name, kind, scaled = _FIELDS.get(identifier, ("", "V", np.asarray))
        if not name and _FORCE in identifiers and "force" not in fields:
            refused = f"a field 0x{identifier:02X} of unknown size precedes the specific force 0x23: make 0x23 the first field"
        if not name or at + np.dtype(kind).itemsize > stop:
            break
        fields[name], at = Field(at, kind, scaled), at + np.dtype(kind).itemsize
    return Layout(fields, describing, refused)


def encode(samples: Samples, settings: Settings) -> bytes:
    """Messages with specific force, rate, temperature and status."""
    content = frames_of(
        len(samples),
        bytes([len(_FIELDS), *_FIELDS]),
        np.rint(samples.force * 1e6).astype("<i4"),
        np.rint(np.nan_to_num(samples.rate) * 1e5).astype("<i4"),
        np.rint(np.nan_to_num(samples.temperature) * 10).astype("<i2"),
        np.where(samples.status, 1, 0).astype("<u2"),
    )
    head = bytes([0xAA, 0x55, 1, _USER_DEFINED]) + (content.shape[1] + 6).to_bytes(2, "little")
    rows = frames_of(len(samples), head, content)
    return np.hstack([rows, _check(rows)]).tobytes()


PROTOCOL = Protocol(
    name="inertial_labs",
    title="Inertial Labs user-defined data",
    decoder=lambda settings=None: FrameDecoder(reading(_layout), _MESSAGES),
    encode=encode,
    bauds=(115200, 460800, 921600),
)
