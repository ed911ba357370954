"""STIM300 (Safran, formerly Sensonor): binary frames with CRC-32, after datasheet TS1524.

A frame is: identifier; the clusters that are switched on, each three 24-bit values and a status byte (temperatures:
three 16-bit values and a status byte); with PPS or AUX a 24-bit value and a status byte; a counter of internal
2000 Hz samples; a latency; the CRC, for which dummy zero bytes are added that are not sent. Big-endian. The
frame tells neither the accelerometers' range nor their unit: only the configuration datagram does, so without one
the specific force stays NaN.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.checks import crc32_mpeg2, crc32_mpeg2_rows
from tumblecal.capture.framing import Found, FrameDecoder, select
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.capture.samples import Event, Samples, Settings, Status, blank
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


@dataclass(frozen=True)
class Layout:
    """One kind of normal frame: which clusters it has, and where they begin."""

    acceleration: int | None = None
    inclination: int | None = None
    gyro_temperature: int | None = None
    acceleration_temperature: int | None = None
    inclination_temperature: int | None = None
    extra: int | None = None
    counter: int = 0
    size: int = 0
    padding: int = 0


def _layout(clusters: str, temperatures: bool, extra: bool) -> Layout:
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
    return Layout(**places, counter=at, size=at + 7, padding=-(at + 3) % 4)


_KINDS = [
    ("g", False),
    ("ga", False),
    ("gi", False),
    ("gai", False),
    ("g", True),
    ("ga", True),
    ("gi", True),
    ("gai", True),
]
_PLAIN = (0x90, 0x91, 0x92, 0x93, 0x94, 0xA5, 0xA6, 0xA7)
_PPS = (0xF0, 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7)
_AUX = (0x98, 0x99, 0x9A, 0x9B, 0x9C, 0xAD, 0xAE, 0xAF)
LAYOUTS: dict[int, Layout] = {
    identifier: _layout(*kind, extra=extra)
    for ids, extra in ((_PLAIN, False), (_PPS, True), (_AUX, True))
    for identifier, kind in zip(ids, _KINDS, strict=True)
}
# Identifier: (what, size, dummy bytes). The second of each pair is the one with CR LF behind it.
_SPECIAL_PAIRS = {
    "part_number": (0xB1, 0xB3, 20, 0),
    "serial_number": (0xB5, 0xB7, 20, 0),
    "configuration": (0xBC, 0xBD, 26, 2),
    "error": (0xBE, 0xBF, 21, 3),
    "bias_trim": (0xD1, 0xD2, 40, 0),
}
SPECIALS: dict[int, tuple[str, int, int]] = {
    identifier: (what, size, padding)
    for what, (plain, with_crlf, size, padding) in _SPECIAL_PAIRS.items()
    for identifier in (plain, with_crlf)
}

_SIZE = np.zeros(256, np.int64)
_PADDING = np.zeros(256, np.int64)
for _identifier, _kind in LAYOUTS.items():
    _SIZE[_identifier], _PADDING[_identifier] = _kind.size, _kind.padding
for _identifier, (_what, _size, _pad) in SPECIALS.items():
    _SIZE[_identifier], _PADDING[_identifier] = _size, _pad

RATES_HZ = (125.0, 250.0, 500.0, 1000.0, 2000.0)
BAUDS = (374400, 460800, 921600, 1843200)
_RANGE_G = {0: 10.0, 3: 5.0, 4: 30.0, 6: 80.0}
_RANGE_CODES = {value: code for code, value in _RANGE_G.items()}
_ACCELERATION_BITS = {5.0: 20, 10.0: 19, 30.0: 18, 80.0: 16}
_VELOCITY_BITS = {5.0: 23, 10.0: 22, 30.0: 21, 80.0: 19}
_OUTPUTS = {0: "acceleration", 1: "increment", 2: "average", 3: "integrated in gs", 4: "integrated"}
_WINDOW = 4096
_CRLF = b"\r\n"


def _u8_column(data: NDArray[np.uint8], at: int, n: int, period: int) -> NDArray[np.uint8]:
    return data[at : at + (n - 1) * period + 1 : period]


def _check_ok(data: NDArray[np.uint8], starts: NDArray[np.int64], size: int, padding: int) -> NDArray[np.bool_]:
    sent = sum(data.take(starts + size - 4 + k).astype(np.uint32) << np.uint32(24 - 8 * k) for k in range(4))
    return crc32_mpeg2(data, starts, size - 4, padding) == sent


class Stim300Framing:
    """Frames of a STIM300 and their content.

    **Arguments:**

    - `settings`: range, output and rate when known from elsewhere; a configuration datagram replaces them.
    """

    lock_after = 1
    between = _CRLF

    def __init__(self, settings: Settings | None = None):
        self.settings = settings
        self._integrated: tuple[int, NDArray[np.int64]] | None = None

    def begins(self, data: NDArray[np.uint8], place: int) -> bool:
        """Whether the byte is a known identifier."""
        return place < len(data) and bool(_SIZE[data[place]])

    def find(self, data: NDArray[np.uint8], final: bool) -> Found:
        """All frames whose CRC is right; runs of equal frames are checked as a block."""
        starts, sizes, place, n = [], [], 0, len(data)
        while place < n:
            run, period = self._run(data, place)
            if run:
                size = int(_SIZE[data[place]])
                starts.append(place + period * np.arange(run))
                sizes.append(np.full(run, size))
                place += (run - 1) * period + size
                place += 2 * (data[place : place + 2].tobytes() == _CRLF)
                continue
            window = place + np.flatnonzero(_SIZE[data[place : place + _WINDOW]])
            found = self._among(data, window, final)
            starts.append(found.starts)
            sizes.append(found.sizes)
            if found.limit < n:
                return Found(np.concatenate(starts), np.concatenate(sizes), found.limit)
            end = int(found.starts[-1] + found.sizes[-1]) if len(found.starts) else 0
            place = max(end, place + _WINDOW)
        none = np.zeros(0, np.int64)
        return Found(np.concatenate([none, *starts]), np.concatenate([none, *sizes]), n)

    def _run(self, data: NDArray[np.uint8], place: int) -> tuple[int, int]:
        """How many right frames of one kind follow each other at `place`, and their distance."""
        size = int(_SIZE[data[place]])
        if not size or place + size > len(data):
            return 0, size
        with_crlf = data[place + size : place + size + 2].tobytes() == _CRLF
        period = size + 2 * with_crlf
        room = (len(data) - place - size) // period + 1
        done, block = 0, 16
        while done < room:
            block = min(block * 4, 16384, room - done)
            first = place + done * period
            rows = np.lib.stride_tricks.as_strided(data[first:], (block, size), (period, 1))
            good = rows[:, 0] == data[place]
            if with_crlf and first + (block - 1) * period + size + 2 <= len(data):
                good &= (_u8_column(data, first + size, block, period) == 13) & (
                    _u8_column(data, first + size + 1, block, period) == 10
                )
            sent = np.ndarray((block,), ">u4", data, first + size - 4, (period,))
            good &= crc32_mpeg2_rows(rows[:, : size - 4], int(_PADDING[data[place]])) == sent
            if not good.all():
                return done + int(np.argmin(good)), period
            done += block
        return done, period

    def _among(self, data: NDArray[np.uint8], places: NDArray[np.int64], final: bool) -> Found:
        """The right frames among candidate places."""
        identifiers = data[places]
        sizes = _SIZE[identifiers]
        whole = places + sizes <= len(data)
        good = np.zeros(len(places), bool)
        shape = 4 * sizes + _PADDING[identifiers]
        for code in np.unique(shape):
            these = np.flatnonzero(whole & (shape == code))
            if len(these):
                good[these] = _check_ok(data, places[these], int(code) // 4, int(code) % 4)
        return select(places, sizes, good, len(data), final)

    def parse(self, data: NDArray[np.uint8], found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        """Samples of the normal frames; events of the others, which also set the scale of what follows."""
        starts, sizes = found.starts, found.sizes
        identifiers = data[starts]
        normal = np.array([i in LAYOUTS for i in range(256)])[identifiers]
        samples = blank(int(normal.sum()))
        events: list[Event] = []
        row = 0
        # Stretches of one kind: a configuration in between changes the scale from there on.
        edges = np.flatnonzero(identifiers[1:] != identifiers[:-1]) + 1
        for begin, end in zip([0, *edges], [*edges, len(starts)], strict=True):
            if begin == end:
                continue
            identifier = int(identifiers[begin])
            if identifier in LAYOUTS:
                self._fill(samples, slice(row, row + end - begin), data, starts[begin:end], LAYOUTS[identifier])
                row += end - begin
                continue
            for start, size in zip(starts[begin:end].tolist(), sizes[begin:end].tolist(), strict=True):
                event = _special(identifier, data[start : start + size].tobytes(), offset + start + size)
                if event.kind == "configuration":
                    self.settings = settings_of(event.content)
                events.append(event)
        samples.stop[:] += offset
        return samples, events

    def _fill(
        self, out: Samples, rows: slice, data: NDArray[np.uint8], starts: NDArray[np.int64], layout: Layout
    ) -> None:
        def cluster(at: int) -> NDArray[np.int32]:
            return np.stack([_int24(data, starts, at + 3 * axis) for axis in range(3)], axis=1)

        status = _status_flags(data[starts + 10])
        out.stop[rows] = starts + layout.size
        out.rate[rows] = cluster(1) * 2.0**-14
        out.counter[rows] = data[starts + layout.counter]
        if layout.acceleration is not None:
            status = status | _status_flags(data[starts + layout.acceleration + 9])
            out.force[rows] = self._force(cluster(layout.acceleration), out.counter[rows])
        if layout.acceleration_temperature is not None:
            at = starts + layout.acceleration_temperature
            words = np.stack([data[at + 2 * k].astype(np.int8) * 256.0 + data[at + 2 * k + 1] for k in range(3)])
            out.temperature[rows] = words.mean(0) / 256.0
        out.status[rows] = status

    def _force(self, raw: NDArray[np.int32], counter: NDArray[np.int64]) -> NDArray[np.float64]:
        """Specific force in standard g; NaN when range or unit are not known."""
        settings = self.settings
        if settings is None or settings.range_g is None:
            return np.full(raw.shape, np.nan)
        if settings.output in ("acceleration", "average"):
            return raw.astype(np.float64) * np.array([2.0 ** -_ACCELERATION_BITS[r] for r in settings.range_g])
        velocity = np.array([2.0 ** -_VELOCITY_BITS[r] for r in settings.range_g])
        if settings.rate_hz is None or settings.output not in ("increment", "integrated"):
            return np.full(raw.shape, np.nan)
        if settings.output == "increment":
            return raw.astype(np.float64) * velocity * settings.rate_hz / STANDARD_GRAVITY_MS2
        return self._differences(raw.astype(np.int64), counter) * velocity * 2000.0 / STANDARD_GRAVITY_MS2

    def _differences(self, raw: NDArray[np.int64], counter: NDArray[np.int64]) -> NDArray[np.float64]:
        """Change of an integrated 24-bit output per internal tick; it wraps like the counter does."""
        previous = self._integrated
        before = np.vstack([raw[:1] if previous is None else previous[1], raw[:-1]])
        ticks = (counter - np.concatenate([[previous[0] if previous else -1], counter[:-1]])) % 256
        change = (raw - before + 2**23) % 2**24 - 2**23
        result = np.where((ticks > 0)[:, None], change / np.maximum(ticks, 1)[:, None], np.nan)
        if previous is None:
            result[0] = np.nan
        self._integrated = (int(counter[-1]), raw[-1:])
        return result


def _int24(data: NDArray[np.uint8], starts: NDArray[np.int64], at: int) -> NDArray[np.int32]:
    step = int(starts[1] - starts[0]) if len(starts) > 1 else 1
    if len(starts) > 1 and starts[-1] - starts[0] == step * (len(starts) - 1) and (np.diff(starts) == step).all():
        words = np.ndarray((len(starts),), ">i4", data, int(starts[0]) + at, (step,))
        return words.astype(np.int32) >> np.int32(8)
    high, middle, low = (data[starts + at + k].astype(np.int32) for k in range(3))
    return (((high ^ 0x80) - 0x80) << 16) | (middle << 8) | low


@cache
def _status_table() -> NDArray[np.uint8]:
    """The device's status byte as `Status` bits: 7 integrity, 6 start-up, 5 outside conditions, 4 overload, 3 channel."""
    table = np.zeros(256, np.uint8)
    for byte in range(256):
        flags = Status(0)
        if byte & 0x88:
            flags |= Status.ERROR
        if byte & 0x40:
            flags |= Status.STARTING
        if byte & 0x20:
            flags |= Status.OUTSIDE_CONDITIONS
        if byte & 0x10:
            flags |= Status.OVERLOAD
        table[byte] = flags
    return table


