"""Byte logs from other programs: protocol, contents, and the samples as a table, read in pieces for files of any size."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tumblecal.capture.decoding.frame_numbers import FrameNumbers
from tumblecal.capture.decoding.losses import commonest_step
from tumblecal.capture.decoding.sample_table import columns_of, write_pieces
from tumblecal.capture.decoding.samples import Counts, Decoded, Event, Samples, Settings, Stated
from tumblecal.capture.decoding.sniff import ENOUGH, guesses
from tumblecal.capture.log import MAGIC, LogReader, RecordKind
from tumblecal.capture.protocols import Decoder, Protocol, protocol
from tumblecal.capture.protocols.stim300_datagrams import settings_of
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError


_PIECE = 1 << 20
_STORED_EVENTS = 8


def pieces_of(path: Path, faults: list[str] | None = None) -> Iterator[bytes]:
    """The bytes of a file as received from the port, or of the raw log of a capture, a megabyte at a time.

    **Arguments:**

    - `faults`: receives a line for each stretch of a raw log without a record.

    **Raises:** `InputError` if the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            piece = file.read(_PIECE)
            if not piece.startswith(MAGIC):
                while piece:
                    yield piece
                    piece = file.read(_PIECE)
                return
        with LogReader(path) as reader:
            payloads, size = [], 0
            for record in reader.records():
                if record.kind == RecordKind.BYTES:
                    payloads.append(record.payload)
                    size += len(record.payload)
                if size >= _PIECE:
                    yield b"".join(payloads)
                    payloads, size = [], 0
            yield b"".join(payloads)
            if faults is not None:
                faults[:] = reader.faults()
    except IsADirectoryError as error:
        inside = path / "raw.log"
        raise InputError(f"{path}: a folder; give a file of bytes{f', {inside}' * inside.is_file()}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


@dataclass(frozen=True)
class _Known:
    """Properties of a stream that are needed before the first row is written; the stream may state them late.

    `columns`: columns of the table so far; None if no table is written.
    """

    settings: Settings | None
    rate_hz: float | None
    columns: frozenset[str] | None


class _Again(Exception):
    """The stream stated a property that the rows before it need."""

    def __init__(self, known: _Known):
        self.known = known


@dataclass
class FileContents:
    """The contents of a byte log, accumulated piece by piece.

    `events`: the first of each kind; `event_counts`: number of events. `samples`: number of samples. `of_log`: stretches
    without a record in a capture's raw log.
    """

    protocol: Protocol
    rate_hz: float | None
    counts: Counts = field(default_factory=Counts)
    events: list[Event] = field(default_factory=list)
    event_counts: Counter[str] = field(default_factory=Counter)
    samples: int = 0
    size: int = 0
    good: int = 0
    of_log: list[str] = field(default_factory=list)
    _mean: np.ndarray = field(default_factory=lambda: np.zeros(3))
    _squares: np.ndarray = field(default_factory=lambda: np.zeros(3))
    _frames: FrameNumbers | None = None

    def add(self, piece: Decoded) -> None:
        """Count a piece."""
        self.counts.add(piece.counts)
        self.samples += len(piece.samples)
        for event in piece.events:
            self.event_counts[event.kind] += 1
            if self.event_counts[event.kind] <= _STORED_EVENTS:
                self.events.append(event)
        self._add_statistics(piece.samples)
        self._add_losses(piece)

    def _add_statistics(self, samples: Samples) -> None:
        force = samples.force[(samples.status == 0) & np.isfinite(samples.force).all(1)]
        n = len(force)
        if not n:
            return
        # Combined means and squares of two stretches: Chan, Golub & LeVeque 1983.
        with np.errstate(over="ignore", invalid="ignore"):
            mean = force.mean(0)
            change, total = mean - self._mean, self.good + n
            self._squares = self._squares + ((force - mean) ** 2).sum(0) + change**2 * (self.good * n / total)
            self._mean = self._mean + change * (n / total)
        self.good = total

    def _add_losses(self, piece: Decoded) -> None:
        counter, samples = self.protocol.counter, piece.samples
        if counter is None or not len(samples) or samples.counter[0] < 0:
            return
        if self._frames is None:
            step = commonest_step(samples.counter, counter.modulus)
            if counter.ticks_per_s and self.rate_hz:
                step = max(1, round(counter.ticks_per_s / self.rate_hz))
            self._frames = FrameNumbers(counter.modulus, step)
        # A file has no stamps: only losses that the counter shows can be counted.
        replies = [event.stop for event in piece.events if event.counted]
        places = np.searchsorted(samples.stop, np.array(replies, np.int64))
        self._frames.take(samples.counter, samples.content, replies=places)

    def faults(self) -> Iterator[str]:
        """Unreadable parts, one line each."""
        yield from self.of_log
        if self.counts.discarded or self.counts.check_failures:
            yield (
                f"{self.counts.discarded} of {self.size} bytes are outside complete frames, and "
                f"{counted(self.counts.check_failures, 'frame')} with a wrong check: left out"
            )
        if flagged := self.samples - self.good:
            yield f"{counted(flagged, 'sample')} marked as faulty by the device, or without a number: left out"

    def losses(self) -> str:
        """A line on lost samples; empty if there is no counter."""
        counter = self.protocol.counter
        found = self._frames
        if counter is None or found is None or self.samples < 3:
            return ""
        wraps = f" (whole wraps of {counter.modulus} cannot be seen in a file)" if counter.modulus <= 65536 else ""
        return f"lost by the counter: {found.lost} in {found.gaps} gaps, {found.replaced} replaced by other messages{wraps}"

    def statistics(self) -> str:
        """Means and standard deviations of the good samples."""
        if not self.good:
            return (
                "no specific force in g: the stream does not state the range; "
                "give --range-g (it is set in the device, do not guess)"
            )
        mean = " ".join(f"{v:+.6f}" for v in self._mean)
        sd = " ".join(f"{v * 1e3:.3f}" for v in np.sqrt(self._squares / self.good))
        return f"{self.good} good samples: mean {mean} g, sd {sd} mg, size {np.linalg.norm(self._mean):.5f} g"


def decode_file(
    path: Path,
    name: str | None = None,
    *,
    out: Path | None = None,
    stated: Stated = Stated(),
    progress: Callable[[int], None] = lambda size: None,
) -> FileContents:
    """Decode a whole file in pieces, and write its samples if `out` is given; without samples no file is written.

    **Arguments:**

    - `path`: bytes as received, or the raw log of a capture.
    - `name`: protocol; guessed if None.
    - `out`: table to write, .csv or .parquet, complete or not at all.
    - `stated`: settings that the stream does not state.
    - `progress`: called with the number of finished bytes.

    **Raises:** `InputError` if a file cannot be read or written, or no protocol fits.
    """
    if out is not None and out.suffix not in (".csv", ".parquet"):
        raise InputError(f"{out}: must end in .csv or .parquet")
    start = next(pieces_of(path), b"")
    if not start:
        raise InputError(f"{path}: the file is empty")
    device_protocol = protocol(name) if name is not None else _guessed(path, start)
    options = device_protocol.decoder_options(stated.columns, stated.unit, whole=True)
    ignored = [f"--{name}" for name in ("columns", "unit") if getattr(stated, name) and name not in options]
    if ignored:
        raise InputError(
            f"{path}: {device_protocol.title} states its columns itself; remove {' and '.join(ignored)}, which only lines of "
            "text take (or give another --protocol)"
        )
    known = _Known(_settings(device_protocol, stated), stated.rate_hz, None if out is None else frozenset())
    while True:
        contents = FileContents(device_protocol, known.rate_hz)
        samples = _samples(path, device_protocol.decoder(known.settings, **options), known, contents, progress)
        try:
            if out is not None and known.columns:
                write_pieces(out, samples, known.columns, known.rate_hz)
            else:
                for _ in samples:
                    pass
            return contents
        except _Again as again:
            known = again.known


def _samples(
    path: Path, decoder: Decoder, known: _Known, contents: FileContents, progress: Callable[[int], None]
) -> Iterator[Samples]:
    """Samples piece by piece. **Raises:** `_Again` if a piece states a property that the rows before it need."""

    def counted(piece: Decoded) -> Samples:
        learned = _learned(known, piece)
        if learned != known:
            raise _Again(learned)
        contents.add(piece)
        return piece.samples

    for data in pieces_of(path, contents.of_log):
        contents.size += len(data)
        yield counted(decoder.feed(data))
        progress(contents.size)
    yield counted(decoder.finish())


def _learned(known: _Known, piece: Decoded) -> _Known:
    configured = next((e.content for e in piece.events if e.kind == "configuration" and "range_g" in e.content), None)
    if configured is not None and known.settings is None:
        known = replace(known, settings=settings_of(configured), rate_hz=configured.get("rate_hz") or known.rate_hz)
    if known.columns is not None and len(piece.samples):
        known = replace(known, columns=known.columns | columns_of(piece.samples))
    return known


def _guessed(path: Path, data: bytes) -> Protocol:
    ranked = guesses(data[:65536])
    if ranked[0].explained < ENOUGH or not ranked[0].frames + ranked[0].special:
        seen = ", ".join(f"{g.name} {g.explained:.0%}" for g in ranked if g.explained > 0.01) or "nothing"
        raise InputError(
            f"{path}: no protocol fits these bytes (recognised: {seen}); to read them anyway, give --protocol"
        )
    return protocol(ranked[0].name)


def _settings(device_protocol: Protocol, stated: Stated) -> Settings | None:
    if stated.range_g is None and device_protocol.range_from_stream:
        return None
    if stated.range_g is not None and stated.range_g not in device_protocol.ranges_g:
        known = ", ".join(f"{r:g}" for r in device_protocol.ranges_g) or "none: its output is scaled already"
        raise InputError(f"--range-g {stated.range_g:g}: not a range of {device_protocol.name}; its ranges: {known}")
    return device_protocol.settings(stated.range_g, stated.rate_hz)
