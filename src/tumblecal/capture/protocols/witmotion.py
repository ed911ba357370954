"""WitMotion JY61, WT61, WT901, HWT905 and their clones: 11-byte frames with an 8-bit sum.

0x55, a type, four little-endian 16-bit words, the sum of the first ten bytes. One sample is a burst of types 0x51
(specific force, temperature), 0x52 (angular rate) and others; there is no counter. The full scale (16 g unless a
register was changed) is not in the stream.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import RunningSums
from tumblecal.capture.decoding.framing import Found, FrameDecoder, column, cut_header, places_of, select
from tumblecal.capture.decoding.samples import Event, Samples, Settings, blank, joined
from tumblecal.capture.protocols import Protocol


SIZE = 11
_FORCE, _RATE, _LAST_TYPE = 0x51, 0x52, 0x5F
DEFAULT_RANGE_G = 16.0


class WitMotionFraming:
    """Frames of a WitMotion device.

    **Arguments:**

    - `settings`: the full scale; 16 g without.
    """

    lock_after = 3
    between = b""

    def __init__(self, settings: Settings | None = None):
        known = settings.range_g if settings is not None else None
        self._scale = np.array(known or (DEFAULT_RANGE_G,) * 3) / 32768
        self._pending = blank(0)

    def begins(self, data: NDArray[np.uint8], offset: int) -> bool:
        """Whether the preamble and a known type are at this place."""
        return offset + 1 < len(data) and data[offset] == 0x55 and 0x50 <= data[offset + 1] <= _LAST_TYPE

    def find(self, data: NDArray[np.uint8], final: bool) -> Found:
        """All frames with a correct checksum."""
        places = places_of(data, b"\x55")
        places = places[places + 1 < len(data)]
        kinds = data[places + 1]
        places = places[(kinds >= 0x50) & (kinds <= _LAST_TYPE)]
        whole = places + SIZE <= len(data)
        good = np.zeros(len(places), bool)
        sums = RunningSums(data)
        good[whole] = sums.plain(places[whole], places[whole] + 10) % 256 == data[places[whole] + 10]
        limit = cut_header(data, b"\x55", 2, final)
        return select(places, np.full(len(places), SIZE), good, len(data), final, limit)

    def parse(self, data: NDArray[np.uint8], found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        """One sample a force frame, with the rate frame of the same burst if there is one."""
        kinds = data[found.starts + 1]
        at = np.flatnonzero(kinds == _FORCE)
        fresh = blank(len(at))
        words = column(data, found.starts[at], 2, "<i2", 4)
        fresh.stop[:] = found.starts[at] + SIZE + offset
        fresh.force[:] = words[:, :3] * self._scale
        fresh.temperature[:] = words[:, 3] / 100.0
        rates = np.flatnonzero(kinds == _RATE)
        values = column(data, found.starts[rates], 2, "<i2", 4)[:, :3] / 32768 * 2000.0
        owner = np.searchsorted(at, rates) - 1
        samples = joined([self._pending, fresh])
        owner = owner + len(self._pending)
        # The rate directly follows the force of its burst; a rate before any force belongs to none.
        rates, values, owner = rates[owner >= 0], values[owner >= 0], owner[owner >= 0]
        belongs = found.starts[rates] + offset - samples.stop[owner] < 2 * SIZE
        samples.rate[owner[belongs]] = values[belongs]
        if final or not len(samples) or (len(kinds) and kinds[-1] != _FORCE):
            self._pending = blank(0)
            return samples, []
        if not len(kinds):
            return blank(0), []
        self._pending = samples[len(samples) - 1 :]
        return samples[: len(samples) - 1], []


def _frames(kind: int, words: NDArray[np.float64]) -> NDArray[np.uint8]:
    rows = np.zeros((len(words), SIZE), np.uint8)
    rows[:, 0], rows[:, 1] = 0x55, kind
    rows[:, 2:10] = np.clip(np.rint(words), -32768, 32767).astype("<i2").view(np.uint8).reshape(-1, 8)
    rows[:, 10] = rows[:, :10].sum(1) % 256
    return rows


def encode(samples: Samples, settings: Settings) -> bytes:
    """Bursts of a force and a rate frame."""
    scale = np.array(settings.range_g or (DEFAULT_RANGE_G,) * 3) / 32768
    temperature = np.nan_to_num(samples.temperature)[:, None] * 100
    force = _frames(_FORCE, np.hstack([samples.force / scale, temperature]))
    rate = _frames(_RATE, np.hstack([np.nan_to_num(samples.rate) / 2000 * 32768, temperature]))
    return np.hstack([force, rate]).tobytes()


def _with_range(settings: Settings, range_g: float) -> Settings:
    return replace(settings, range_g=(range_g,) * 3, lsb_g=(range_g / 32768,) * 3)


PROTOCOL = Protocol(
    name="witmotion",
    title="WitMotion JY61, WT61, WT901, HWT905 and clones",
    decoder=lambda settings=None: FrameDecoder(WitMotionFraming(settings)),
    encode=encode,
    bauds=(115200, 9600, 230400, 921600),
    ranges_g=(2.0, 4.0, 8.0, 16.0),
    with_range=_with_range,
)