def _status_flags(status: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return _status_table()[status]


def _special(identifier: int, frame: bytes, stop: int) -> Event:
    kind = SPECIALS[identifier][0]
    content: dict = {"raw": frame.hex()}
    if kind == "serial_number":
        content["serial_number"] = frame[1:2].decode("latin-1") + frame[2:9].hex()
    elif kind == "part_number":
        content["part_number"] = frame[1:9].hex() + "-" + frame[9:13].hex()
    elif kind == "configuration":
        content |= configuration_of(frame)
    return Event(stop, kind, content)


def configuration_of(frame: bytes) -> dict:
    """What a configuration datagram says, in words and numbers."""
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
        "output": _OUTPUTS.get(unit & 0x07, f"unknown ({unit})"),
        "range_g": [_RANGE_G.get(code) for code in ranges],
    }


def settings_of(content: dict) -> Settings:
    """The scale that a configuration datagram sets."""
    ranges = content["range_g"]
    known = tuple(ranges) if all(r is not None for r in ranges) else None
    lsb = tuple(2.0 ** -_ACCELERATION_BITS[r] for r in known) if known else None
    if known and content["output"] in ("increment", "integrated") and content["rate_hz"]:
        per_s = content["rate_hz"] / STANDARD_GRAVITY_MS2
        lsb = tuple(2.0 ** -_VELOCITY_BITS[r] * per_s for r in known)
    return Settings(known, content["output"], content["rate_hz"], lsb)  # type: ignore[arg-type]


