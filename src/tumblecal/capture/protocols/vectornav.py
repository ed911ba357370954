"""VectorNav: text lines with XOR or CRC-16 check, and binary messages with CRC-16; both may be in one stream.

`$VNxxx,...*CC` with two (exclusive or) or four (CRC-16) hexadecimal digits. Binary: 0xFA, a byte of groups, a 16-bit
word of fields a group, the payload little-endian, and the CRC-16 big-endian. VNIMU and the uncompensated binary
fields are suitable for calibration.
"""

import re
from functools import lru_cache
from struct import unpack_from

import numpy as np

from tumblecal.capture.decoding.checks import crc16_xmodem, exclusive_or
from tumblecal.capture.decoding.fields import MS2, RADIANS, Field, Layout, Unit, frames_of, in_order, reading
from tumblecal.capture.decoding.framing import Found, FrameDecoder, Frames
from tumblecal.capture.decoding.samples import UNKNOWN, Bytes, Event, Integers, Samples, Settings, samples_of
from tumblecal.capture.protocols import DeviceCounter, Protocol


_LONGEST_LINE = 256
# Bytes of each field, per group number (bit in the group byte), as in the vendor's library.
_SATELLITES = (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28)
FIELD_SIZES: dict[int, tuple[int, ...]] = {
    0: (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),
    1: (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),
    2: (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),
    3: _SATELLITES,
    4: (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24, 12),
    5: (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),
    6: _SATELLITES,
}
# The fields of each quantity, the preferred first: group, bit, place in the field.
_FIELDS = {
    Field("force", "3<f4", MS2): ((2, 2, 0), (0, 9, 0), (2, 9, 0), (0, 8, 0)),
    Field("rate", "3<f4", RADIANS): ((2, 3, 0), (0, 9, 12), (2, 10, 0), (0, 5, 0)),
    Field("temperature", "<f4"): ((2, 4, 0),),
    Field("counter", "<u8", Unit(lambda ns: ns & (2**62 - 1))): ((0, 0, 0),),
}
# Columns of the text messages: specific force, angular rate, temperature.
_LINES: dict[str, tuple[int, ...]] = {
    "VNIMU": (3, 6, 9),
    "VNCMV": (3, 6, 9),
    "VNACC": (0,),
    "VNMAR": (3, 6),
    "VNYMR": (6, 9),
    "VNYCM": (6, 9, 12),
    "VNQTA": (4,),
    "VNQMA": (7,),
    "VNQAR": (4, 7),
    "VNQMR": (7, 10),
}
_INERTIAL = "acceleration along the axes of the Earth, not of the sensor"
_NO_GRAVITY = "acceleration of the body, with gravity removed"
_ESTIMATED = "the filter's estimate of the acceleration, with its biases removed"
# Accelerations that are not readings of the accelerometers, in lines and in binary fields.
_REFUSED = {
    "VNYIA": _INERTIAL,
    "VNICM": _INERTIAL,
    "VNYBA": _NO_GRAVITY,
    "VNISL": _ESTIMATED,
    "VNISE": _ESTIMATED,
    "VNRAW": "voltages",
    "VNDTV": "velocity increments",
    (4, 5): _INERTIAL,
    (4, 6): _NO_GRAVITY,
    (4, 7): _INERTIAL,
    (5, 7): _INERTIAL,
    (5, 8): _INERTIAL,
}
_INSTEAD = "not the specific force: set the device's output to VNIMU or to the binary field UncompAccel"


def _head(message: bytes) -> bytes:
    """The byte of groups and the words of their fields."""
    return message[1 : 2 + 2 * message[1].bit_count()]


@lru_cache(maxsize=4096)
def _binary_places(head: bytes) -> tuple[dict[tuple[int, int], int], int]:
    """Place of each field in a message, and the message's size: 0 for an unknown or empty group."""
    places, at = dict[tuple[int, int], int](), 1 + len(head)
    words = iter(unpack_from(f"<{head[0].bit_count()}H", head, 1))
    for group in range(8):
        if head[0] >> group & 1:
            word, sizes = next(words), FIELD_SIZES.get(group, ())
            if not 0 < word < 1 << len(sizes):
                return {}, 0
            for bit, size in enumerate(sizes):
                if word >> bit & 1:
                    places[group, bit], at = at, at + size
    return places, at + 2


def _binary_size(data: bytes) -> int:
    """Size of the message, or of its head if that is incomplete."""
    size = 2 + 2 * data[1].bit_count()
    return _binary_places(_head(data))[1] if len(data) >= size else size


