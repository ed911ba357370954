"""MicroStrain (HBK) MIP packets: big-endian, Fletcher check of two bytes.

0x75 0x65, descriptor set, payload length, fields of (length, descriptor, data), check over everything before it.
Sensor set 0x80: 0x04 scaled acceleration in g, 0x05 angular rate in rad/s.
"""

import numpy as np

from tumblecal.capture.decoding.checks import ends_with
from tumblecal.capture.decoding.fields import Field, Layout, frames_of, reading
from tumblecal.capture.decoding.framing import FrameDecoder, Frames
from tumblecal.capture.decoding.samples import Bytes, Samples, Settings
from tumblecal.capture.protocols import Protocol


_SENSOR_SET, _FORCE, _RATE, _VECTOR_FIELD = 0x80, 0x04, 0x05, 14


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
    fields, describing, at = dict[str, Field](), [2], 4
    stop = len(packet) - 2
    while at + 2 <= stop and packet[2] == _SENSOR_SET:
        describing += [at, at + 1]
        if packet[at] < 2 or at + packet[at] > stop:
            break
        if packet[at] == _VECTOR_FIELD and packet[at + 1] == _FORCE:
            fields["force"] = Field(at + 2, "3>f4")
        elif packet[at] == _VECTOR_FIELD and packet[at + 1] == _RATE:
            fields["rate"] = Field(at + 2, "3>f4", np.degrees)
        at += packet[at]
    return Layout(fields, describing)


def encode(samples: Samples, settings: Settings) -> bytes:
    """Packets with acceleration and angular rate."""
    rate = np.radians(np.nan_to_num(samples.rate)).astype(">f4")
    head = bytes([0x75, 0x65, _SENSOR_SET, 2 * _VECTOR_FIELD, _VECTOR_FIELD, _FORCE])
    rows = frames_of(len(samples), head, samples.force.astype(">f4"), bytes([_VECTOR_FIELD, _RATE]), rate)
    return np.hstack([rows, _check(rows)]).tobytes()


PROTOCOL = Protocol(
    name="mip",
    title="MicroStrain (HBK) MIP",
    decoder=lambda settings=None: FrameDecoder(reading(_layout), _PACKETS),
    encode=encode,
    bauds=(115200, 921600, 460800, 230400),
)