# --- the other way round: what a device sends -------------------------------------------------------------


def _sealed(rows: NDArray[np.uint8], padding: int, crlf: bool) -> bytes:
    """Rows of frames without CRC to bytes with CRC (and CR LF)."""
    check = crc32_mpeg2_rows(rows, padding).astype(">u4").view(np.uint8).reshape(-1, 4)
    ending = np.tile(np.frombuffer(_CRLF, np.uint8), (len(rows), 1))[:, : 2 * crlf]
    return np.concatenate([rows, check, ending], axis=1).tobytes()


def _put24(rows: NDArray[np.uint8], at: int, values: NDArray[np.float64]) -> None:
    words = np.clip(np.rint(values), -(2**23), 2**23 - 1).astype(">i4").view(np.uint8).reshape(len(rows), 3, 4)
    rows[:, at : at + 9] = words[:, :, 1:].reshape(len(rows), 9)


def _put16(rows: NDArray[np.uint8], at: int, values: NDArray[np.float64]) -> None:
    words = np.clip(np.rint(values * 256), -(2**15), 2**15 - 1).astype(">i2")
    rows[:, at : at + 6] = np.repeat(words[:, None], 3, 1).view(np.uint8).reshape(len(rows), 6)


def encode(
    samples: Samples,
    settings: Settings,
    identifier: int = 0x93,
    crlf: bool = False,
    latency_us: int = 506,
) -> bytes:
    """Normal frames of one kind, as a STIM300 with output "acceleration" sends them.

    **Arguments:**

    - `samples`: what to send; `status` goes into the accelerometers' status byte (the gyros' without them).
    - `settings`: the range gives the scale.
    - `identifier`: kind of frame.
    - `crlf`: CR LF behind every frame.
    - `latency_us`: the latency field.
    """
    layout = LAYOUTS[identifier]
    n = len(samples)
    rows = np.zeros((n, layout.size - 4), np.uint8)
    rows[:, 0] = identifier
    _put24(rows, 1, np.nan_to_num(samples.rate) * 2.0**14)
    status_at = 10
    if layout.acceleration is not None:
        scale = np.array([2.0 ** _ACCELERATION_BITS[r] for r in settings.range_g or (10.0,) * 3])
        _put24(rows, layout.acceleration, samples.force * scale)
        status_at = layout.acceleration + 9
    if layout.inclination is not None:
        _put24(rows, layout.inclination, np.clip(np.nan_to_num(samples.force), -1.7, 1.7) * 2.0**22)
    temperature = np.nan_to_num(samples.temperature)
    for at in (layout.gyro_temperature, layout.acceleration_temperature, layout.inclination_temperature):
        if at is not None:
            _put16(rows, at, temperature)
    bits = {Status.STARTING: 0x40, Status.OVERLOAD: 0x10, Status.ERROR: 0x80, Status.OUTSIDE_CONDITIONS: 0x20}
    for flag, bit in bits.items():
        rows[:, status_at] |= np.where(samples.status & flag, bit, 0).astype(np.uint8)
    rows[:, layout.counter] = samples.counter % 256
    rows[:, layout.counter + 1] = latency_us >> 8
    rows[:, layout.counter + 2] = latency_us & 0xFF
    return _sealed(rows, layout.padding, crlf)


