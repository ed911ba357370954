"""Complete frames from a stream of bytes: incremental, resynchronising, with a result that does not depend on the pieces.

A protocol finds the possible starts of frames and checks them; this module stores the unfinished tail, decides when to accept
an 8-bit check, and counts the remaining bytes.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Counts, Decoded, Event, Samples, blank, joined


if TYPE_CHECKING:
    from tumblecal.capture.protocols import Decoder


_Layout = TypeVar("_Layout")


class Found(NamedTuple):
    """Complete frames in a stretch of bytes, in order and not overlapping.

    `starts` and `sizes`: shape (n,); `limit`: end of the decided part (a frame that may begin at `limit` is not complete yet).
    """

    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]
    limit: int


class Framing(Protocol):
    """The frames of a binary protocol.

    `lock_after`: number of contiguous frames before the first is accepted (1 for a strong checksum, 3 for 8-bit checksums).
    `between`: bytes that may be between two frames without an error.
    """

    lock_after: int
    between: bytes

    def find(self, data: NDArray[np.uint8], final: bool) -> Found:
        """All complete frames of `data`; `final`: no further data will come."""
        ...

    def begins(self, data: NDArray[np.uint8], offset: int) -> bool:
        """Whether a frame may begin at `offset`."""
        ...

    def parse(self, data: NDArray[np.uint8], found: Found, offset: int, final: bool) -> tuple[Samples, list[Event]]:
        """The content of these frames; `offset` is the place of `data[0]` in the stream."""
        ...


def places_of(data: NDArray[np.uint8], preamble: bytes) -> NDArray[np.int64]:
    """Places of `preamble` in `data`, in order, without one that is cut off at the end."""
    last = len(data) - len(preamble) + 1
    if last <= 0:
        return np.zeros(0, np.int64)
    places = np.flatnonzero(data[:last] == preamble[0])
    for k, byte in enumerate(preamble[1:], start=1):
        places = places[data[places + k] == byte]
    return places


def cut_header(data: NDArray[np.uint8], preamble: bytes, header: int, final: bool) -> int:
    """End of the decidable part if a header of `header` bytes that begins with `preamble` may be cut off."""
    if final:
        return len(data)
    for offset in range(max(0, len(data) - header + 1), len(data)):
        rest = data[offset : offset + len(preamble)].tobytes()
        if preamble.startswith(rest):
            return offset
    return len(data)


def column(data: NDArray[np.uint8], starts: NDArray[np.int64], at: int, kind: str, n: int = 1) -> NDArray:
    """`n` numbers of numpy type `kind` at `starts + at`, shape (frames, n), or (frames,) for one."""
    size = np.dtype(kind).itemsize * n
    raw = np.ascontiguousarray(data[(starts + at)[:, None] + np.arange(size)])
    values = raw.view(kind).reshape(len(starts), n)
    return values[:, 0] if n == 1 else values


def select(
    starts: NDArray[np.int64],
    sizes: NDArray[np.int64],
    good: NDArray[np.bool_],
    length: int,
    final: bool,
    limit: int | None = None,
) -> Found:
    """Select the first good candidate in order, then the first good one after its end, and so on.

    A candidate that extends beyond `length` and is not covered by a good frame ends the search unless `final`: later data
    cannot be decided yet. `limit`: start of a header that is cut off, if there is one.
    """
    limit = length if limit is None else limit
    unfinished = starts + sizes > length
    if final:
        good = good & ~unfinished
        unfinished[:] = False
    keep = np.flatnonzero(good | unfinished)
    starts, sizes, unfinished = starts[keep], sizes[keep], unfinished[keep]
    if not unfinished.any() and (starts[1:] >= (starts + sizes)[:-1]).all():
        end = int(starts[-1] + sizes[-1]) if len(starts) else 0
        return Found(starts, sizes, max(limit, end))
    chosen, end = [], 0
    for i, (start, size, open_end) in enumerate(zip(starts.tolist(), sizes.tolist(), unfinished.tolist(), strict=True)):
        if start < end:
            continue
        if open_end:
            limit = min(limit, start)
            break
        chosen.append(i)
        end = start + size
    return Found(starts[chosen], sizes[chosen], max(limit, end))


# An isolated frame with an 8-bit check is accepted only this close after an accepted frame.
_LOCK_REACH_BYTES = 512


class FrameDecoder:
    """Decodes the bytes of one binary protocol to samples.

    **Arguments:**

    - `framing`: the protocol's part.
    """

    def __init__(self, framing: Framing):
        self._framing = framing
        self._tail = np.zeros(0, np.uint8)
        self._offset = 0
        self._last_end = 0
        self._seen_any = False
        self._gap_begins_like_a_frame = False
        self._needed = framing.lock_after
        # Whether the frame boundary is known, for protocols whose check alone is too weak to trust.
        self._locked = self._needed <= 1

    def feed(self, data: bytes) -> Decoded:
        """Decode what `data` completes."""
        return self._advance(data, final=False)

    def finish(self) -> Decoded:
        """Decode the remaining bytes; incomplete frames become discarded bytes."""
        return self._advance(b"", final=True)

    def _advance(self, data: bytes, final: bool) -> Decoded:
        fresh = np.frombuffer(data, np.uint8)
        buffer = fresh if not len(self._tail) else np.concatenate([self._tail, fresh])
        if not len(buffer) and not final:
            return Decoded(blank(0))
        found = self._framing.find(buffer, final)
        if not self._locked or self._needed > 1:
            found = self._believed(found, final)
        counts = self._count(buffer, found)
        with np.errstate(over="ignore", invalid="ignore"):
            # A correct check does not imply correct numbers: numbers that are not finite are flagged.
            samples, events = self._framing.parse(buffer, found, self._offset, final)
        counts.frames, counts.special = len(samples), len(found.starts) - len(samples)
        self._keep_tail(buffer, found, final, counts)
        return Decoded(samples, events, counts)

    def _believed(self, found: Found, final: bool) -> Found:
        """Drop isolated frames while the frame boundary is unknown."""
        starts, ends = found.starts, found.starts + found.sizes
        if not len(starts):
            return found
        first_of_group = np.flatnonzero(np.concatenate([[True], starts[1:] != ends[:-1]]))
        keep = np.zeros(len(starts), bool)
        limit = found.limit
        last_end = self._last_end - self._offset
        for group, first in enumerate(first_of_group):
            after = first_of_group[group + 1] if group + 1 < len(first_of_group) else len(starts)
            near = self._locked and starts[first] - last_end <= _LOCK_REACH_BYTES
            if near or after - first >= self._needed:
                keep[first:after] = True
                self._locked = True
                last_end = ends[after - 1]
            elif ends[after - 1] >= found.limit and not final:
                limit = int(starts[first])
                break
            else:
                self._locked = self._locked and near
        return Found(starts[keep], found.sizes[keep], limit)

    def _count(self, buffer: NDArray[np.uint8], found: Found) -> Counts:
        counts = Counts()
        if not len(found.starts):
            return counts
        ends = found.starts + found.sizes
        before = np.concatenate([[self._last_end - self._offset], ends[:-1]])
        gaps = found.starts - before
        for i in np.flatnonzero(gaps):
            gap, at = int(gaps[i]), int(before[i])
            if self._is_between(buffer, at, gap):
                continue
            counts.discarded += gap
            if self._seen_any or i > 0:
                counts.resyncs += 1
                begins = self._framing.begins(buffer, at) if at >= 0 else self._gap_begins_like_a_frame
                counts.check_failures += bool(begins)
        self._seen_any = True
        self._last_end = int(ends[-1]) + self._offset
        return counts

    def _is_between(self, buffer: NDArray[np.uint8], at: int, gap: int) -> bool:
        between = self._framing.between
        return gap == len(between) and at >= 0 and buffer[at : at + gap].tobytes() == between

    def _keep_tail(self, buffer: NDArray[np.uint8], found: Found, final: bool, counts: Counts) -> None:
        last_end = self._last_end - self._offset
        if final:
            rest = len(buffer) - last_end
            if rest and not self._is_between(buffer, last_end, rest):
                counts.discarded += rest
            self._offset += len(buffer)
            self._last_end = self._offset
            self._tail = np.zeros(0, np.uint8)
            return
        limit = found.limit
        if limit - last_end <= len(self._framing.between):
            limit = max(last_end, 0)
        elif 0 <= last_end < limit:
            self._gap_begins_like_a_frame = self._framing.begins(buffer, last_end)
        self._tail = buffer[limit:].copy()
        self._offset += limit


def decode_all(decoder: "Decoder", data: bytes, chunk: int = 1 << 22) -> Decoded:
    """Decode a whole byte log in pieces that fit into memory."""
    parts, events, counts = [], [], Counts()
    for start in range(0, len(data), chunk):
        piece = decoder.feed(data[start : start + chunk])
        parts.append(piece.samples)
        events += piece.events
        counts.add(piece.counts)
    last = decoder.finish()
    parts.append(last.samples)
    counts.add(last.counts)
    return Decoded(joined(parts), events + last.events, counts)


def decoded_by_layout(
    data: NDArray[np.uint8],
    found: Found,
    offset: int,
    layout_of: Callable[[bytes], tuple[_Layout, list[int]]],
    decode: Callable[[NDArray[np.int64], int, _Layout], Samples | None],
) -> Samples:
    """Samples of self-describing frames; frames of one layout are decoded together.

    **Arguments:**

    - `data`, `found`, `offset`: the frames, and the place of `data[0]` in the stream.
    - `layout_of`: the layout of a complete frame, and the places in it of the bytes that state the layout.
    - `decode`: the samples of frames of one layout (starts, size of each, layout); None if they have none.
    """
    parts: list[tuple[NDArray[np.int64], Samples]] = []
    rest = np.arange(len(found.starts))
    while len(rest):
        start, size = int(found.starts[rest[0]]), int(found.sizes[rest[0]])
        layout, describing = layout_of(data[start : start + size].tobytes())
        same = found.sizes[rest] == size
        for at in describing:
            same[same] = data[found.starts[rest[same]] + at] == data[start + at]
        samples = decode(found.starts[rest[same]], size, layout)
        if samples is not None:
            samples.stop[:] = found.starts[rest[same]] + size + offset
            parts.append((rest[same], samples))
        rest = rest[~same]
    if len(parts) <= 1:
        return parts[0][1] if parts else blank(0)
    order = np.argsort(np.concatenate([rows for rows, _ in parts]), kind="stable")
    return joined([samples for _, samples in parts])[order]


class Refusals:
    """Complete and valid frames that a decoder does not read, each kind reported once."""

    def __init__(self) -> None:
        self._reported: set[str] = set()

    def event(self, stop: int, text: str) -> list[Event]:
        """The event that reports it; none if it was reported before."""
        if text in self._reported:
            return []
        self._reported.add(text)
        return [Event(stop, "refused", {"text": text})]
