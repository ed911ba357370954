"""STIM300 (Safran, formerly Sensonor): binary frames with CRC-32; the datagrams are in `stim300_datagrams`.

The frame states neither the range nor the unit of the accelerometers: only the configuration datagram does, so without one
the specific force is NaN.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.checks import crc32_mpeg2
from tumblecal.capture.decoding.framing import Found, FrameDecoder, select
from tumblecal.capture.decoding.samples import Event, Samples, Settings, blank
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.capture.protocols.stim300_datagrams import (
    ACCELERATION_BITS,
    CRLF,
    LAYOUTS,
    PADDINGS,
    SIZES,
    VELOCITY_BITS,
    FrameLayout,
    settings_of,
    special_event,
    status_flags,
)
from tumblecal.capture.protocols.stim300_device import answer, encode
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_WINDOW = 4096


def _u8_column(data: NDArray[np.uint8], at: int, n: int, period: int) -> NDArray[np.uint8]:
    return data[at : at + (n - 1) * period + 1 : period]


class Stim300Framing:
    """Frames of a STIM300 and their content.

    **Arguments:**

    - `settings`: range, output and rate from other sources; a configuration datagram replaces them.
    """

    lock_after = 1
    between = CRLF

    def __init__(self, settings: Settings | None = None):
        self.settings = settings
        self._integrated: tuple[int, NDArray[np.int64]] | None = None

    def begins(self, data: NDArray[np.uint8], offset: int) -> bool:
        """Whether the byte is a known identifier."""
        return offset < len(data) and bool(SIZES[data[offset]])

    def find(self, data: NDArray[np.uint8], final: bool) -> Found:
        """All frames with a correct CRC; runs of equal frames are checked as a block."""
        starts, sizes, offset, n = [], [], 0, len(data)
        while offset < n:
            run, period = self._run(data, offset)
            if run:
                size = int(SIZES[data[offset]])
                starts.append(offset + period * np.arange(run))
                sizes.append(np.full(run, size))
                offset += (run - 1) * period + size
                offset += 2 * (data[offset : offset + 2].tobytes() == CRLF)
                continue
            window = offset + np.flatnonzero(SIZES[data[offset : offset + _WINDOW]])
            found = self._among(data, window, final)
            starts.append(found.starts)
            sizes.append(found.sizes)
            if found.limit < n:
                return Found(np.concatenate(starts), np.concatenate(sizes), found.limit)
            end = int(found.starts[-1] + found.sizes[-1]) if len(found.starts) else 0
            offset = max(end, offset + _WINDOW)
        none = np.zeros(0, np.int64)
        return Found(np.concatenate([none, *starts]), np.concatenate([none, *sizes]), n)

    def _run(self, data: NDArray[np.uint8], offset: int) -> tuple[int, int]:
        """Number of consecutive valid frames of one kind at `place`, and their distance."""
        size = int(SIZES[data[offset]])
        if not size or offset + size > len(data):
            return 0, size
        with_crlf = data[offset + size : offset + size + 2].tobytes() == CRLF
        period = size + 2 * with_crlf
        room = (len(data) - offset - size) // period + 1
        done, block = 0, 16
        while done < room:
            block = min(block * 4, 16384, room - done)
            first = offset + done * period
            rows = np.lib.stride_tricks.as_strided(data[first:], (block, size), (period, 1))
            good = rows[:, 0] == data[offset]
            if with_crlf and first + (block - 1) * period + size + 2 <= len(data):
                good &= (_u8_column(data, first + size, block, period) == 13) & (
                    _u8_column(data, first + size + 1, block, period) == 10
                )
            sent = np.ndarray((block,), ">u4", data, first + size - 4, (period,))
            good &= crc32_mpeg2(rows[:, : size - 4], int(PADDINGS[data[offset]])) == sent
            if not good.all():
                return done + int(np.argmin(good)), period
            done += block
        return done, period

    def _among(self, data: NDArray[np.uint8], places: NDArray[np.int64], final: bool) -> Found:
        """The valid frames among candidate places."""
        identifiers = data[places]
        sizes = SIZES[identifiers]
        whole = places + sizes <= len(data)
        good = np.zeros(len(places), bool)
        shape = 4 * sizes + PADDINGS[identifiers]
        for code in np.unique(shape):
            these = np.flatnonzero(whole & (shape == code))
            if len(these):
                rows = data[places[these][:, None] + np.arange(code // 4)]
                good[these] = crc32_mpeg2(rows[:, :-4], int(code) % 4) == rows[:, -4:].copy().view(">u4")[:, 0]
        return select(places, sizes, good, len(data), final)

    def parse(self, data: NDArray[np.uint8], found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        """Samples of the normal frames; events of the others, which also set the scale of later frames."""
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
                event = special_event(identifier, data[start : start + size].tobytes(), offset + start + size)
                if event.kind == "configuration":
                    self.settings = settings_of(event.content)
                events.append(event)
        samples.stop[:] += offset
        return samples, events

    def _fill(
        self, out: Samples, rows: slice, data: NDArray[np.uint8], starts: NDArray[np.int64], layout: FrameLayout
    ) -> None:
        def cluster(at: int) -> NDArray[np.int32]:
            return np.stack([_int24(data, starts, at + 3 * axis) for axis in range(3)], axis=1)

        status = status_flags(data[starts + 10])
        out.stop[rows] = starts + layout.size
        out.rate[rows] = cluster(1) * 2.0**-14
        out.counter[rows] = data[starts + layout.counter]
        if layout.acceleration is not None:
            status = status | status_flags(data[starts + layout.acceleration + 9])
            out.force[rows] = self._force(cluster(layout.acceleration), out.counter[rows])
        if layout.acceleration_temperature is not None:
            at = starts + layout.acceleration_temperature
            words = np.stack([data[at + 2 * k].astype(np.int8) * 256.0 + data[at + 2 * k + 1] for k in range(3)])
            out.temperature[rows] = words.mean(0) / 256.0
        out.status[rows] = status

    def _force(self, raw: NDArray[np.int32], counter: NDArray[np.int64]) -> NDArray[np.float64]:
        """Specific force in standard g; NaN if range or unit are unknown."""
        settings = self.settings
        if settings is None or settings.range_g is None:
            return np.full(raw.shape, np.nan)
        if settings.output in ("acceleration", "average"):
            return raw.astype(np.float64) * np.array([2.0 ** -ACCELERATION_BITS[r] for r in settings.range_g])
        velocity = np.array([2.0 ** -VELOCITY_BITS[r] for r in settings.range_g])
        if settings.rate_hz is None or settings.output not in ("increment", "integrated"):
            return np.full(raw.shape, np.nan)
        if settings.output == "increment":
            return raw.astype(np.float64) * velocity * settings.rate_hz / STANDARD_GRAVITY_MS2
        return self._differences(raw.astype(np.int64), counter) * velocity * 2000.0 / STANDARD_GRAVITY_MS2

    def _differences(self, raw: NDArray[np.int64], counter: NDArray[np.int64]) -> NDArray[np.float64]:
        """Change of an integrated 24-bit output per internal tick; it wraps like the counter."""
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


def _with_range(settings: Settings, range_g: float) -> Settings:
    lsb = 2.0 ** -ACCELERATION_BITS[range_g]
    return replace(settings, range_g=(range_g,) * 3, lsb_g=(lsb,) * 3)


PROTOCOL = Protocol(
    name="stim300",
    title="STIM300 (Safran, Sensonor)",
    decoder=lambda settings=None: FrameDecoder(Stim300Framing(settings)),
    encode=encode,
    bauds=(921600, 1843200, 460800, 374400),
    counter=DeviceCounter(modulus=256, ticks_per_s=2000.0),
    queries=(b"I\r", b"C\r"),
    ranges_g=(5.0, 10.0, 30.0, 80.0),
    range_from_stream=True,
    answer=answer,
    with_range=_with_range,
)
