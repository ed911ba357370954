"""STIM300 (Safran, formerly Sensonor): binary frames with CRC-32; the datagrams are in `stim300_datagrams`.

The frame states neither the range nor the unit of the accelerometers: only the configuration datagram does, so without one
the specific force is NaN.
"""

import numpy as np

from tumblecal.capture.decoding.checks import ends_with
from tumblecal.capture.decoding.fields import Field, Unit, filled, frames_of, in_order
from tumblecal.capture.decoding.framing import Found, FrameDecoder, Frames, Reading, rows_of
from tumblecal.capture.decoding.samples import Bytes, Event, Floats, Integers, Samples, Settings, Status
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.capture.protocols.stim300_datagrams import (
    CRLF,
    KIND_OF,
    PLACES,
    SIZES,
    answer,
    check,
    settings_of,
    special_content,
)
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_RATE_BITS, _INCLINATION_BITS, _LATENCY_US = 14, 22, 506
# Bits of the fraction of an acceleration in g, by the range; of a velocity in m/s, three more.
_FRACTION_BITS = {5.0: 20, 10.0: 19, 30.0: 18, 80.0: 16}
# Bits of the device's status byte: 7 integrity, 6 start-up, 5 outside conditions, 4 overload, 3 channel.
_STATUS_BITS = {
    Status.ERROR: 0x88,
    Status.STARTING: 0x40,
    Status.OUTSIDE_CONDITIONS: 0x20,
    Status.OVERLOAD: 0x10,
}
_FLAGS = np.array([sum(flag for flag, bits in _STATUS_BITS.items() if byte & bits) for byte in range(256)], np.uint8)

_FRAMES = Frames(
    sync=(SIZES.nonzero()[0].astype(np.uint8).tobytes(),),
    header=1,
    sizes=lambda data, places: SIZES[data[places]].astype(int),
    intact=ends_with(check, 4),
)


def _words24(raw: Bytes) -> Integers:
    """Three 24-bit numbers of each frame, shape (n, 3): the first three bytes of 32 bits, in ten bytes, shape (n, 10)."""
    return np.ndarray((len(raw), 3), ">i4", raw, strides=(10, 3)) >> 8


def _bytes24(values: Floats) -> Bytes:
    """The inverse, with a status byte of zero."""
    words = np.clip(np.rint(values), -(2**23), 2**23 - 1).astype(">i4")[:, :, None]
    return np.pad(words.view(np.uint8)[:, :, 1:].reshape(-1, 9), ((0, 0), (0, 1)))


# Fields of the parts of a normal frame; the specific force as the device sends it.
_FIELDS = {
    "g": Field(
        "rate",
        "10u1",
        Unit(lambda raw: _words24(raw) * 2.0**-_RATE_BITS, lambda dps: _bytes24(dps * 2.0**_RATE_BITS)),
    ),
    "a": Field("force", "10u1", Unit(_words24, _bytes24)),
    "a temperature": Field(
        "temperature",
        "3>i2",
        Unit(lambda words: words.mean(axis=1) / 256.0, lambda degc: (degc * 256)[:, None].repeat(3, axis=1)),
    ),
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


def _reading(settings: Settings | None) -> Reading:
    """Reads samples from the normal frames; a configuration sets the scale of those after it.

    `settings`: range, output and rate from other sources.
    """
    last_counter, last_words = 0, np.full((1, 3), np.nan)

    def scale(samples: Samples) -> None:
        """Convert the specific force to standard g; NaN if range or unit are unknown."""
        nonlocal last_counter, last_words
        words = samples.force
        if settings is None or settings.range_g is None or not len(samples):
            words[:] = np.nan
            return
        g_per_unit = np.array([2.0 ** -_FRACTION_BITS[range_g] for range_g in settings.range_g])
        ms_per_unit = g_per_unit / 8
        match settings.output:
            case "acceleration" | "average":
                words *= g_per_unit
            case "increment" if settings.rate_hz is not None:
                words[:] = words * ms_per_unit * settings.rate_hz / STANDARD_GRAVITY_MS2
            case "integrated" if settings.rate_hz is not None:
                # The change per internal tick; the 24-bit output wraps like the counter.
                ticks = np.diff(samples.counter, prepend=last_counter)[:, None] % 256
                change = (np.diff(words, axis=0, prepend=last_words) + 2**23) % 2**24 - 2**23
                last_counter, last_words = samples.counter[-1], words[-1:].copy()
                slope = np.where(ticks > 0, change / np.maximum(ticks, 1), np.nan)
                words[:] = slope * ms_per_unit * 2000.0 / STANDARD_GRAVITY_MS2
            case _:
                words[:] = np.nan

    def read(data: Bytes, found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        nonlocal settings
        identifiers = data[found.starts]
        events, scaled = list[Event](), 0
        normal = [identifier for identifier in np.unique(identifiers).tolist() if identifier in PLACES]
        samples = in_order([_normal(data, found.starts[identifiers == kind], PLACES[kind]) for kind in normal])
        samples.stop[:] += offset
        for k in np.flatnonzero(np.isin(identifiers, list(KIND_OF))).tolist():
            stop, kind = int(found.starts[k] + found.sizes[k]), KIND_OF[int(identifiers[k])]
            event = Event(stop + offset, kind, special_content(kind, data[found.starts[k] : stop].tobytes()))
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
    identifier = identifier or (0xA7 if settings.temperatures else 0x93)
    places, sent = PLACES[identifier], samples.copy()
    sent.force[:] *= [2.0 ** _FRACTION_BITS[range_g] for range_g in settings.range_g or (10.0,) * 3]
    temperatures = frames_of(samples, _FIELDS["a temperature"], b"\0")
    parts = {
        "g": _FIELDS["g"],
        "a": _FIELDS["a"],
        "i": _bytes24(np.clip(np.nan_to_num(samples.force), -1.7, 1.7) * 2.0**_INCLINATION_BITS),
        "extra": bytes(4),
        "counter": frames_of(samples, _FIELDS["counter"], _LATENCY_US.to_bytes(2, "big")),
    }
    rows = frames_of(sent, bytes([identifier]), *(parts.get(name, temperatures) for name in places if name != "size"))
    for flag, bits in _STATUS_BITS.items():
        rows[:, places["a" if "a" in places else "g"] + 9] |= ((samples.status & flag) > 0) * np.uint8(bits & 0xF0)
    return frames_of(samples, rows, check(rows), CRLF * crlf).tobytes()


PROTOCOL = Protocol(
    name="stim300",
    title="STIM300 (Safran, Sensonor)",
    decoder=lambda settings=None: FrameDecoder(_reading(settings), _FRAMES, between=CRLF),
    encode=encode,
    bauds=(921600, 1843200, 460800, 374400),
    counter=DeviceCounter(modulus=256, ticks_per_s=2000.0),
    queries=(b"I\r", b"C\r"),
    ranges_g=(5.0, 10.0, 30.0, 80.0),
    range_from_stream=True,
    answer=answer,
)
