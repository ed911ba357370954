"""STIM300 (Safran, formerly Sensonor), after datasheet TS1524: binary frames with CRC-32, and datagrams on the device.

A frame is: identifier; the clusters that are switched on, each three 24-bit values and a status byte (temperatures:
three 16-bit values and a status byte); with PPS or AUX a 24-bit value and a status byte; a counter of internal
2000 Hz samples; a latency; the CRC, for which dummy zero bytes are added that are not sent. Big-endian.

The frame states neither the range nor the unit of the accelerometers: only the configuration datagram does, so without one
the specific force is NaN.
"""

from itertools import accumulate

import numpy as np

from tumblecal.capture.decoding.checks import crc32_mpeg2, ends_with
from tumblecal.capture.decoding.fields import Field, Unit, filled, frames_of, in_order
from tumblecal.capture.decoding.framing import Found, FrameDecoder, Frames, Reading, rows_of
from tumblecal.capture.decoding.samples import (
    UNKNOWN,
    Bytes,
    Entry,
    Event,
    Floats,
    Integers,
    Samples,
    Settings,
    Status,
    joined,
)  # fmt: skip
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_RATE_BITS, _INCLINATION_BITS, _LATENCY_US, _TICKS_PER_S, _CRLF = 14, 22, 506, 2000.0, b"\r\n"
# Bits of the fraction of an acceleration in g, by the range; of a velocity in m/s, three more.
_FRACTION_BITS = {5.0: 20, 10.0: 19, 30.0: 18, 80.0: 16}
# Bits of the device's status byte: 7 integrity, 6 start-up, 5 outside conditions, 4 overload, 3 channel.
_STATUS_BITS = {Status.ERROR: 0x88, Status.STARTING: 0x40, Status.OUTSIDE_CONDITIONS: 0x20, Status.OVERLOAD: 0x10}
_FLAGS = np.array([sum(flag for flag, bits in _STATUS_BITS.items() if byte & bits) for byte in range(256)], np.uint8)


def _places(clusters: str, temperatures: bool, extra: bool) -> dict[str, int]:
    """Place of each part of a normal frame, in order: clusters g, a, i (gyros, accelerometers, inclinometers), and its size."""
    parts = dict.fromkeys(clusters, 10) | {f"{c} temperature": 7 for c in clusters if temperatures}
    parts |= {"extra": 4} if extra else {}
    return dict(zip([*parts, "counter", "size"], accumulate([*parts.values(), 7], initial=1), strict=True))


# Places in the normal frames, by identifier: without, and with PPS or AUX.
_IDENTIFIERS = (
    bytes.fromhex("90 91 92 93 94 A5 A6 A7"),
    bytes.fromhex("F0 F1 F2 F3 F4 F5 F6 F7"),
    bytes.fromhex("98 99 9A 9B 9C AD AE AF"),
)
PLACES = {
    identifier: _places(("g", "ga", "gi", "gai")[kind % 4], kind >= 4, identifiers is not _IDENTIFIERS[0])
    for identifiers in _IDENTIFIERS
    for kind, identifier in enumerate(identifiers)
}
# Identifiers of the special frames, the second of which ends with CR LF, and their size.
_SPECIALS = {
    "part_number": (0xB1, 0xB3, 20),
    "serial_number": (0xB5, 0xB7, 20),
    "configuration": (0xBC, 0xBD, 26),
    "error": (0xBE, 0xBF, 21),
    "bias_trim": (0xD1, 0xD2, 40),
}
_KIND_OF = {identifier: kind for kind, (*pair, _) in _SPECIALS.items() for identifier in pair}
# Size of the frame of each identifier; 0 for none.
SIZES = np.zeros(256, np.uint8)
SIZES[list(PLACES)] = [places["size"] for places in PLACES.values()]
SIZES[list(_KIND_OF)] = [_SPECIALS[kind][2] for kind in _KIND_OF.values()]
_RATES_HZ = (125.0, 250.0, 500.0, 1000.0, 2000.0)
_BAUDS = (374400, 460800, 921600, 1843200)
_RANGE_G = {0: 10.0, 3: 5.0, 4: 30.0, 6: 80.0}
_OUTPUTS = {0: "acceleration", 1: "increment", 2: "average", 3: "integrated in gs", 4: "integrated"}


def _check(rows: Bytes) -> Bytes:
    """The CRC of frames without it, shape (n, 4); dummy bytes make their size a multiple of four."""
    return crc32_mpeg2(rows, -rows.shape[1] % 4).astype(">u4")[:, None].view(np.uint8)


_FRAMES = Frames(
    sync=(bytes(np.flatnonzero(SIZES).tolist()),),
    header=1,
    sizes=lambda data, places: SIZES[data[places]].astype(int),
    intact=ends_with(_check, 4),
)