def encode_special(kind: str, body: bytes, crlf: bool = False) -> bytes:
    """A special frame: `body` fills the bytes after the identifier, with zeros behind it."""
    plain, with_crlf, size, padding = _SPECIAL_PAIRS[kind]
    row = bytes([with_crlf if crlf else plain]) + body.ljust(size - 5, b"\0")
    return _sealed(np.frombuffer(row, np.uint8)[None, :], padding, crlf)


def encode_serial_number(serial: str, crlf: bool = False) -> bytes:
    """The reply to "I": a letter and 14 digits."""
    return encode_special("serial_number", serial[:1].encode() + bytes.fromhex(serial[1:].zfill(14)), crlf)


def encode_configuration(settings: Settings, identifier: int = 0x93, crlf: bool = False, baud: int = 921600) -> bytes:
    """The reply to "C" for a device with these settings, all low-pass filters at 16 Hz."""
    layout = LAYOUTS[identifier]
    clusters = 0x02 * (layout.acceleration is not None) + 0x04 * (layout.inclination is not None)
    temperatures = 0x08 * (layout.gyro_temperature is not None)
    rate = RATES_HZ.index(settings.rate_hz or 125.0) << 5
    baud_code = BAUDS.index(baud) if baud in BAUDS else 15
    codes = [_RANGE_CODES[r] for r in settings.range_g or (10.0,) * 3]
    unit = next(code for code, name in _OUTPUTS.items() if name == settings.output)
    body = bytearray(21)
    body[0:4] = bytes(
        [0x2D, 5, rate | 0x10 * (layout.extra is not None) | temperatures | clusters | crlf, baud_code << 4]
    )
    body[4], body[7], body[10] = 0x70, 0x70 | unit, 0x70
    body[16], body[17] = codes[0] << 4 | codes[1], codes[2] << 4
    return encode_special("configuration", bytes(body), crlf)