def _line_size(data: bytes) -> int:
    """Size of the line; 0 if it is too long, and a size beyond the end of the data if it is incomplete."""
    return data.find(b"\n") + 1 or _LONGEST_LINE * (len(data) < _LONGEST_LINE)


def _line_intact(line: bytes) -> bool:
    """Whether `$...*CC` has the correct check, of two or of four digits."""
    parts = re.fullmatch(rb"\$(.*)\*([0-9A-Fa-f]{2}|[0-9A-Fa-f]{4})\s*", line, re.DOTALL)
    return parts is not None and (exclusive_or, crc16_xmodem)[len(parts[2]) > 2](parts[1]) == int(parts[2], 16)


def _frames(sync: tuple[bytes, ...], header: int, size_of, is_intact, longest: int) -> Frames:
    """Frames whose size and check are those of their bytes, one after the other."""

    def sizes(data: Bytes, places: Integers) -> Integers:
        return np.array([size_of(data[at : at + longest].tobytes()) for at in places.tolist()], int)

    return Frames(sync, header, sizes, lambda rows: np.array([is_intact(row.tobytes()) for row in rows], bool))


_BINARY = _frames((b"\xfa", bytes(range(1, 0x80))), 2, _binary_size, lambda row: crc16_xmodem(row[1:]) == 0, 16)
_TEXT = _frames((b"$", b"V", b"N"), 3, _line_size, _line_intact, _LONGEST_LINE)


def _layout(message: bytes) -> Layout:
    places, _ = _binary_places(_head(message))
    fields = dict[Field, int]()
    for field, names in _FIELDS.items():
        for group, bit, at in reversed(names):
            if (group, bit) in places:
                fields[field] = places[group, bit] + at
    why = next((f"a binary message has {why}, {_INSTEAD}" for name, why in _REFUSED.items() if name in places), "")
    return Layout(fields, list(range(1, 1 + len(_head(message)))), why)


def _row(stop: int, text: str) -> tuple | None:
    """The values of the sample in a line; None for other lines."""
    # The device may add a count, a time or a status after the numbers.
    name, *words = re.sub(r"(,[ISTV][^,]*)*\*\w*$", "", text[1:]).split(",")
    try:
        values = np.array(words, float)
    except ValueError:
        return None
    force, rate, temperature = (*_LINES.get(name, (len(values),)), 0, 0)[:3]
    if len(values) < max(force, rate) + 3:
        return None
    rates = values[rate : rate + 3] if rate else np.nan
    degc = values[temperature] if 0 < temperature < len(values) else np.nan
    return stop, MS2.read(values[force : force + 3]), RADIANS.read(rates), degc, -1, 0, np.nan


def _event(stop: int, text: str) -> Event:
    if why := _REFUSED.get(text[1:6]):
        return Event(stop, "refused", {"text": f"{text[1:6]} has {why}, {_INSTEAD}"})
    if text.startswith("$VNRRG,03,"):
        return Event(stop, "serial_number", {"serial_number": text[10:].partition("*")[0]})
    return Event(stop, "error" if text.startswith("$VNERR") else "reply", {"text": text})


def _read(data: Bytes, found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
    """One sample a line or message with a specific force; other lines become events."""
    binary = data[found.starts] == 0xFA
    samples, events = reading(_layout)(data, Found(found.starts[binary], found.sizes[binary], 0), offset, final)
    rows = list[tuple]()
    for start, size in zip(found.starts[~binary].tolist(), found.sizes[~binary].tolist(), strict=True):
        text = data[start : start + size].tobytes().decode("ascii", "replace").strip()
        if row := _row(start + size + offset, text):
            rows.append(row)
        else:
            events.append(_event(start + size + offset, text))
    return in_order([samples, samples_of(rows)]), sorted(events, key=lambda event: event.stop)


def encode(samples: Samples, settings: Settings) -> bytes:
    """Binary messages with time since start-up (the samples' `counter`, in ns), raw force, raw rate, temperature."""
    force, rate, temperature, counter = _FIELDS
    rows = frames_of(samples, bytes([0x05, 0x01, 0x00, 0b11100, 0x00]), counter, force, rate, temperature)
    return b"".join(b"\xfa" + row.tobytes() + crc16_xmodem(row.tobytes()).to_bytes(2, "big") for row in rows)


PROTOCOL = Protocol(
    name="vectornav",
    title="VectorNav, text and binary",
    decoder=lambda settings=UNKNOWN: FrameDecoder(_read, _BINARY, _TEXT),
    encode=encode,
    bauds=(115200, 921600, 460800, 230400),
    counter=DeviceCounter(modulus=2**62, ticks_per_s=1e9),
    queries=(b"$VNRRG,03*XX\r\n",),
)
