"""Inertial Labs user-defined data: little-endian, 16-bit sum.

0xAA 0x55, type, message, length, then (message 0x95) a number of field identifiers, the fields' data, and the sum of
the bytes behind the preamble. 0x23 specific force 1e-6 g, 0x21 rate 1e-5 deg/s, 0x52 temperature 0.1 degC, 0x53 status.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import RunningSums
from tumblecal.capture.decoding.framing import (
    Found,
    FrameDecoder,
    Refusals,
    column,
    cut_header,
    decoded_by_layout,
    places_of,
    select,
)
from tumblecal.capture.decoding.samples import Event, Samples, Settings, Status, blank
from tumblecal.capture.protocols import Protocol


_PREAMBLE = b"\xaa\x55"
_USER_DEFINED = 0x95
_FORCE, _RATE, _TEMPERATURE, _STATUS = 0x23, 0x21, 0x52, 0x53
_SIZES = {_FORCE: 12, _RATE: 12, _TEMPERATURE: 2, _STATUS: 2}
_LARGEST = 1024


class InertialLabsFraming:
    """Messages of an Inertial Labs unit."""

    lock_after = 1
    between = b""

    def __init__(self) -> None:
        self._refusals = Refusals()

    def begins(self, data: NDArray[np.uint8], offset: int) -> bool:
        """Whether the preamble is at this place."""
        return data[offset : offset + 2].tobytes() == _PREAMBLE

    def find(self, data: NDArray[np.uint8], final: bool) -> Found:
        """All messages with a correct checksum."""
        places = places_of(data, _PREAMBLE)
        places = places[places + 6 <= len(data)]
        sizes = data[places + 4].astype(np.int64) + 256 * data[places + 5].astype(np.int64) + 2
        sane = (sizes >= 8) & (sizes <= _LARGEST)
        places, sizes = places[sane], sizes[sane]
        whole = np.flatnonzero(places + sizes <= len(data))
        good = np.zeros(len(places), bool)
        start, stop = places[whole], places[whole] + sizes[whole]
        sent = data[stop - 2].astype(np.int64) + 256 * data[stop - 1].astype(np.int64)
        good[whole] = RunningSums(data).plain(start + 2, stop - 2) % 65536 == sent
        return select(places, sizes, good, len(data), final, cut_header(data, _PREAMBLE, 6, final))

    def parse(self, data: NDArray[np.uint8], found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        """One sample a user-defined message with a specific force."""
        events: list[Event] = []

        def decode(starts: NDArray[np.int64], size: int, layout: tuple[dict[int, int], int | None]) -> Samples | None:
            places, hiding = layout
            if hiding is not None:
                text = f"a field 0x{hiding:02X} of unknown size precedes the specific force 0x23: make 0x23 the first field"
                events.extend(self._refusals.event(int(starts[0]) + size + offset, text))
            return _samples(data, starts, places)

        measured = (data[found.starts + 3] == _USER_DEFINED) & (found.sizes >= 9)
        messages = Found(found.starts[measured], found.sizes[measured], found.limit)
        return decoded_by_layout(data, messages, offset, _layout, decode), events


def _layout(message: bytes) -> tuple[tuple[dict[int, int], int | None], list[int]]:
    """Place of each field's data, a field of unknown size that hides the specific force, and its place."""
    stop = len(message) - 2
    identifiers = message[7 : min(7 + message[6], stop)]
    describing = list(range(6, 7 + len(identifiers)))
    places, at = {}, 7 + message[6]
    for identifier in identifiers:
        size = _SIZES.get(identifier)
        if size is None or at + size > stop:
            hidden = size is None and _FORCE in identifiers and _FORCE not in places
            return (places, identifier if hidden else None), describing
        places[identifier], at = at, at + size
    return (places, None), describing


def _samples(data: NDArray[np.uint8], starts: NDArray[np.int64], places: dict[int, int]) -> Samples | None:
    if _FORCE not in places:
        return None
    samples = blank(len(starts))
    samples.force[:] = column(data, starts, places[_FORCE], "<i4", 3) * 1e-6
    if _RATE in places:
        samples.rate[:] = column(data, starts, places[_RATE], "<i4", 3) * 1e-5
    if _TEMPERATURE in places:
        samples.temperature[:] = column(data, starts, places[_TEMPERATURE], "<i2") * 0.1
    if _STATUS in places:
        word = column(data, starts, places[_STATUS], "<u2")
        samples.status[:] = np.where(word != 0, Status.ERROR, 0)
    return samples


def encode(samples: Samples, settings: Settings) -> bytes:
    """Messages with specific force, rate, temperature and status."""
    n = len(samples)
    identifiers = bytes([_FORCE, _RATE, _TEMPERATURE, _STATUS])
    content = [
        np.rint(samples.force * 1e6).astype("<i4").view(np.uint8).reshape(n, 12),
        np.rint(np.nan_to_num(samples.rate) * 1e5).astype("<i4").view(np.uint8).reshape(n, 12),
        np.rint(np.nan_to_num(samples.temperature) * 10).astype("<i2").view(np.uint8).reshape(n, 2),
        np.where(samples.status, 1, 0).astype("<u2").view(np.uint8).reshape(n, 2),
    ]
    body = np.hstack([np.tile(np.frombuffer(bytes([4]) + identifiers, np.uint8), (n, 1)), *content])
    length = body.shape[1] + 6
    head = np.array([1, _USER_DEFINED, length & 0xFF, length >> 8], np.uint8)
    rows = np.hstack([np.tile(head, (n, 1)), body])
    check = (rows.sum(1) % 65536).astype("<u2").view(np.uint8).reshape(n, 2)
    return np.hstack([np.tile(np.frombuffer(_PREAMBLE, np.uint8), (n, 1)), rows, check]).tobytes()


PROTOCOL = Protocol(
    name="inertial_labs",
    title="Inertial Labs user-defined data",
    decoder=lambda settings=None: FrameDecoder(InertialLabsFraming()),
    encode=encode,
    bauds=(115200, 460800, 921600),
)
