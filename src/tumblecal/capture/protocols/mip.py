"""MicroStrain (HBK) MIP packets: big-endian, Fletcher check of two bytes.

0x75 0x65, descriptor set, payload length, fields of (length, descriptor, data), check over everything before it.
Sensor set 0x80: 0x04 scaled acceleration in g, 0x05 angular rate in rad/s.
"""

import numpy as np

from tumblecal.capture.decoding.checks import ends_with
from tumblecal.capture.decoding.fields import RADIANS, Field, Layout, frames_of, reading
from tumblecal.capture.decoding.framing import FrameDecoder, Frames
from tumblecal.capture.decoding.samples import UNKNOWN, Bytes, Samples, Settings
from tumblecal.capture.protocols import Protocol


# Fields of the sensor set, by their length and descriptor.
_SENSOR_SET, _FIELDS = 0x80, {b"\x0e\x04": Field("force", "3>f4"), b"\x0e\x05": Field("rate", "3>f4", RADIANS)}


def _check(rows: Bytes) -> Bytes:
    """Fletcher's pair modulo 256: the sum, and the sum of the running sums, shape (n, 2)."""
    running = np.cumsum(rows, axis=1, dtype=np.uint8)
    return np.stack([running[:, -1], running.sum(axis=1, dtype=np.uint8)], axis=1)


_PACKETS = Frames(
    sync=(b"\x75", b"\x65"),
    header=4,
    sizes=lambda data, places: data[places + 3].astype(int) + 6,
    intact=ends_with(_check, 2),
)


def _layout(packet: bytes) -> Layout:
    fields, describing, at, stop = dict[Field, int](), [2], 4, len(packet) - 2
    while at + 2 <= stop and packet[2] == _SENSOR_SET:
        describing += [at, at + 1]
        if packet[at] < 2 or at + packet[at] > stop:
            break
        if field := _FIELDS.get(packet[at : at + 2]):
            fields[field] = at + 2
        at += packet[at]
    return Layout(fields, describing)


def encode(samples: Samples, settings: Settings) -> bytes:
    """Packets with acceleration and angular rate."""
    parts = (part for head_and_field in _FIELDS.items() for part in head_and_field)
    rows = frames_of(samples, bytes([0x75, 0x65, _SENSOR_SET, 28]), *parts)
    return frames_of(samples, rows, _check(rows)).tobytes()


PROTOCOL = Protocol(
    name="mip",
    title="MicroStrain (HBK) MIP",
    decoder=lambda settings=UNKNOWN: FrameDecoder(reading(_layout), _PACKETS),
    encode=encode,
    bauds=(115200, 921600, 460800, 230400),
)
