"""STIM300's datagrams after datasheet TS1524: places in all frames, and contents of the special ones.

A frame is: identifier; the clusters that are switched on, each three 24-bit values and a status byte (temperatures:
three 16-bit values and a status byte); with PPS or AUX a 24-bit value and a status byte; a counter of internal
2000 Hz samples; a latency; the CRC, for which dummy zero bytes are added that are not sent. Big-endian.
"""

from itertools import accumulate
from typing import Any

import numpy as np

from tumblecal.capture.decoding.checks import crc32_mpeg2
from tumblecal.capture.decoding.samples import Bytes, Settings


def _places(clusters: str, temperatures: bool, extra: bool) -> dict[str, int]:
    """Place of each part of a normal frame, in order: clusters g, a, i (gyros, accelerometers, inclinometers), and its size."""
    parts = dict.fromkeys(clusters, 10) | {f"{c} temperature": 7 for c in clusters if temperatures}
    parts |= {"extra": 4} if extra else {}
    return dict(zip([*parts, "counter", "size"], accumulate([*parts.values(), 7], initial=1), strict=True))


_KINDS = [(clusters, temperatures) for temperatures in (False, True) for clusters in ("g", "ga", "gi", "gai")]
_PLAIN = (0x90, 0x91, 0x92, 0x93, 0x94, 0xA5, 0xA6, 0xA7)
_PPS = (0xF0, 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7)
_AUX = (0x98, 0x99, 0x9A, 0x9B, 0x9C, 0xAD, 0xAE, 0xAF)
# Places in the normal frames, by identifier.
PLACES = {
    identifier: _places(*kind, extra=ids is not _PLAIN)
    for ids in (_PLAIN, _PPS, _AUX)
    for identifier, kind in zip(ids, _KINDS, strict=True)
}
# Identifiers of the special frames, the second of which ends with CR LF, and their size.
SPECIALS = {
    "part_number": (0xB1, 0xB3, 20),
    "serial_number": (0xB5, 0xB7, 20),
    "configuration": (0xBC, 0xBD, 26),
    "error": (0xBE, 0xBF, 21),
    "bias_trim": (0xD1, 0xD2, 40),
}
KIND_OF = {identifier: kind for kind, (*pair, _) in SPECIALS.items() for identifier in pair}
# Size of the frame of each identifier; 0 for none.
SIZES = np.zeros(256, np.uint8)
SIZES[list(PLACES)] = [places["size"] for places in PLACES.values()]
SIZES[list(KIND_OF)] = [SPECIALS[kind][2] for kind in KIND_OF.values()]

RATES_HZ = (125.0, 250.0, 500.0, 1000.0, 2000.0)
BAUDS = (374400, 460800, 921600, 1843200)
_RANGE_G = {0: 10.0, 3: 5.0, 4: 30.0, 6: 80.0}
_RANGE_CODES = {value: code for code, value in _RANGE_G.items()}
OUTPUTS = {0: "acceleration", 1: "increment", 2: "average", 3: "integrated in gs", 4: "integrated"}
CRLF = b"\r\n"


def check(rows: Bytes) -> Bytes:
    """The CRC of frames without it, shape (n, 4); dummy bytes make their size a multiple of four."""
    return crc32_mpeg2(rows, -rows.shape[1] % 4).astype(">u4")[:, None].view(np.uint8)


def special_content(kind: str, frame: bytes) -> dict[str, Any]:
    """The contents of a special frame."""
    content: dict[str, Any] = {"raw": frame.hex()}
    if kind == "serial_number":
        content["serial_number"] = frame[1:2].decode("latin-1") + frame[2:9].hex()
    elif kind == "part_number":
        content["part_number"] = frame[1:9].hex() + "-" + frame[9:13].hex()
    elif kind == "configuration":
        content |= _configuration(frame)
    return content


def _configuration(frame: bytes) -> dict[str, Any]:
    rate, baud, unit = frame[3] >> 5, frame[4] >> 4, frame[8] & 0x0F
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
        "range_g": [_RANGE_G.get(code) for code in (frame[17] >> 4, frame[17] & 0x0F, frame[18] >> 4)],
    }


def settings_of(content: dict[str, Any]) -> Settings:
    """The settings of a configuration datagram."""
    known = None if None in content["range_g"] else tuple(content["range_g"])
    return Settings(known, content["output"], content["rate_hz"])


def encode_special(kind: str, body: bytes) -> bytes:
    """A special frame: `body` fills the bytes after the identifier, followed by zeros."""
    identifier, _, size = SPECIALS[kind]
    row = bytes([identifier]) + body.ljust(size - 5, b"\0")
    return row + check(np.frombuffer(row, np.uint8)[None]).tobytes()


def encode_configuration(settings: Settings) -> bytes:
    """The reply to "C" for a device with these settings that sends all clusters, all low-pass filters at 16 Hz."""
    rate = RATES_HZ.index(settings.rate_hz or 125.0) << 5
    x, y, z = (_RANGE_CODES[range_g] for range_g in settings.range_g or (10.0,) * 3)
    unit = next(code for code, name in OUTPUTS.items() if name == settings.output)
    body = bytearray(21)
    body[:4] = 0x2D, 5, rate | 0x06 | 0x08 * settings.temperatures, BAUDS.index(921600) << 4
    body[4], body[7], body[10] = 0x70, 0x70 | unit, 0x70
    body[16:18] = x << 4 | y, z << 4
    return encode_special("configuration", bytes(body))


def answer(command: bytes, settings: Settings, serial: str) -> bytes:
    """The reply of the device; empty for a command without a reply."""
    match command.strip():
        case b"I":  # a letter and 14 digits
            return encode_special("serial_number", serial[:1].encode() + bytes.fromhex(serial[1:].zfill(14)))
        case b"N":
            return encode_special("part_number", bytes.fromhex("8516710000002600 0100"))
        case b"C":
            return encode_configuration(settings)
    return b""
