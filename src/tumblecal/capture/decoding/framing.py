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

from tumblecal.capture.decoding.samples import Counts, Decoded, Event, Samples, blank, joined


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

    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]
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
    sizes: Callable[[NDArray[np.uint8], NDArray[np.int64]], NDArray[np.integer]]
    intact: Callable[[NDArray[np.uint8]], NDArray[np.bool_]]

    def begins(self, data: NDArray[np.uint8], at: int) -> bool:
        """Whether a frame may begin here."""
        head = data[at : at + len(self.sync)].tolist()
        return len(head) == len(self.sync) and all(map(bytes.__contains__, self.sync, head))

    def sizes_at(self, data: NDArray[np.uint8], places: NDArray[np.int64]) -> NDArray[np.int64]:
        """Size of the frame that may begin at each place, 0 for none; one that the end of the data cuts off extends beyond it."""
        sizes = np.full(len(places), self.header)
        for k, values in enumerate(self.sync):
            beyond = places + k >= len(data)
            sizes *= beyond | _members(values)[data.take(places + k, mode="clip")]
        known = (sizes > 0) & (places + self.header <= len(data))
        sizes[known] = self.sizes(data, places[known])
        return sizes


# Reads intact frames: data, frames, place of `data[0]` in the stream, and whether these are the last.
Reading = Callable[[NDArray[np.uint8], Found, int, bool], tuple[Samples, list[Event]]]


def places_of(data: NDArray[np.uint8], values: bytes) -> NDArray[np.int64]:
    """Places of bytes with one of these values."""
    return np.flatnonzero(_members(values)[data])


@cache
def _members(values: bytes) -> NDArray[np.bool_]:
    return np.isin(np.arange(256), list(values))


