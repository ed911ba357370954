"""MicroStrain (HBK) MIP packets: big-endian, Fletcher check of two bytes.

0x75 0x65, descriptor set, payload length, fields of (length, descriptor, data), check over everything before it.
Sensor set 0x80: 0x04 scaled acceleration in g, 0x05 angular rate in rad/s.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import RunningSums
from tumblecal.capture.decoding.framing import (
    Found,
    FrameDecoder,
    column,
    cut_header,
    decoded_by_layout,
    places_of,
    select,
)
from tumblecal.capture.decoding.samples import Event, Samples, Settings, blank, not_a_number
from tumblecal.capture.protocols import Protocol


_SENSOR_SET, _FORCE, _RATE = 0x80, 0x04, 0x05
_VECTOR_FIELD = 14
_PREAMBLE = b"\x75\x65"


class MipFraming:
    """Packets of a MicroStrain device."""

    lock_after = 1
    between = b""

    def begins(self, data: NDArray[np.uint8], offset: int) -> bool:
        """Whether the preamble is at this place."""
        return data[offset : offset + 2].tobytes() == _PREAMBLE

    def find(self, data: NDArray[np.uint8], final: bool) -> Found:
        """All packets with a correct checksum."""
        places = places_of(data, _PREAMBLE)
        places = places[places + 4 <= len(data)]
        sizes = data[places + 3].astype(np.int64) + 6
        whole = np.flatnonzero(places + sizes <= len(data))
        good = np.zeros(len(places), bool)
        start, stop = places[whole], places[whole] + sizes[whole]
        first, second = RunningSums(data).fletcher(start, stop - 2)
        good[whole] = (first == data[stop - 2]) & (second == data[stop - 1])
        return select(places, sizes, good, len(data), final, cut_header(data, _PREAMBLE, 4, final))

    def parse(self, data: NDArray[np.uint8], found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        """One sample a packet of the sensor set with an acceleration."""

        def decode(starts: NDArray[np.int64], size: int, places: dict[int, int]) -> Samples | None:
            if _FORCE not in places:
                return None
            samples = blank(len(starts))
            samples.force[:] = column(data, starts, places[_FORCE], ">f4", 3)
            if _RATE in places:
                samples.rate[:] = np.degrees(column(data, starts, places[_RATE], ">f4", 3).astype(float))
            samples.status[:] = not_a_number(samples.force)
            return samples

        measured = data[found.starts + 2] == _SENSOR_SET
        packets = Found(found.starts[measured], found.sizes[measured], found.limit)
        return decoded_by_layout(data, packets, offset, _layout, decode), []


def _layout(packet: bytes) -> tuple[dict[int, int], list[int]]:
    """Place of the data of each field of three numbers, and of the bytes that state it."""
    places, describing, at = {}, [], 4
    stop = len(packet) - 2
    while at + 2 <= stop:
        describing += [at, at + 1]
        if packet[at] < 2 or at + packet[at] > stop:
            break
        if packet[at] == _VECTOR_FIELD:
            places[packet[at + 1]] = at + 2
        at += packet[at]
    return places, describing


def encode(samples: Samples, settings: Settings) -> bytes:
    """Packets with acceleration and angular rate."""
    n = len(samples)
    force = samples.force.astype(">f4").view(np.uint8).reshape(n, 12)
    rate = np.radians(np.nan_to_num(samples.rate)).astype(">f4").view(np.uint8).reshape(n, 12)
    head = np.tile(np.array([0x75, 0x65, _SENSOR_SET, 28, 14, _FORCE], np.uint8), (n, 1))
    middle = np.tile(np.array([14, _RATE], np.uint8), (n, 1))
    rows = np.hstack([head, force, middle, rate])
    running = np.cumsum(rows, axis=1, dtype=np.int64)
    check = np.stack([running[:, -1] % 256, running.sum(1) % 256], axis=1).astype(np.uint8)
    return np.hstack([rows, check]).tobytes()


PROTOCOL = Protocol(
    name="mip",
    title="MicroStrain (HBK) MIP",
    decoder=lambda settings=None: FrameDecoder(MipFraming()),
    encode=encode,
    bauds=(115200, 921600, 460800, 230400),
)