def _words24(raw: Bytes) -> Integers:
    """Three 24-bit numbers of each frame, shape (n, 3): the first three bytes of 32 bits, in ten bytes, shape (n, 10)."""
    return np.ndarray((len(raw), 3), ">i4", raw, strides=(10, 3)) >> 8


def _bytes24(values: Floats) -> Bytes:
    """The inverse, with a status byte of zero."""
    words = np.clip(np.rint(values), -(2**23), 2**23 - 1).astype(">i4")[:, :, None]
    return np.pad(words.view(np.uint8)[:, :, 1:].reshape(-1, 9), ((0, 0), (0, 1)))


_RATE = Unit(lambda raw: _words24(raw) * 2.0**-_RATE_BITS, lambda dps: _bytes24(dps * 2.0**_RATE_BITS))
_DEGC = Unit(lambda words: words.mean(axis=1) / 256.0, lambda degc: (degc * 256)[:, None].repeat(3, axis=1))
# Fields of the parts of a normal frame; the specific force as the device sends it.
_FIELDS = {
    "g": Field("rate", "10u1", _RATE),
    "a": Field("force", "10u1", Unit(_words24, _bytes24)),
    "a temperature": Field("temperature", "3>i2", _DEGC),
    "counter": Field("counter", "u1"),
}


def _normal(data: Bytes, starts: Integers, places: dict[str, int]) -> Samples:
    """The samples of normal frames of one kind."""
    rows = rows_of(data, starts, places["size"])
    samples = filled(rows, {field: places[name] for name, field in _FIELDS.items() if name in places})
    samples.stop[:] = starts + places["size"]
    for cluster in {"g", "a"} & {*places}:
        samples.status[:] |= _FLAGS[rows[:, places[cluster] + 9]]
    return samples


def _content(kind: str, frame: bytes) -> Entry:
    """The contents of a special frame."""
    content: Entry = {"raw": frame.hex()}
    match kind:
        case "serial_number":
            content["serial_number"] = frame[1:2].decode("latin-1") + frame[2:9].hex()
        case "part_number":
            content["part_number"] = frame[1:9].hex() + "-" + frame[9:13].hex()
        case "configuration":
            rate, baud, unit = frame[3] >> 5, frame[4] >> 4, frame[8] & 0x0F
            content |= {
                "revision": chr(frame[1]) if 32 <= frame[1] < 127 else str(frame[1]),
                "firmware": frame[2],
                "rate_hz": dict(enumerate(_RATES_HZ)).get(rate),
                "clusters": "g" + "a" * bool(frame[3] & 0x02) + "i" * bool(frame[3] & 0x04),
                "temperatures": bool(frame[3] & 0x08),
                "pps_or_aux": bool(frame[3] & 0x10),
                "crlf": bool(frame[3] & 0x01),
                "baud": dict(enumerate(_BAUDS)).get(baud),
                "output": _OUTPUTS.get(unit & 0x07, f"unknown ({unit})"),
                "range_g": [_RANGE_G.get(code) for code in (frame[17] >> 4, frame[17] & 0x0F, frame[18] >> 4)],
            }
    return content


def settings_of(content: Entry) -> Settings:
    """The settings of a configuration datagram."""
    known = None if None in content["range_g"] else tuple(content["range_g"])
    return Settings(known, content["output"], content["rate_hz"])