def rows_of(data: NDArray[np.uint8], starts: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """The frames of `size` bytes that begin at `starts`, shape (n, size)."""
    if not len(starts):
        return np.zeros((0, size), np.uint8)
    return np.lib.stride_tricks.sliding_window_view(data, size)[starts]


def column(data: NDArray[np.uint8], starts: NDArray[np.int64], at: int, kind: str, n: int = 1) -> NDArray:
    """`n` numbers of numpy type `kind` at `starts + at`, shape (frames, n), or (frames,) for one."""
    values = rows_of(data, starts + at, np.dtype(kind).itemsize * n).view(kind)
    return values[:, 0] if n == 1 else values


def select(
    starts: NDArray[np.int64], sizes: NDArray[np.integer], good: NDArray[np.bool_], length: int, final: bool
) -> Found:
    """Select the first good candidate in order, then the first good one after its end, and so on.

    A candidate that extends beyond `length` and is not covered by a good frame ends the search unless `final`: later data
    cannot be decided yet.
    """
    ends = starts + sizes
    chosen, limit = np.flatnonzero(good & (ends <= length)), length
    if (starts[chosen[1:]] < ends[chosen[:-1]]).any():
        kept, end = [], 0
        for k in chosen.tolist():
            if starts[k] >= end:
                kept.append(k)
                end = ends[k]
        chosen = np.array(kept)
    if not final:
        unfinished = starts[ends > length]
        unfinished = unfinished[_uncovered(unfinished, Found(starts[chosen], sizes[chosen], length))]
        limit = int(unfinished[0]) if len(unfinished) else length
        chosen = chosen[starts[chosen] < limit]
    return Found(starts[chosen], sizes[chosen], limit)


def _uncovered(places: NDArray[np.int64], found: Found) -> NDArray[np.bool_]:
    """Whether each place is outside all frames."""
    ends = found.starts + found.sizes
    joint = found.starts[1:] == ends[:-1]
    begins = found.starts[np.append(True, ~joint)[: len(ends)]]
    ends = ends[np.append(~joint, True)[: len(ends)]]
    return places >= np.append(0, ends)[np.searchsorted(begins, places, "right")]


def find(kinds: tuple[Frames, ...], data: NDArray[np.uint8], final: bool, between: bytes = b"") -> Found:
    """All complete frames of these kinds.

    **Arguments:**

    - `final`: no further data will come. `between`: bytes that may be between two frames.
    """
    starts, size = _run(kinds, data, between)
    end = int(starts[-1]) + size if len(starts) else 0
    others = _search(kinds, data[end:], final)
    sizes = np.concatenate([np.full(len(starts), size), others.sizes])
    return Found(np.concatenate([starts, others.starts + end]), sizes, others.limit + end)


def _run(kinds: tuple[Frames, ...], data: NDArray[np.uint8], between: bytes) -> tuple[NDArray[np.int64], int]:
    """Starts and size of the frames of one size that follow one another from the beginning."""
    for kind in kinds:
        size = int(kind.sizes_at(data, np.zeros(min(len(data), 1), int)).sum())
        if 0 < size <= len(data):
            period = size + len(between) * (data[size : size + len(between)].tobytes() == between)
            starts = np.arange(0, len(data) - size + 1, period)
            rows = np.lib.stride_tricks.sliding_window_view(data, size)[::period]
            good = (kind.sizes_at(data, starts) == size) & kind.intact(rows)
            return starts[: len(good) if good.all() else np.argmin(good)], size
    return np.zeros(0, int), 0


def _search(kinds: tuple[Frames, ...], data: NDArray[np.uint8], final: bool) -> Found:
    candidates = list[tuple[NDArray, ...]]()
    for number, kind in enumerate(kinds):
        places = places_of(data, kind.sync[0])
        candidates.append((places, sizes := kind.sizes_at(data, places), sizes * len(kinds) + number))
    starts, sizes, shapes = (np.concatenate(parts) for parts in zip(*candidates, strict=True))
    order = np.argsort(starts) if len(kinds) > 1 else np.arange(len(starts))
    order = order[sizes[order] > 0]
    starts, sizes, shapes = starts[order], sizes[order], shapes[order]
    unchecked, good = starts + sizes <= len(data), np.zeros(len(starts), bool)
    # Frames followed by their like are checked first; then only the candidates that these do not cover.
    check = unchecked & (data.take(starts + sizes, mode="clip") == data[starts])
    while True:
        for shape in np.flatnonzero(np.bincount(shapes[check])).tolist():
            size, kind = divmod(shape, len(kinds))
            these = np.flatnonzero(check & (shapes == shape))
            for some in np.array_split(these, 1 + len(these) * size // _CHECKED_BYTES):
                good[some] = kinds[kind].intact(rows_of(data, starts[some], size))
        unchecked &= ~check
        found = select(starts, sizes, good, len(data), final)
        check = unchecked & (starts < found.limit) & _uncovered(starts, found)
        if not check.any():
            return found


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
        self._tail = np.zeros(0, np.uint8)
        self._offset = self._last_end = 0
        self._seen_any = self._gap_begins_like_a_frame = False
        self._refused: set[str] = set()

    def feed(self, data: bytes) -> Decoded:
        """Decode what `data` completes."""
        return self._advance(data, final=False)

    def finish(self) -> Decoded:
        """Decode the remaining bytes; incomplete frames become discarded bytes."""
        return self._advance(b"", final=True)

    def _advance(self, fresh: bytes, final: bool) -> Decoded:
        data = np.concatenate([self._tail, np.frombuffer(fresh, np.uint8)])
        if not len(data) and not final:
            return Decoded(blank(0))
        found = find(self._kinds, data, final, self._between)
        if self._needed > 1:
            found = self._believed(found, final)
        counts = self._count(data, found)
        # A correct check does not imply correct numbers: numbers that are not finite are flagged.
        with np.errstate(over="ignore", invalid="ignore"):
            samples, events = self._read(data, found, self._offset, final)
        counts.frames, counts.special = len(samples), len(found.starts) - len(samples)
        self._keep_tail(data, found.limit, final, counts)
        reported = []
        for event in events:
            # Valid frames that are not read: each reason is reported once.
            if event.kind != "refused" or event.content["text"] not in self._refused:
                reported.append(event)
                self._refused |= {event.content["text"]} if event.kind == "refused" else set()
        return Decoded(samples, reported, counts)

    def _believed(self, found: Found, final: bool) -> Found:
        """Drop isolated frames while the frame boundary is unknown."""
        starts, ends = found.starts, found.starts + found.sizes
        keep, last_end = np.zeros(len(starts), bool), self._last_end - self._offset
        edges = np.flatnonzero(starts[1:] != ends[:-1]) + 1 if len(starts) else []
        for group in np.split(np.arange(len(starts)), edges) if len(starts) else []:
            near = self._locked and starts[group[0]] - last_end <= _LOCK_REACH_BYTES
            if near or len(group) >= self._needed:
                keep[group] = self._locked = True
                last_end = ends[group[-1]]
            elif ends[group[-1]] >= found.limit and not final:
                return Found(starts[keep], found.sizes[keep], int(starts[group[0]]))
            else:
                self._locked = False
        return Found(starts[keep], found.sizes[keep], found.limit)

    def _count(self, data: NDArray[np.uint8], found: Found) -> Counts:
        """Count the bytes between frames, and note the end of the last one."""
        counts = Counts()
        ends = np.append(self._last_end - self._offset, found.starts + found.sizes)
        gaps = found.starts - ends[:-1]
        for at, gap in zip(ends[:-1][gaps > 0].tolist(), gaps[gaps > 0].tolist(), strict=True):
            if self._is_between(data, at, gap):
                continue
            counts.discarded += gap
            if self._seen_any or at > ends[0]:
                counts.resyncs += 1
                counts.check_failures += self._begins(data, at) if at >= 0 else self._gap_begins_like_a_frame
        self._seen_any |= len(found.starts) > 0
        self._last_end = int(ends[-1]) + self._offset
        return counts

    def _begins(self, data: NDArray[np.uint8], at: int) -> bool:
        return any(kind.begins(data, at) for kind in self._kinds)

    def _is_between(self, data: NDArray[np.uint8], at: int, gap: int) -> bool:
        return at >= 0 and gap == len(self._between) and data[at : at + gap].tobytes() == self._between

    def _keep_tail(self, data: NDArray[np.uint8], limit: int, final: bool, counts: Counts) -> None:
        last_end = self._last_end - self._offset
        if final:
            rest, limit = len(data) - last_end, len(data)
            counts.discarded += 0 if self._is_between(data, last_end, rest) else rest
            self._last_end = self._offset + limit
        elif limit - last_end <= len(self._between):
            limit = max(last_end, 0)
        elif 0 <= last_end < limit:
            self._gap_begins_like_a_frame = self._begins(data, last_end)
        self._tail = data[limit:].copy()
        self._offset += limit


def decode_all(decoder: "Decoder", data: bytes, chunk: int = 1 << 22) -> Decoded:
    """Decode a whole byte log in pieces that fit into memory."""
    pieces = [decoder.feed(data[start : start + chunk]) for start in range(0, len(data), chunk)]
    pieces.append(decoder.finish())
    counts = Counts()
    for piece in pieces:
        counts.add(piece.counts)
    events = [event for piece in pieces for event in piece.events]
    return Decoded(joined([piece.samples for piece in pieces]), events, counts)
