"""WitMotion JY61, WT61, WT901, HWT905 and their clones: 11-byte frames with an 8-bit sum.

0x55, a type, four little-endian 16-bit words, the sum of the first ten bytes. One sample is a burst of types 0x51
(specific force, temperature), 0x52 (angular rate) and others; there is no counter. The full scale (16 g unless a
register was changed) is not in the stream.
"""

import numpy as np

from tumblecal.capture.decoding.checks import byte_sum, ends_with
from tumblecal.capture.decoding.fields import Field, Unit, filled, frames_of, scaled
from tumblecal.capture.decoding.framing import Found, FrameDecoder, Frames, Reading, rows_of
from tumblecal.capture.decoding.samples import UNKNOWN, Bytes, Event, Samples, Settings, blank, joined
from tumblecal.capture.protocols import Protocol


SIZE = 11
_FORCE, _RATE = 0x51, 0x52
_RATE_FIELD = Field("rate", "3<i2", scaled(2000 / 32768))
_TEMPERATURE = Field("temperature", "<i2", Unit(lambda words: words / 100.0, lambda degc: degc * 100))


def _check(rows: Bytes) -> Bytes:
    return byte_sum(rows).astype(np.uint8)[:, None]


_FRAMES = Frames(
    sync=(b"\x55", bytes(range(0x50, 0x60))),
    header=2,
    sizes=lambda data, places: np.full(len(places), SIZE),
    intact=ends_with(_check, 1),
)


def _force_field(settings: Settings) -> Field:
    return Field("force", "3<i2", scaled(np.array(settings.range_g or (16.0,) * 3) / 32768))


def _reading(settings: Settings) -> Reading:
    """Reads one sample a force frame, with the rate of the same burst if there is one."""
    waiting = blank(0)

    def read(data: Bytes, found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        nonlocal waiting
        forces, rates = (found.starts[data[found.starts + 1] == kind] for kind in (_FORCE, _RATE))
        fresh = filled(rows_of(data, forces, SIZE), {_force_field(settings): 2, _TEMPERATURE: 8})
        fresh.stop[:] = forces + SIZE + offset
        samples = joined([waiting, fresh])
        # The rate directly follows the force of its burst; a rate before any force belongs to none.
        owner = np.searchsorted(samples.stop, rates + offset, "right") - 1
        rates, owner = rates[owner >= 0], owner[owner >= 0]
        belongs = rates + offset - samples.stop[owner] < 2 * SIZE
        samples.rate[owner[belongs]] = filled(rows_of(data, rates[belongs], SIZE), {_RATE_FIELD: 2}).rate
        # The last sample waits for its rate.
        complete = len(samples) if final else max(len(samples) - 1, 0)
        waiting = samples[complete:]
        return samples[:complete], []

    return read


def encode(samples: Samples, settings: Settings) -> bytes:
    """Bursts of a force and a rate frame."""
    bursts = []
    for kind, field in ((_FORCE, _force_field(settings)), (_RATE, _RATE_FIELD)):
        rows = frames_of(samples, bytes([0x55, kind]), field, _TEMPERATURE)
        bursts += [rows, _check(rows)]
    return frames_of(samples, *bursts).tobytes()


PROTOCOL = Protocol(
    name="witmotion",
    title="WitMotion JY61, WT61, WT901, HWT905 and clones",
    decoder=lambda settings=UNKNOWN: FrameDecoder(_reading(settings), _FRAMES, lock_after=3),
    encode=encode,
    bauds=(115200, 9600, 230400, 921600),
    ranges_g=(2.0, 4.0, 8.0, 16.0),
)
