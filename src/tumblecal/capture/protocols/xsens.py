"""Xsens (Movella) MTi, MTData2 messages: big-endian, self-describing fields, 8-bit sum.

0xFA, 0xFF, message 0x36, length, then fields of identifier (2 bytes), size (1) and content; all bytes after the
preamble add up to 0 modulo 256. The low bits of an identifier state its number format.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import RunningSums
from tumblecal.capture.decoding.framing import (
    Found,
    FrameDecoder,
    Refusals,
    cut_header,
    decoded_by_layout,
    places_of,
    select,
)
from tumblecal.capture.decoding.samples import Event, Samples, Settings, Status, blank, not_a_number
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


MTDATA2 = 0x36
_COUNTER, _SAMPLE_TIME_FINE, _TEMPERATURE, _STATUS = 0x1020, 0x1060, 0x0810, 0xE020
_FORCE, _FORCE_HIGH_RATE, _RATE, _RATE_HIGH_RATE = 0x4020, 0x4040, 0x8020, 0x8040
# Count of numbers in the fields that are read; all others are skipped by their size.
_COUNTS = {
    _COUNTER: 1,
    _SAMPLE_TIME_FINE: 1,
    _FORCE: 3,
    _FORCE_HIGH_RATE: 3,
    _RATE: 3,
    _RATE_HIGH_RATE: 3,
    _TEMPERATURE: 1,
    _STATUS: 1,
}
_LARGEST_EXTENDED = 4096
# Fields of plain integers: type code; all others follow the format bits.
_INTEGERS = {0x1020: ">u2", 0x1060: ">u4", 0x3010: ">u4", 0xE020: ">u4", 0xE010: ">u1"}


_SIZES = (4, 4, 6, 8)
# Fields of three numbers that resemble a specific force.
_NO_FORCE = {0x4030: "free acceleration (gravity removed)", 0x4010: "velocity increments"}
_OF_MTW = 0xC810


def fits(identifier: int, size: int, count: int) -> bool:
    """Whether a field of `size` bytes has `count` numbers of its format."""
    kind = _INTEGERS.get(identifier & 0xFFF0)
    return size == count * (np.dtype(kind).itemsize if kind else _SIZES[identifier & 3])


def numbers(identifier: int, raw: NDArray[np.uint8]) -> NDArray:
    """The numbers in one field of many frames: raw bytes, shape (frames, size), to shape (frames, numbers).

    Formats: 0 float32, 1 fixed point 12.20, 2 fixed point 16.32 (fraction first), 3 float64. The size must fit.
    """
    raw = np.ascontiguousarray(raw)
    kind = _INTEGERS.get(identifier & 0xFFF0)
    if kind:
        return raw.view(kind)
    match identifier & 3:
        case 0:
            return raw.view(">f4").astype(float)
        case 1:
            return raw.view(">i4") / 2.0**20
        case 2:
            words = raw.reshape(len(raw), -1, 6)
            fraction = np.ascontiguousarray(words[:, :, :4]).view(">u4")[:, :, 0]
            whole = np.ascontiguousarray(words[:, :, 4:]).view(">i2")[:, :, 0]
            return whole + fraction / 2.0**32
        case _:
            return raw.view(">f8").astype(float)


def fields_of(payload: bytes) -> list[tuple[int, int, int]]:
    """Identifier, place and size of each field of a message; ends where the message does not add up."""
    fields, at = [], 0
    while at + 3 <= len(payload):
        size = payload[at + 2]
        if at + 3 + size > len(payload):
            break
        fields.append((int.from_bytes(payload[at : at + 2], "big"), at + 3, size))
        at += 3 + size
    return fields


def messages_in(data: NDArray[np.uint8], preamble: bytes, final: bool) -> Found:
    """All messages with a correct checksum that begin with `preamble`, and of one or two bytes of size after the type."""
    places = places_of(data, preamble)
    places = places[places + 4 <= len(data)]
    short = data[places + 3].astype(np.int64)
    extended, readable = short == 0xFF, places + 6 <= len(data)
    high, low = (data[np.minimum(places + k, len(data) - 1)].astype(np.int64) for k in (4, 5))
    long = np.where(extended & readable, 256 * high + low, 0)
    sizes = np.where(extended, 7 + long, 5 + short)
    sane = long <= _LARGEST_EXTENDED
    places, sizes = places[sane], sizes[sane]
    whole = places + sizes <= len(data)
    good = np.zeros(len(places), bool)
    good[whole] = RunningSums(data).plain(places[whole] + 1, places[whole] + sizes[whole]) % 256 == 0
    return select(places, sizes, good, len(data), final, cut_header(data, preamble, 4, final))


class XsensFraming:
    """Messages of an MTi."""

    lock_after = 3
    between = b""

    def __init__(self) -> None:
        self._refusals = Refusals()

    def begins(self, data: NDArray[np.uint8], offset: int) -> bool:
        """Whether the preamble is at this place."""
        return data[offset : offset + 2].tobytes() == b"\xfa\xff"

    def find(self, data: NDArray[np.uint8], final: bool) -> Found:
        """All messages with a correct checksum."""
        return messages_in(data, b"\xfa\xff", final)

    def parse(self, data: NDArray[np.uint8], found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        """One sample a message with a specific force; unknown fields, and fields of a wrong size, are skipped."""
        events: list[Event] = []

        def decode(starts: NDArray[np.int64], size: int, layout: list[tuple[int, int, int]]) -> Samples | None:
            samples = samples_of(data, starts, layout)
            if samples is not None:
                return samples
            if why := no_force_words(layout):
                events.extend(self._refusals.event(int(starts[0]) + size + offset, why))
            if any(identifier & 0xFFF0 == _COUNTER for identifier, _, _ in layout):
                # Such a message (for example of satellites) uses a number of the counter: no sample is lost there.
                events.extend(Event(int(start) + size + offset, "other_message", {}) for start in starts)
            return None

        messages = data[found.starts + 2] == MTDATA2
        measured = Found(found.starts[messages], found.sizes[messages], found.limit)
        return decoded_by_layout(data, measured, offset, layout_of, decode), events


def layout_of(message: bytes) -> tuple[list[tuple[int, int, int]], list[int]]:
    """Identifier, place and size of the fields of a message, and the places of the bytes that state them."""
    header = 6 if message[3] == 0xFF else 4
    fields = [(identifier, header + at, size) for identifier, at, size in fields_of(message[header:-1])]
    describing = [3, *(at + k for _, at, _ in fields for k in (-3, -2, -1))]
    # If the fields end early: the size that does not fit.
    end = fields[-1][1] + fields[-1][2] if fields else header
    return fields, describing + [at for at in range(end, end + 3) if at < len(message) - 1]


def no_force_words(layout: list[tuple[int, int, int]]) -> str:
    """Why a message without a readable specific force has none, if it has something like it; "" otherwise."""
    for identifier, _, size in layout:
        if identifier & 0xFFF0 in (_FORCE, _FORCE_HIGH_RATE):
            return f"a specific force 0x{identifier:04X} of {size} bytes does not fit its number format: not read"
    for identifier, _, _ in layout:
        if identifier == _OF_MTW:
            return "messages have increments of an MTw (0xC810), not accelerations: export them as text with MT Manager"
        if name := _NO_FORCE.get(identifier & 0xFFF0):
            return f"messages have {name}, not the specific force: enable acceleration 0x4020 in the device"
    return ""


def samples_of(
    data: NDArray[np.uint8], starts: NDArray[np.int64], layout: list[tuple[int, int, int]]
) -> Samples | None:
    """Samples of messages of one layout, which begin at `starts`; None if these have no specific force."""
    values = {
        identifier & 0xFFF0: numbers(identifier, data[(starts + at)[:, None] + np.arange(size)])
        for identifier, at, size in layout
        if fits(identifier, size, _COUNTS.get(identifier & 0xFFF0, 0)) and size
    }
    force = values.get(_FORCE, values.get(_FORCE_HIGH_RATE))
    if force is None:
        return None
    samples = blank(len(starts))
    samples.force[:] = force / STANDARD_GRAVITY_MS2
    rate = values.get(_RATE, values.get(_RATE_HIGH_RATE))
    if rate is not None:
        samples.rate[:] = np.degrees(rate)
    if _TEMPERATURE in values:
        samples.temperature[:] = values[_TEMPERATURE][:, 0]
    if _COUNTER in values:
        samples.counter[:] = values[_COUNTER][:, 0]
    if _SAMPLE_TIME_FINE in values:
        samples.clock[:] = values[_SAMPLE_TIME_FINE][:, 0]
    if _STATUS in values:
        word = values[_STATUS][:, 0].astype(np.int64)
        samples.status[:] |= np.where(word & 0x3F00, Status.OVERLOAD, 0).astype(np.uint8)
        samples.status[:] |= np.where(word & 1, 0, Status.ERROR).astype(np.uint8)
    samples.status[:] |= not_a_number(samples.force)
    return samples


def encode(samples: Samples, settings: Settings) -> bytes:
    """Messages with counter, temperature, specific force, rate and status, in float32."""
    n = len(samples)
    clip = np.where(samples.status & Status.OVERLOAD, 0x0700, 0) | np.where(samples.status & Status.ERROR, 0, 1)
    fields = [
        (_COUNTER, (samples.counter % 65536).astype(">u2")),
        (_TEMPERATURE, np.nan_to_num(samples.temperature).astype(">f4")),
        (_FORCE, (samples.force * STANDARD_GRAVITY_MS2).astype(">f4")),
        (_RATE, np.radians(np.nan_to_num(samples.rate)).astype(">f4")),
        (_STATUS, clip.astype(">u4")),
    ]
    columns = []
    for identifier, values in fields:
        content = np.ascontiguousarray(values).view(np.uint8).reshape(n, -1)
        header = np.array([identifier >> 8, identifier & 0xFF, content.shape[1]], np.uint8)
        columns += [np.tile(header, (n, 1)), content]
    payload = np.hstack(columns)
    rows = np.hstack([np.tile(np.array([0xFF, MTDATA2, payload.shape[1]], np.uint8), (n, 1)), payload])
    check = (-rows.sum(1) % 256).astype(np.uint8)[:, None]
    return np.hstack([np.full((n, 1), 0xFA, np.uint8), rows, check]).tobytes()


PROTOCOL = Protocol(
    name="xsens",
    title="Xsens (Movella) MTi, MTData2",
    decoder=lambda settings=None: FrameDecoder(XsensFraming()),
    encode=encode,
    bauds=(115200, 921600, 2000000, 460800),
    counter=DeviceCounter(modulus=65536, ticks_per_s=None),
)
