"""Frames in a stream of bytes, for all binary protocols: incremental, resynchronising, the same however the stream is cut.

A protocol declares its frames: the first bytes, the size, the check, and a function that reads samples from intact frames.
This module finds the frames, stores the unfinished tail, and counts the bytes outside frames.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Bytes, Counts, Decoded, Event, Integers, Mask, Samples, joined


if TYPE_CHECKING:
    from tumblecal.capture.protocols import Decoder

# Bytes of frames that are checked together.
_CHECKED_BYTES = 1 << 24
# An isolated frame with an 8-bit check is accepted only this close after an accepted frame.
_LOCK_REACH_BYTES = 512


class Found(NamedTuple):
    """Complete frames in a stretch of bytes, in order and not overlapping.

    `starts` and `sizes`: shape (n,); `limit`: end of the decided part (a frame that may begin at `limit` is not complete yet).
    """

    starts: Integers
    sizes: Integers
    limit: int


@dataclass(frozen=True)
class Frames:
    """One kind of frames.

    **Arguments:**

    - `sync`: the values that each of the first bytes may have.
    - `header`: number of bytes that determine the size.
    - `sizes`: sizes of the frames at some places of the data, shape (n,); 0 if there is none.
    - `intact`: whether frames of one size, shape (n, size), have the correct check, shape (n,).
    """

    sync: tuple[bytes, ...]
    header: int
    sizes: Callable[[Bytes, Integers], Integers]
    intact: Callable[[Bytes], Mask]

    def begins(self, head: bytes) -> bool:
        """Whether a frame may begin with these bytes."""
        return len(head) == len(self.sync) and all(map(bytes.__contains__, self.sync, head))

    def sizes_at(self, data: Bytes, places: Integers) -> Integers:
        """Size of the frame that may begin at each place: 0 for none; a frame that is cut off extends beyond the data."""
        sizes = np.full(len(places), self.header)
        for k, values in enumerate(self.sync):
            beyond = places + k >= len(data)
            sizes *= beyond | _members(values)[data.take(places + k, mode="clip")]
        known = (sizes > 0) & (places + self.header <= len(data))
        sizes[known] = self.sizes(data, places[known])
        return sizes


# Reads intact frames: data, frames, place of `data[0]` in the stream, and whether these are the last.
Reading = Callable[[Bytes, Found, int, bool], tuple[Samples, list[Event]]]


def places_of(data: Bytes, values: bytes) -> Integers:
    """Places of bytes with one of these values."""
    return np.flatnonzero(_members(values)[data])


@cache
def _members(values: bytes) -> Mask:
    return np.isin(np.arange(256), list(values))


def rows_of(data: Bytes, starts: Integers, size: int) -> Bytes:
    """The frames of `size` bytes that begin at `starts`, shape (n, size)."""
    if not len(starts):
        return np.zeros((0, size), np.uint8)
    return np.lib.stride_tricks.sliding_window_view(data, size)[starts]


def column(data: Bytes, starts: Integers, at: int, kind: str, n: int = 1) -> NDArray:
    """`n` numbers of numpy type `kind` at `starts + at`, shape (frames, n), or (frames,) for one."""
    values = rows_of(data, starts + at, np.dtype(kind).itemsize * n).view(kind)
    return values[:, 0] if n == 1 else values


def select(starts: Integers, sizes: Integers, good: Mask, length: int, final: bool) -> Found:
    """Select the first good candidate in order, then the first good one after its end, and so on.

    A candidate that extends beyond `length` and is not covered by a good frame ends the search unless `final`: later data
    cannot be decided yet.
    """
    ends = starts + sizes
    kept, end, limit = list[int](), 0, length
    considered = np.flatnonzero(good | ((ends > length) & (not final)))
    for k, start, stop in zip(
        *(each[considered].tolist() for each in (np.arange(len(starts)), starts, ends)), strict=True
    ):
        if start >= end and stop > length:
            limit = start
            break
        if start >= end:
            kept.append(k)
            end = stop
    return Found(starts[kept], sizes[kept], limit)


def find(kinds: tuple[Frames, ...], data: Bytes, final: bool, between: bytes = b"") -> Found:
    """All complete frames of these kinds.

    **Arguments:**

    - `final`: no further data will come. `between`: bytes that may be between two frames.
    """
    # Usually the data begin with a run of frames of one size: they are checked where they are.
    run, size, end = np.zeros(0, int), 0, 0
    for kind in kinds:
        size = int(kind.sizes_at(data, np.zeros(min(len(data), 1), int)).sum())
        if 0 < size <= len(data):
            period = size + len(between) * (data[size : size + len(between)].tobytes() == between)
            run = np.arange(0, len(data) - size + 1, period)
            rows = np.lib.stride_tricks.sliding_window_view(data, size)[::period]
            good = (kind.sizes_at(data, run) == size) & kind.intact(rows)
            run = run[np.logical_and.accumulate(good)]
            end = int(run[-1]) + size if len(run) else 0
            break
    # Behind it, each place with the first byte of a frame is a candidate.
    candidates = list[tuple[NDArray, ...]]()
    for kind in kinds:
        places = end + places_of(data[end:], kind.sync[0])
        sizes, good = kind.sizes_at(data, places), np.zeros(len(places), bool)
        for one in np.unique(sizes[(sizes > 0) & (places + sizes <= len(data))]).tolist():
            these = np.flatnonzero((sizes == one) & (places + one <= len(data)))
            for some in np.array_split(these, 1 + len(these) * one // _CHECKED_BYTES):
                good[some] = kind.intact(rows_of(data, places[some], one))
        candidates.append((places, sizes, good))
    places, sizes, good = (np.concatenate(parts) for parts in zip(*candidates, strict=True))
    order = np.argsort(places)
    found = select(places[order], sizes[order], good[order], len(data), final)
    sizes = np.append(np.full(len(run), size), found.sizes)
    return Found(np.append(run, found.starts), sizes, found.limit)


class FrameDecoder:
    """Decodes the bytes of a binary protocol to samples.

    **Arguments:**

    - `read`: reads the intact frames. `kinds`: the frames of the protocol.
    - `lock_after`: number of contiguous frames before the first is accepted (1 for a strong check, 3 for an 8-bit check).
    - `between`: bytes that may be between two frames without an error.
    """

    def __init__(self, read: Reading, *kinds: Frames, lock_after: int = 1, between: bytes = b""):
        self._read, self._kinds, self._needed, self._between = read, kinds, lock_after, between
        # Whether the frame boundary is known, for protocols whose check alone is too weak to trust.
        self._locked = lock_after <= 1
        # The unfinished bytes, their place in the stream, and the end of the last frame from there.
        self._tail, self._offset, self._end = np.zeros(0, np.uint8), 0, 0
        self._seen_any = self._gap_begins_like_a_frame = False
        self._refused = set[str]()

    def feed(self, data: bytes) -> Decoded:
        """Decode what `data` completes."""
        return self._advance(data, final=False)

    def finish(self) -> Decoded:
        """Decode the remaining bytes; incomplete frames become discarded bytes."""
        return self._advance(b"", final=True)

    def _advance(self, fresh: bytes, final: bool) -> Decoded:
        data = np.concatenate([self._tail, np.frombuffer(fresh, np.uint8)])
        found = find(self._kinds, data, final, self._between)
        if self._needed > 1:
            found = self._believed(found, final)
        # A correct check does not imply correct numbers: numbers that are not finite are flagged.
        with np.errstate(over="ignore", invalid="ignore"):
            samples, events = self._read(data, found, self._offset, final)
        counts = Counts(frames=len(samples), special=len(found.starts) - len(samples))
        # Bytes before each frame, and at the end of the stream.
        ends = np.append(self._end, found.starts + found.sizes)
        gaps = np.append(found.starts, [len(data)] * final) - ends[: len(found.starts) + final]
        for k in np.flatnonzero(gaps).tolist():
            at, gap = int(ends[k]), int(gaps[k])
            if at >= 0 and data[at : at + gap].tobytes() == self._between:
                continue
            counts.discarded += gap
            if k < len(found.starts) and (self._seen_any or k):
                counts.resyncs += 1
                counts.check_failures += self._begins(data, at) if at >= 0 else self._gap_begins_like_a_frame
        self._seen_any |= len(found.starts) > 0
        end, limit = int(ends[-1]), found.limit
        if final:
            end = limit = len(data)
        elif limit - end <= len(self._between):
            limit = max(end, 0)
        elif end >= 0:
            self._gap_begins_like_a_frame = self._begins(data, end)
        self._tail, self._offset, self._end = data[limit:].copy(), self._offset + limit, end - limit
        return Decoded(samples, [event for event in events if self._is_new(event)], counts)

    def _is_new(self, event: Event) -> bool:
        """Whether an event is to be reported: each reason for valid frames that are not read is reported once."""
        known = len(self._refused)
        if event.kind == "refused":
            self._refused.add(event.content["text"])
        return event.kind != "refused" or len(self._refused) > known

    def _begins(self, data: Bytes, at: int) -> bool:
        return any(kind.begins(data[at : at + len(kind.sync)].tobytes()) for kind in self._kinds)

    def _believed(self, found: Found, final: bool) -> Found:
        """Drop isolated frames while the frame boundary is unknown."""
        starts, sizes, limit = found
        ends, keep, end = starts + sizes, np.zeros(len(starts), bool), self._end
        edges = np.flatnonzero(starts[1:] != ends[:-1]) + 1
        for first, stop in zip([0, *edges], [*edges, len(starts)], strict=True) if len(starts) else ():
            near = self._locked and starts[first] - end <= _LOCK_REACH_BYTES
            if not near and stop - first < self._needed and ends[stop - 1] >= limit and not final:
                limit = int(starts[first])
                break
            self._locked = near or stop - first >= self._needed
            keep[first:stop] = self._locked
            end = ends[stop - 1] if self._locked else end
        return Found(starts[keep], sizes[keep], limit)


def decode_all(decoder: "Decoder", data: bytes, chunk: int = 1 << 19) -> Decoded:
    """Decode a whole byte log in pieces that fit into memory."""
    pieces = [decoder.feed(data[start : start + chunk]) for start in range(0, len(data), chunk)]
    pieces.append(decoder.finish())
    counts = Counts()
    for piece in pieces:
        counts.add(piece.counts)
    events = [event for piece in pieces for event in piece.events]
    return Decoded(joined([piece.samples for piece in pieces]), events, counts)