def _reading(settings: Settings) -> Reading:
    """Reads samples from the normal frames; a configuration sets the scale of those after it.

    `settings`: range, output and rate from other sources.
    """
    last = _normal(np.zeros(256, np.uint8), np.zeros(1, int), PLACES[0x91])
    last.force[:] = np.nan

    def scale(samples: Samples) -> None:
        """Convert the specific force to standard g; NaN if range or unit are unknown."""
        nonlocal last
        words, velocity = samples.force, (settings.rate_hz or np.nan) / 8 / STANDARD_GRAVITY_MS2
        g_per_unit = [2.0 ** -_FRACTION_BITS[range_g] for range_g in settings.range_g or ()] or np.nan
        match settings.output:
            case "acceleration" | "average":
                words *= g_per_unit
            case "increment":
                words *= np.multiply(g_per_unit, velocity)
            case "integrated" if len(samples):
                # The change per internal tick; the 24-bit output wraps like the counter.
                whole = joined([last, samples])
                last = whole[-1:]
                ticks = np.diff(whole.counter)[:, None] % 256
                change = (np.diff(whole.force, axis=0) + 2**23) % 2**24 - 2**23
                per_s = np.where(ticks > 0, change / np.maximum(ticks, 1), np.nan) * _TICKS_PER_S
                words[:] = per_s * np.multiply(g_per_unit, velocity / (settings.rate_hz or np.nan))
            case _:
                words[:] = np.nan

    def read(data: Bytes, found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        nonlocal settings
        identifiers = data[found.starts]
        events, scaled = list[Event](), 0
        normal = [identifier for identifier in np.unique(identifiers).tolist() if identifier in PLACES]
        samples = in_order([_normal(data, found.starts[identifiers == kind], PLACES[kind]) for kind in normal])
        samples.stop[:] += offset
        for k in np.flatnonzero(np.isin(identifiers, list(_KIND_OF))).tolist():
            stop, kind = int(found.starts[k] + found.sizes[k]), _KIND_OF[int(identifiers[k])]
            event = Event(stop + offset, kind, _content(kind, data[found.starts[k] : stop].tobytes()))
            events.append(event)
            if kind == "configuration":
                following = int(np.searchsorted(samples.stop, event.stop))
                scale(samples[scaled:following])
                settings, scaled = settings_of(event.content), following
        scale(samples[scaled:])
        return samples, events

    return read


def encode(samples: Samples, settings: Settings, identifier: int | None = None, crlf: bool = False) -> bytes:
    """Normal frames of one kind, as a STIM300 with output "acceleration" sends them.

    **Arguments:**

    - `samples`: the samples; `status` goes into the accelerometers' status byte (the gyros' without them).
    - `settings`: the range gives the scale.
    - `identifier`: kind of frame; by default all clusters, with temperatures if the settings have them.
    - `crlf`: CR LF after every frame.
    """
    places, sent = PLACES[identifier or (0xA7 if settings.temperatures else 0x93)], samples.copy()
    sent.force[:] *= [2.0 ** _FRACTION_BITS[range_g] for range_g in settings.range_g or (10.0,) * 3]
    temperatures = frames_of(samples, _FIELDS["a temperature"], b"\0")
    parts = _FIELDS | {
        "a temperature": temperatures,
        "i": _bytes24(np.clip(np.nan_to_num(samples.force), -1.7, 1.7) * 2.0**_INCLINATION_BITS),
        "extra": bytes(4),
        "counter": frames_of(samples, _FIELDS["counter"], _LATENCY_US.to_bytes(2, "big")),
    }
    head = bytes([key for key, value in PLACES.items() if value is places])
    rows = frames_of(sent, head, *(parts.get(name, temperatures) for name in places if name != "size"))
    for flag, bits in _STATUS_BITS.items():
        rows[:, places["a" if "a" in places else "g"] + 9] |= ((samples.status & flag) > 0) * np.uint8(bits & 0xF0)
    return frames_of(samples, rows, _check(rows), _CRLF * crlf).tobytes()


def encode_special(kind: str, body: bytes) -> bytes:
    """A special frame: `body` fills the bytes after the identifier, followed by zeros."""
    identifier, _, size = _SPECIALS[kind]
    row = bytes([identifier]) + body.ljust(size - 5, b"\0")
    return row + _check(np.frombuffer(row, np.uint8)[None]).tobytes()


def encode_configuration(settings: Settings) -> bytes:
    """The reply to "C" for a device with these settings that sends all clusters, all low-pass filters at 16 Hz."""
    codes = {range_g: code for code, range_g in _RANGE_G.items()}
    x, y, z = (codes[range_g] for range_g in settings.range_g or (10.0,) * 3)
    unit = next(code for code, name in _OUTPUTS.items() if name == settings.output)
    rate = _RATES_HZ.index(settings.rate_hz or 125.0) << 5
    body = bytearray.fromhex("2D 05 00 20 70 00 00 70 00 00 70")
    body[2], body[7] = rate | 0x06 | 0x08 * settings.temperatures, 0x70 | unit
    return encode_special("configuration", bytes(body) + bytes([0] * 5 + [x << 4 | y, z << 4]))


def _answer(command: bytes, settings: Settings, serial: str) -> bytes:
    match command.strip():
        case b"I":  # a letter and 14 digits
            return encode_special("serial_number", serial[:1].encode() + bytes.fromhex(serial[1:].zfill(14)))
        case b"N":
            return encode_special("part_number", bytes.fromhex("8516710000002600 0100"))
        case b"C":
            return encode_configuration(settings)
    return b""


PROTOCOL = Protocol(
    name="stim300",
    title="STIM300 (Safran, Sensonor)",
    decoder=lambda settings=UNKNOWN: FrameDecoder(_reading(settings), _FRAMES, between=_CRLF),
    encode=encode,
    bauds=(921600, 1843200, 460800, 374400),
    counter=DeviceCounter(modulus=256, ticks_per_s=_TICKS_PER_S),
    queries=(b"I\r", b"C\r"),
    ranges_g=tuple(_FRACTION_BITS),
    range_from_stream=True,
    answer=_answer,
)
