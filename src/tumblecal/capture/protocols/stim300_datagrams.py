"""STIM300's datagrams after datasheet TS1524: layout of all frames, and contents of the special ones.

A frame is: identifier; the clusters that are switched on, each three 24-bit values and a status byte (temperatures:
three 16-bit values and a status byte); with PPS or AUX a 24-bit value and a status byte; a counter of internal
2000 Hz samples; a latency; the CRC, for which dummy zero bytes are added that are not sent. Big-endian.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Event, Settings, Status
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


@dataclass(frozen=True)
class FrameLayout:
    """One kind of normal frame: its clusters and their places."""

    acceleration: int | None = None
    inclination: int | None = None
    gyro_temperature: int | None = None
    acceleration_temperature: int | None = None
    inclination_temperature: int | None = None
    extra: int | None = None
    counter: int = 0
    size: int = 0
    padding: int = 0


def _layout(clusters: str, temperatures: bool, extra: bool) -> FrameLayout:
    at, places = 11, {}
    for letter, name in (("a", "acceleration"), ("i", "inclination")):
        if letter in clusters:
            places[name], at = at, at + 10
    if temperatures:
        for letter, name in (("g", "gyro"), ("a", "acceleration"), ("i", "inclination")):
            if letter in clusters:
                places[f"{name}_temperature"], at = at, at + 7
    if extra:
        places["extra"], at = at, at + 4
    return FrameLayout(**places, counter=at, size=at + 7, padding=-(at + 3) % 4)


_KINDS = [(clusters, temperatures) for temperatures in (False, True) for clusters in ("g", "ga", "gi", "gai")]
_PLAIN = (0x90, 0x91, 0x92, 0x93, 0x94, 0xA5, 0xA6, 0xA7)
_PPS = (0xF0, 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7)
_AUX = (0x98, 0x99, 0x9A, 0x9B, 0x9C, 0xAD, 0xAE, 0xAF)
LAYOUTS: dict[int, FrameLayout] = {
    identifier: _layout(*kind, extra=extra)
    for ids, extra in ((_PLAIN, False), (_PPS, True), (_AUX, True))
    for identifier, kind in zip(ids, _KINDS, strict=True)
}
# Identifier: (what, size, dummy bytes). The second of each pair ends with CR LF.
SPECIAL_PAIRS = {
    "part_number": (0xB1, 0xB3, 20, 0),
    "serial_number": (0xB5, 0xB7, 20, 0),
    "configuration": (0xBC, 0xBD, 26, 2),
    "error": (0xBE, 0xBF, 21, 3),
    "bias_trim": (0xD1, 0xD2, 40, 0),
}
SPECIALS: dict[int, tuple[str, int, int]] = {
    identifier: (what, size, padding)
    for what, (plain, with_crlf, size, padding) in SPECIAL_PAIRS.items()
    for identifier in (plain, with_crlf)
}

SIZES = np.zeros(256, np.int64)
PADDINGS = np.zeros(256, np.int64)
for _identifier, _kind in LAYOUTS.items():
    SIZES[_identifier], PADDINGS[_identifier] = _kind.size, _kind.padding
for _identifier, (_what, _size, _pad) in SPECIALS.items():
    SIZES[_identifier], PADDINGS[_identifier] = _size, _pad

RATES_HZ = (125.0, 250.0, 500.0, 1000.0, 2000.0)
BAUDS = (374400, 460800, 921600, 1843200)
_RANGE_G = {0: 10.0, 3: 5.0, 4: 30.0, 6: 80.0}
RANGE_CODES = {value: code for code, value in _RANGE_G.items()}
ACCELERATION_BITS = {5.0: 20, 10.0: 19, 30.0: 18, 80.0: 16}
VELOCITY_BITS = {5.0: 23, 10.0: 22, 30.0: 21, 80.0: 19}
OUTPUTS = {0: "acceleration", 1: "increment", 2: "average", 3: "integrated in gs", 4: "integrated"}
CRLF = b"\r\n"


# Bits of the device's status byte: 7 integrity, 6 start-up, 5 outside conditions, 4 overload, 3 channel.
STATUS_BITS = {
    Status.ERROR: 0x88,
    Status.STARTING: 0x40,
    Status.OUTSIDE_CONDITIONS: 0x20,
    Status.OVERLOAD: 0x10,
}


def status_flags(status: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """`Status` bits of the device's status bytes, shape (n,)."""
    flags = [np.where(status & bits, flag, 0) for flag, bits in STATUS_BITS.items()]
    return np.bitwise_or.reduce(flags).astype(np.uint8)


def special_event(identifier: int, frame: bytes, stop: int) -> Event:
    """The event of a special frame; `stop` is the place in the stream just after it."""
    kind = SPECIALS[identifier][0]
    content: dict = {"raw": frame.hex()}
    if kind == "serial_number":
        content["serial_number"] = frame[1:2].decode("latin-1") + frame[2:9].hex()
    elif kind == "part_number":
        content["part_number"] = frame[1:9].hex() + "-" + frame[9:13].hex()
    elif kind == "configuration":
        content |= configuration_of(frame)
    return Event(stop, kind, content)


def configuration_of(frame: bytes) -> dict[str, Any]:
    """The contents of a configuration datagram, in words and numbers."""
    rate = frame[3] >> 5
    baud = frame[4] >> 4
    unit = frame[8] & 0x0F
    ranges = (frame[17] >> 4, frame[17] & 0x0F, frame[18] >> 4)
    return {
        "revision": chr(frame[1]) if 32 <= frame[1] < 127 else str(frame[1]),
        "firmware": frame[2],
        "rate_hz": RATES_HZ[rate] if rate < len(RATES_HZ) else None,
        "clusters": "g" + "a" * bool(frame[3] & 0x02) + "i" * bool(frame[3] & 0x04),
        "temperatures": bool(frame[3] & 0x08),
        "pps_or_aux": bool(frame[3] & 0x10),
        "crlf": bool(frame[3] & 0x01),
        "baud": BAUDS[baud] if baud < len(BAUDS) else None,
        "output": OUTPUTS.get(unit & 0x07, f"unknown ({unit})"),
        "range_g": [_RANGE_G.get(code) for code in ranges],
    }


def settings_of(content: dict[str, Any]) -> Settings:
    """The settings of a configuration datagram."""
    ranges = content["range_g"]
    known = tuple(ranges) if all(r is not None for r in ranges) else None
    lsb = tuple(2.0 ** -ACCELERATION_BITS[r] for r in known) if known else None
    if known and content["output"] in ("increment", "integrated") and content["rate_hz"]:
        per_s = content["rate_hz"] / STANDARD_GRAVITY_MS2
        lsb = tuple(2.0 ** -VELOCITY_BITS[r] * per_s for r in known)
    return Settings(known, content["output"], content["rate_hz"], lsb)  # type: ignore[arg-type]
