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
# Bytes of which all kinds of frames recognise their beginning.
_HEAD = 3


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


@cache
def _members(values: bytes) -> Mask:
    return np.isin(np.arange(256), list(values))


def rows_of(data: Bytes, starts: Integers | slice, size: int) -> Bytes:
    """The frames of `size` bytes that begin at `starts`, shape (n, size)."""
    return (
        np.lib.stride_tricks.sliding_window_view(data, size)[starts] if len(data) >= size else data[:0].reshape(0, size)
    )


def column(data: Bytes, starts: Integers, at: int, kind: str) -> NDArray:
    """The numbers of numpy type `kind` at `starts + at`, shape (n,)."""
    return rows_of(data, starts + at, np.dtype(kind).itemsize).view(kind)[:, 0]


def select(starts: Integers, sizes: Integers, good: Mask, length: int, final: bool) -> Found:
    """Select the first good candidate in order, then the first good one after its end, and so on.

    A candidate that extends beyond `length` and is not covered by a good frame ends the search unless `final`: later data
    cannot be decided yet.
    """
    stops, kept, end = starts + sizes, list[int](), 0
    for k in np.flatnonzero(good | ((stops > length) & (not final))).tolist():
        if starts[k] >= end and stops[k] > length:
            return Found(starts[kept], sizes[kept], int(starts[k]))
        if starts[k] >= end:
            kept.append(k)
            end = stops[k]
    return Found(starts[kept], sizes[kept], length)


def find(kinds: tuple[Frames, ...], data: Bytes, final: bool, between: bytes = b"") -> Found:
    """All complete frames of these kinds.

    **Arguments:**

    - `final`: no further data will come. `between`: bytes that may be between two frames.
    """
    # Usually the data begin with a run of frames of one size: they are checked where they are.
    run, size, end = np.zeros(0, int), 0, 0
    for kind in kinds:
        first = int(kind.sizes_at(data, np.zeros(min(len(data), 1), int)).sum())
        if 0 < first <= len(data):
            size, period = first, first + len(between) * (data[first : first + len(between)].tobytes() == between)
            run = np.arange(0, len(data) - size + 1, period)
            good = (kind.sizes_at(data, run) == size) & kind.intact(rows_of(data, slice(None, None, period), size))
            run = run[np.logical_and.accumulate(good)]
            end = int(run[-1]) + size if len(run) else 0
    # After it, each place with the first byte of a frame is a candidate.
    candidates = list[tuple[NDArray, ...]]()
    for kind in kinds:
        places = end + np.flatnonzero(_members(kind.sync[0])[data[end:]])
        sizes, good = kind.sizes_at(data, places), np.zeros(len(places), bool)
        whole = places + sizes <= len(data)
        for one in np.unique(sizes[(sizes > 0) & whole]).tolist():
            these = np.flatnonzero((sizes == one) & whole)
            for some in np.array_split(these, 1 + len(these) * one // _CHECKED_BYTES):
                good[some] = kind.intact(rows_of(data, places[some], one))
        candidates.append((places, sizes, good))
    places, sizes, good = np.hstack(candidates)
    order = np.argsort(places)
    found = select(places[order], sizes[order], good[order] > 0, len(data), final)
    return Found(np.append(run, found.starts), np.append(np.full(len(run), size), found.sizes), found.limit)


class FrameDecoder:
    """Decodes the bytes of a binary protocol to samples.

    **Arguments:**

    - `read`: reads the intact frames. `kinds`: the frames of the protocol.
    - `lock_after`: number of contiguous frames before the first is accepted (1 for a strong check, 3 for an 8-bit check).
    - `between`: bytes that may be between two frames without an error.
    """

    def __init__(self, read: Reading, *kinds: Frames, lock_after: int = 1, between: bytes = b""):
        self._read, self._kinds, self._needed, self._between = read, kinds, lock_after, between
        # Whether the frame boundary is known: an 8-bit check alone is too weak.
        self._locked, self._seen_any = lock_after <= 1, False
        # The undecided bytes, and their place in the stream.
        self._tail, self._offset = np.zeros(0, np.uint8), 0
        # The bytes outside frames just before them: how many, and the first ones.
        self._gap, self._gap_head = 0, b""
        # The first event of each reason for which valid frames are not read: only this one is reported.
        self._refused = dict[str, Event]()

    def feed(self, data: bytes, final: bool = False) -> Decoded:
        """Decode what `data` completes."""
        bytes_ = np.concatenate([self._tail, np.frombuffer(data, np.uint8)])
        found = find(self._kinds, bytes_, final, self._between)
        starts, sizes, limit = found = self._believed(found, final) if self._needed > 1 else found
        # A correct check does not imply correct numbers: numbers that are not finite are flagged.
        with np.errstate(over="ignore", invalid="ignore"):
            samples, events = self._read(bytes_, found, self._offset, final)
        counts, count = Counts(frames=len(samples), special=len(starts) - len(samples)), len(starts)
        # Bytes before each frame, and after the last one.
        ends = np.append(-self._gap, starts + sizes)
        gaps, head = np.append(starts, limit) - ends, self._gap_head
        self._gap, self._gap_head = int(gaps[-1]), b""
        for k in np.flatnonzero(gaps).tolist():
            first = (head * (k == 0) + bytes_[max(ends[k], 0) :][:_HEAD].tobytes())[:_HEAD]
            if k == count and not final:
                self._gap_head = first[: self._gap]
            elif gaps[k] != len(self._between) or not first.startswith(self._between):
                counts.discarded += int(gaps[k])
                if k < count and (self._seen_any or k):
                    counts.resyncs += 1
                    counts.check_failures += any(
                        len(first) >= len(kind.sync) and all(map(bytes.__contains__, kind.sync, first))
                        for kind in self._kinds
                    )
        self._seen_any |= count > 0
        self._tail, self._offset = bytes_[limit:].copy(), self._offset + limit
        new = [e for e in events if e.kind != "refused" or self._refused.setdefault(e.content["text"], e) is e]
        return Decoded(samples, new, counts)

    def finish(self) -> Decoded:
        """Decode the remaining bytes; incomplete frames become discarded bytes."""
        return self.feed(b"", final=True)

    def _believed(self, found: Found, final: bool) -> Found:
        """Drop isolated frames while the frame boundary is unknown."""
        starts, sizes, limit = found
        ends, keep, end = starts + sizes, np.zeros(len(starts), bool), -self._gap
        edges = np.flatnonzero(starts[1:] != ends[:-1]) + 1
        for some in np.split(np.arange(len(starts)), edges) if len(starts) else ():
            first, last = some[0], some[-1]
            near = self._locked and starts[first] - end <= _LOCK_REACH_BYTES
            if not near and len(some) < self._needed and ends[last] >= limit and not final:
                limit = int(starts[first])
                break
            self._locked = near or len(some) >= self._needed
            keep[some] = self._locked
            end = ends[last] if self._locked else end
        return Found(starts[keep], sizes[keep], limit)


def decode_all(decoder: "Decoder", data: bytes, chunk: int = 1 << 19) -> Decoded:
    """Decode a whole byte log in pieces that fit into memory."""
    pieces = [decoder.feed(data[start : start + chunk]) for start in range(0, len(data), chunk)]
    pieces.append(decoder.finish())
    counts = Counts()
    for piece in pieces:
        counts.add(piece.counts)
    return Decoded(joined(p.samples for p in pieces), [event for p in pieces for event in p.events], counts)