def _decoder(settings: Settings | None = None) -> FrameDecoder:
    return FrameDecoder(Stim300Framing(settings))


def _encode_stream(samples: Samples, settings: Settings) -> bytes:
    return encode(samples, settings)


def _answer(command: bytes, settings: Settings, serial: str) -> bytes:
    """What the device sends back; empty for a command that has no reply."""
    replies = {
        b"I": lambda: encode_serial_number(serial),
        b"N": lambda: encode_special("part_number", bytes.fromhex("8516710000002600") + b"\x01\x00"),
        b"C": lambda: encode_configuration(settings),
        b"E": lambda: encode_special("error", b""),
        b"T": lambda: encode_special("bias_trim", b""),
    }
    return replies.get(command.strip(), lambda: b"")()


def _with_range(settings: Settings, range_g: float) -> Settings:
    lsb = 2.0 ** -_ACCELERATION_BITS[range_g]
    return replace(settings, range_g=(range_g,) * 3, lsb_g=(lsb,) * 3)


PROTOCOL = Protocol(
    name="stim300",
    title="STIM300 (Safran, Sensonor)",
    decoder=_decoder,
    encode=_encode_stream,
    bauds=(921600, 1843200, 460800, 374400),
    counter=DeviceCounter(modulus=256, ticks_per_s=2000.0),
    queries=(b"I\r", b"C\r"),
    ranges_g=(5.0, 10.0, 30.0, 80.0),
    range_from_stream=True,
    strong_check=True,
    answer=_answer,
    with_range=_with_range,
)
