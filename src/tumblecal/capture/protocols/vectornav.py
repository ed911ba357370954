"""VectorNav: text lines with XOR or CRC-16 check, and binary messages with CRC-16; both may be in one stream.

`$VNxxx,...*CC` with two (exclusive or) or four (CRC-16) hexadecimal digits. Binary: 0xFA, a byte of groups, a 16-bit
word of fields a group, the payload little-endian, and the CRC-16 big-endian. VNIMU and the uncompensated binary
fields are suitable for calibration.
"""

from struct import unpack_from

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import crc16_xmodem, exclusive_or
from tumblecal.capture.decoding.framing import Found, FrameDecoder, Refusals, cut_header, places_of, select
from tumblecal.capture.decoding.samples import Event, Samples, Settings, blank, not_a_number
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


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
_TIME, _RATE_COMMON, _FORCE_COMMON, _IMU_COMMON = (0, 0), (0, 5), (0, 8), (0, 9)
_FORCE_RAW, _RATE_RAW, _TEMPERATURE, _FORCE, _RATE = (2, 2), (2, 3), (2, 4), (2, 9), (2, 10)
# Columns of the text messages: (specific force, angular rate or None, temperature or None).
_LINES: dict[str, tuple[int, int | None, int | None]] = {
    "VNIMU": (3, 6, 9),
    "VNCMV": (3, 6, 9),
    "VNACC": (0, None, None),
    "VNMAR": (3, 6, None),
    "VNYMR": (6, 9, None),
    "VNYCM": (6, 9, 12),
    "VNQTA": (4, None, None),
    "VNQMA": (7, None, None),
    "VNQAR": (4, 7, None),
    "VNQMR": (7, 10, None),
}
_INERTIAL = "acceleration along the axes of the Earth, not of the sensor"
_NO_GRAVITY = "acceleration of the body, with gravity removed"
_ESTIMATED = "the filter's estimate of the acceleration, with its biases removed"
# Accelerations that are not readings of the accelerometers.
_REFUSED_LINES = {
    "VNYIA": _INERTIAL,
    "VNICM": _INERTIAL,
    "VNYBA": _NO_GRAVITY,
    "VNISL": _ESTIMATED,
    "VNISE": _ESTIMATED,
    "VNRAW": "voltages",
    "VNDTV": "velocity increments",
}
_REFUSED_FIELDS = {
    (4, 5): _INERTIAL,
    (4, 6): _NO_GRAVITY,
    (4, 7): _INERTIAL,
    (5, 7): _INERTIAL,
    (5, 8): _INERTIAL,
}
_INSTEAD = "not the specific force: set the device's output to VNIMU or to the binary field UncompAccel"


def binary_layout(message: bytes) -> tuple[dict[tuple[int, int], int], int] | None:
    """Place of each field in a binary message, and the message's size; None for an unknown field, or none in a group."""
    groups = message[1]
    at = 2 + 2 * groups.bit_count()
    words = unpack_from(f"<{groups.bit_count()}H", message, 2)
    places = dict[tuple[int, int], int]()
    for group, word in zip((g for g in range(8) if groups >> g & 1), words, strict=True):
        sizes = FIELD_SIZES.get(group, ())
        if not 0 < word < 1 << len(sizes):
            return None
        for bit, size in enumerate(sizes):
            if word >> bit & 1:
                places[group, bit], at = at, at + size
    return places, at + 2


