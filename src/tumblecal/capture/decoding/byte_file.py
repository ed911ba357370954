"""Byte logs from other programs: protocol, contents, and the samples as a table, read in pieces for files of any size."""

from collections import deque
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.capture.decoding.sample_table import known_columns, table_of, write_frames
from tumblecal.capture.decoding.samples import UNKNOWN, Decoded, Event, Stated, blank, usable
from tumblecal.capture.decoding.sniff import guessed
from tumblecal.capture.decoding.tally import Tally
from tumblecal.capture.log import MAGIC, LogReader, RecordKind
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.protocols.stim300 import settings_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted


_PIECE, _RECORDS = 1 << 20, 1 << 10
_STORED_EVENTS = 8


def pieces_of(path: Path, faults: list[str] | None = None) -> Iterator[bytes]:
    """The bytes of a file as received from the port, or of the raw log of a capture, in pieces of about a megabyte.

    **Arguments:**

    - `faults`: receives a line for each stretch of a raw log without a record.

    **Raises:** `InputError` if the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            if not file.peek(len(MAGIC)).startswith(MAGIC):
                yield from iter(partial(file.read, _PIECE), b"")
                return
        with closing(LogReader(path)) as reader:
            payloads = (record.payload for record in reader.records() if record.kind == RecordKind.BYTES)
            yield from iter(lambda: b"".join(islice(payloads, _RECORDS)), b"")
            if faults is not None:
                faults[:] = reader.faults()
    except IsADirectoryError as error:
        raise InputError(f"{path}: a folder; give a file of bytes, such as {path / 'raw.log'} of a capture") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


class _StatedLate(Exception):
    """The stream states a property that the rows before it need."""


class FileContents(Tally):
    """The contents of a byte log, accumulated piece by piece.

    `events`: the first of each kind. `samples`: number of samples; `good`: without a fault. `of_log`: stretches of a capture's
    raw log without a record.
    """

    def __init__(self, protocol: Protocol, rate_hz: float | None):
        super().__init__(protocol.counter, rate_hz)
        self.protocol, self.rate_hz = protocol, rate_hz
        self.events, self.of_log, self.samples, self.good = list[Event](), list[str](), 0, 0
        # A typical specific force, and sums of the differences from it and of their squares.
        self._typical, self._sums = np.zeros(3), np.zeros((2, 3))

    def add(self, piece: Decoded) -> None:
        """Count a piece."""
        super().add(piece)
        self.samples += len(piece.samples)
        for event in piece.events:
            known = sum(earlier.kind == event.kind for earlier in self.events)
            self.events += [event] * (known < _STORED_EVENTS)
        force = piece.samples.force[usable(piece.samples)]
        if len(force):
            self._typical = self._typical if self.good else force[0]
            self.good += len(force)
            with np.errstate(over="ignore", invalid="ignore"):
                difference = force - self._typical
                self._sums += [difference.sum(0), (difference**2).sum(0)]

    def faults(self) -> Iterator[str]:
        """Unreadable parts, one line each."""
        yield from self.of_log
        if self.counts.discarded or self.counts.check_failures:
            yield (
                f"{self.counts.discarded} of {self.bytes} bytes are outside complete frames, and "
                f"{counted(self.counts.check_failures, 'frame')} with a wrong check: left out"
            )
        if flagged := self.samples - self.good:
            yield f"{counted(flagged, 'sample')} marked as faulty by the device, or without a number: left out"

    def losses(self) -> str:
        """A line on lost samples; empty if there is no counter."""
        counter = self.protocol.counter
        if counter is None or self.numbered is None:
            return ""
        lost, gaps, replaced, _ = self.numbered
        wraps = f" (whole wraps of {counter.modulus} cannot be seen in a file)" if counter.modulus <= 65536 else ""
        return f"lost by the counter: {lost} in {gaps} gaps, {replaced} replaced by other messages{wraps}"

    def statistics(self) -> str:
        """Means and standard deviations of the good samples."""
        if not self.good:
            return (
                "no specific force in g: the stream does not state the range; "
                "give --range-g (it is set in the device, do not guess)"
            )
        with np.errstate(over="ignore", invalid="ignore"):
            first, second = self._sums / self.good
            mean, sd = self._typical + first, 1e3 * np.sqrt(np.maximum(second - first**2, 0.0))
        means, sds = " ".join(f"{v:+.6f}" for v in mean), " ".join(f"{v:.3f}" for v in sd)
        return f"{self.good} good samples: mean {means} g, sd {sds} mg, size {np.linalg.norm(mean):.5f} g"


def decode_file(
    path: Path,
    name: str | None = None,
    *,
    out: Path | None = None,
    stated: Stated = Stated(),
) -> FileContents:
    """Decode a whole file in pieces, and write its samples if `out` is given; without samples no file is written.

    **Arguments:**

    - `path`: bytes as received, or the raw log of a capture.
    - `name`: protocol; guessed if None.
    - `out`: table to write, .csv or .parquet, complete or not at all.
    - `stated`: settings that the stream does not state.

    **Raises:** `InputError` if a file cannot be read or written, or no protocol fits.
    """
    if out is not None and out.suffix not in (".csv", ".parquet"):
        raise InputError(f"{out}: must end in .csv or .parquet")
    start = next(pieces_of(path), b"")
    if not start:
        raise InputError(f"{path}: the file is empty")
    how = protocol(name or guessed(path, start))
    if ignored := [f"--{name}" for name in ("columns", "unit") if getattr(stated, name) and not how.columns]:
        raise InputError(f"{path}: {how.title} states its columns itself; remove {' and '.join(ignored)}")
    if stated.range_g is not None and stated.range_g not in how.ranges_g:
        known = ", ".join(f"{r:g}" for r in how.ranges_g) or "none: its output is scaled already"
        raise InputError(f"--range-g {stated.range_g:g}: not a range of {how.name}; its ranges: {known}")
    # The stream may state its settings late, and columns are known when they occur: then it is decoded again.
    unknown, rate_hz = stated.range_g is None and how.range_from_stream, stated.rate_hz
    given = how.settings(stated.range_g, rate_hz, stated.columns, stated.unit)
    settings, columns = None if unknown else replace(given, whole=True), set[str]()

    def frame(table: dict[str, np.ndarray]) -> pl.DataFrame:
        return pl.DataFrame({name: values for name, values in table.items() if name in columns})

    def frames(contents: FileContents) -> Iterator[pl.DataFrame]:
        nonlocal settings, rate_hz
        decoder = how.decoder(settings or UNKNOWN)
        for data in chain(pieces_of(path, contents.of_log), [b""]):
            contents.bytes += len(data)
            piece = decoder.feed(data) if data else decoder.finish()
            for event in piece.events:
                if settings is None and "range_g" in event.content:
                    settings, rate_hz = settings_of(event.content), event.content["rate_hz"] or rate_hz
                    raise _StatedLate
            table = table_of(piece.samples, rate_hz, contents.samples) if out else {}
            if len(piece.samples) and not known_columns(table) <= columns:
                columns.update(known_columns(table))
                raise _StatedLate
            contents.add(piece)
            yield frame(table)

    while True:
        contents = FileContents(how, rate_hz)
        with suppress(_StatedLate):
            if out is not None and columns:
                write_frames(out, frames(contents), frame(table_of(blank(0), rate_hz)).schema)
            else:
                deque(frames(contents), 0)
            return contents