class VectorNavFraming:
    """Lines and binary messages of a VectorNav device."""

    lock_after = 1
    between = b""

    def __init__(self) -> None:
        self._refusals = Refusals()

    def begins(self, data: NDArray[np.uint8], offset: int) -> bool:
        """Whether a line or a binary message may begin at this place."""
        return data[offset : offset + 3].tobytes() == b"$VN" or (
            offset + 1 < len(data) and data[offset] == 0xFA and 0 < data[offset + 1] < 0x80
        )

    def find(self, data: NDArray[np.uint8], final: bool) -> Found:
        """All lines and messages with a correct checksum."""
        candidates = [(int(p), *self._line(data, int(p))) for p in places_of(data, b"$VN")]
        candidates += [(int(p), *self._binary(data, int(p))) for p in places_of(data, b"\xfa")]
        candidates = sorted(c for c in candidates if c[1])
        starts, sizes, good = (np.array([c[i] for c in candidates], np.int64) for i in range(3))
        limit = min(cut_header(data, b"$VN", 3, final), len(data))
        return select(starts, sizes, good.astype(bool), len(data), final, limit)

    def _line(self, data: NDArray[np.uint8], offset: int) -> tuple[int, bool]:
        """Size of the line (0: none) and whether its checksum is correct; a size beyond the end means incomplete."""
        text = data[offset : offset + _LONGEST_LINE].tobytes()
        end = text.find(b"\n")
        if end < 0:
            return (_LONGEST_LINE, False) if len(text) < _LONGEST_LINE else (0, False)
        return end + 1, line_ok(text[:end].rstrip(b"\r"))

    def _binary(self, data: NDArray[np.uint8], offset: int) -> tuple[int, bool]:
        head = data[offset : offset + 16].tobytes()
        if len(head) < 2:
            return 4, False
        groups = head[1]
        if not groups or groups >= 0x80:
            return 0, False
        if len(head) < 2 + 2 * groups.bit_count():
            return 2 + 2 * groups.bit_count(), False
        layout = binary_layout(head)
        if layout is None:
            return 0, False
        message = data[offset : offset + layout[1]].tobytes()
        return layout[1], len(message) == layout[1] and crc16_xmodem(message[1:]) == 0

    def parse(self, data: NDArray[np.uint8], found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        """One sample a line or message with a specific force; other lines become events."""
        rows: list[tuple[int, list[float], list[float], float, int]] = []
        events: list[Event] = []
        for start, size in zip(found.starts.tolist(), found.sizes.tolist(), strict=True):
            stop = start + size + offset
            message = data[start : start + size].tobytes()
            text = "" if message[0] == 0xFA else message.decode("ascii", "replace").strip()
            row = _line_row(text) if text else _binary_row(message)
            if row is not None:
                rows.append((stop, *row))
            elif why := _REFUSED_LINES.get(text[1:6]) if text else _refused_field(message):
                events += self._refusals.event(stop, f"{text[1:6] or 'a binary message'} has {why}, {_INSTEAD}")
            elif text:
                events.append(_event(stop, text))
        samples = blank(len(rows))
        if rows:
            samples.stop[:] = [r[0] for r in rows]
            samples.force[:] = np.array([r[1] for r in rows]) / STANDARD_GRAVITY_MS2
            samples.rate[:] = np.degrees([r[2] for r in rows])
            samples.temperature[:] = [r[3] for r in rows]
            samples.counter[:] = [r[4] for r in rows]
            samples.status[:] = not_a_number(samples.force)
        return samples, events


def _event(stop: int, text: str) -> Event:
    if text.startswith("$VNERR"):
        return Event(stop, "error", {"text": text})
    if text.startswith("$VNRRG,03,"):
        return Event(stop, "serial_number", {"serial_number": text[10:].partition("*")[0]})
    return Event(stop, "reply", {"text": text})


def line_ok(line: bytes) -> bool:
    """Whether `$...*CC` has the correct checksum, of two or of four digits."""
    body, star, check = line[1:].rpartition(b"*")
    try:
        value = int(check, 16)
    except ValueError:
        return False
    if not star or len(check) not in (2, 4):
        return False
    return value == (exclusive_or(body) if len(check) == 2 else crc16_xmodem(body))


_NAN3 = [float("nan")] * 3


def _line_row(text: str) -> tuple[list[float], list[float], float, int] | None:
    name, *words = text[1:].rpartition("*")[0].split(",")
    places = _LINES.get(name)
    if places is None:
        return None
    while words and words[-1][:1] in ("I", "S", "T", "V"):
        # The device may add a count, a time or a status after the numbers.
        words = words[:-1]
    try:
        values = [float(w) for w in words]
    except ValueError:
        return None
    force, rate, temperature = places
    if len(values) < max(force, rate or 0) + 3:
        return None
    known = temperature is not None and len(values) > temperature
    return (
        values[force : force + 3],
        values[rate : rate + 3] if rate is not None else _NAN3,
        values[temperature] if known and temperature is not None else float("nan"),
        -1,
    )


def _fields(message: bytes) -> dict[tuple[int, int], int]:
    """Place of each field in a binary message."""
    layout = binary_layout(message)
    return layout[0] if layout is not None else {}


def _binary_row(message: bytes) -> tuple[list[float], list[float], float, int] | None:
    places = _fields(message)
    force_at = next((places[k] for k in (_FORCE_RAW, _IMU_COMMON, _FORCE, _FORCE_COMMON) if k in places), None)
    if force_at is None:
        return None
    rate_at = places.get(_RATE_RAW)
    if rate_at is None and _IMU_COMMON in places:
        rate_at = places[_IMU_COMMON] + 12
    rate_at = rate_at if rate_at is not None else places.get(_RATE, places.get(_RATE_COMMON))
    temperature_at = places.get(_TEMPERATURE)
    return (
        list(unpack_from("<3f", message, force_at)),
        list(unpack_from("<3f", message, rate_at)) if rate_at is not None else _NAN3,
        unpack_from("<f", message, temperature_at)[0] if temperature_at is not None else float("nan"),
        int.from_bytes(message[places[_TIME] : places[_TIME] + 8], "little") & (2**62 - 1) if _TIME in places else -1,
    )


def _refused_field(message: bytes) -> str | None:
    """The field of a binary message without specific force that resembles one."""
    places = _fields(message)
    return next((what for field, what in _REFUSED_FIELDS.items() if field in places), None)


def encode(samples: Samples, settings: Settings) -> bytes:
    """Binary messages with time since start-up (the samples' `counter`, in ns), raw force, raw rate, temperature."""
    n = len(samples)
    fields = 1 << 2 | 1 << 3 | 1 << 4
    head = np.frombuffer(bytes([0x05, 0x01, 0x00, fields, 0x00]), np.uint8)
    rows = np.hstack(
        [
            np.tile(head, (n, 1)),
            samples.counter.astype("<u8").view(np.uint8).reshape(n, 8),
            (samples.force * STANDARD_GRAVITY_MS2).astype("<f4").view(np.uint8).reshape(n, 12),
            np.radians(np.nan_to_num(samples.rate)).astype("<f4").view(np.uint8).reshape(n, 12),
            np.nan_to_num(samples.temperature).astype("<f4").view(np.uint8).reshape(n, 4),
        ]
    )
    return b"".join(b"\xfa" + row + crc16_xmodem(row).to_bytes(2, "big") for row in (r.tobytes() for r in rows))


PROTOCOL = Protocol(
    name="vectornav",
    title="VectorNav, text and binary",
    decoder=lambda settings=None: FrameDecoder(VectorNavFraming()),
    encode=encode,
    bauds=(115200, 921600, 460800, 230400),
    counter=DeviceCounter(modulus=2**62, ticks_per_s=1e9),
    queries=(b"$VNRRG,03*XX\r\n",),
)
