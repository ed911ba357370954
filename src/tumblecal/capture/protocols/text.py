"""Lines of numbers, as boards with a sketch print them: commas, tabs, semicolons or spaces, with a header line.

Columns without a header line must be given; lines `$IMU,counter,microseconds,ax,ay,az,gx,gy,gz,T` (m/s^2, deg/s, degC) need
neither. Separator and decimal mark are learned from the lines and shown. A header line begins a new layout from its line on.

A `*CC` checksum (exclusive or, NMEA-like) is verified if there is one, and then required. A stream without checksums is
unprotected: a lost character makes a plausible wrong number.
"""

import re
from dataclasses import asdict

import numpy as np

from tumblecal.capture.decoding.checks import exclusive_or
from tumblecal.capture.decoding.samples import Counts, Decoded, Event, Samples, Settings, samples_of
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.capture.protocols.line_columns import (
    LineColumns,
    check_given,
    header_words,
    learn,
    looks_numeric,
    names_of,
)
from tumblecal.data.column_names import FORCE, RATE
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_LEARN_LINES, _GIVE_UP_LINES = 25, 400
_LONGEST_LINE = 1024
_CHECKED_LINES = 3
# The columns of lines `$IMU,...`, as `encode` writes them.
_IMU = ["counter", "time", "ax_ms2", "ay_ms2", "az_ms2", *RATE, "temperature"]


class TextDecoder:
    """Decodes lines to samples.

    **Arguments:**

    - `columns`, `unit`: quantity of each column, and unit of the specific force, which header lines do not change; empty:
      those of a header line.
    - `whole`: the first line is complete (a file); otherwise it is dropped, since a port opens within a line.
    """

    def __init__(self, columns: str = "", unit: str = "", whole: bool = False):
        self._given = tuple(columns.replace(" ", "").split(",")) if columns else (), unit
        check_given(*self._given)
        self._layout: LineColumns | None = None
        self._tail, self._offset, self._drop_first = b"", 0, not whole
        self._header = list[str]()
        self._checks_seen, self._rejecting = 0, False
        # Lines of a layout that is not known yet, and the reasons reported so far.
        self._waiting, self._reported = list[tuple[int, bytes]](), set[str]()
        self._rows, self._counts, self._events = list[tuple](), Counts(), list[Event]()

    def feed(self, data: bytes, final: bool = False) -> Decoded:
        """Decode the lines that `data` completes."""
        *lines, self._tail = (self._tail + data).split(b"\n")
        for line in lines:
            self._offset += len(line) + 1
            if self._drop_first or len(line) > _LONGEST_LINE:
                self._counts.discarded += len(line) + 1
                self._drop_first = False
            else:
                self._line(self._offset, line.rstrip(b"\r"))
            if self._layout or len(self._waiting) % _LEARN_LINES == 0:
                self._read()
        if final or len(self._tail) > _LONGEST_LINE:
            self._counts.discarded += len(self._tail)
            self._offset += len(self._tail)
            self._tail, self._drop_first = b"", True
        if final:
            self._read(ended=True)
        decoded = Decoded(samples_of(self._rows), self._events, self._counts)
        decoded.counts.frames = len(self._rows)
        self._rows, self._counts, self._events = list[tuple](), Counts(), list[Event]()
        return decoded

    def finish(self) -> Decoded:
        """Learn the layout from the available lines if this was not done yet; a last line without end is discarded."""
        return self.feed(b"", final=True)

    def _line(self, stop: int, line: bytes) -> None:
        """Check a line, and store it until the layout is known."""
        body, star, check = line.rpartition(b"*")
        has_check = bool(star and re.fullmatch(rb"[0-9A-Fa-f]{2}", check))
        intact = has_check and int(check, 16) == exclusive_or(body.removeprefix(b"$"))
        required = self._checks_seen >= _CHECKED_LINES or (self._layout is not None and self._layout.checked)
        line = body if intact else line
        self._checks_seen += intact
        self._rejecting &= not intact
        header = header_words(line)
        if not intact and (has_check or (required and not header)):
            self._counts.check_failures += 1
            self._discard(line)
            return
        if header and header != self._header:
            (given, _), named = self._given, names_of(header)
            if not given:
                # It begins a new layout.
                if any(looks_numeric(line) for _, line in self._waiting):
                    self._read(ended=True)
                self._layout = None
            self._header = header
            if any(name not in ("-", role) for name, role in zip(named, given, strict=False)):
                words = f"a header line names the columns {','.join(named)}; used as given: {','.join(given)}"
                self._refuse(stop, words)
        self._waiting.append((stop, line))

    def _refuse(self, stop: int, text: str) -> None:
        if (reason := text.partition(":")[0]) not in self._reported:
            self._reported.add(reason)
            self._events.append(Event(stop, "refused", {"text": text}))

    def _read(self, ended: bool = False) -> None:
        """Read the stored lines if their layout is known, or can be learned; discard them if their stretch has `ended`."""
        waiting, question = self._waiting, ""
        if self._layout is None:
            numeric = [line.decode("ascii", "replace").strip() for _, line in waiting if looks_numeric(line)]
            checked = self._checks_seen >= _CHECKED_LINES
            header = _IMU if 2 * sum(line.startswith("$IMU,") for line in numeric) > len(numeric) else []
            self._layout, question = learn(numeric, self._header or header, self._given, checked)
            if not (self._layout or question or ended or len(waiting) >= _GIVE_UP_LINES):
                return
            if self._layout:
                content = asdict(self._layout) | {"unprotected": not self._layout.checked}
                self._events.append(Event(waiting[0][0], "layout", content))
            elif numeric:
                words = f"no specific force was found in {len(numeric)} lines of numbers: left out"
                self._refuse(waiting[-1][0], question or words)
        self._waiting = []
        for stop, line in waiting:
            row = self._layout.row(line) if self._layout else None
            if row:
                self._rejecting = False
                triads = [[row.get(role, np.nan) for role in roles] for roles in (FORCE, RATE)]
                counter = row.get("counter", -1.0)
                counter = int(counter) if abs(counter) < 2.0**62 else -1
                self._rows.append((stop, *triads, row.get("t", np.nan), counter, 0, row.get("time", np.nan)))
            elif question and looks_numeric(line):
                self._counts.special += 1
            elif self._layout or question:
                self._other(stop, line)
            else:
                self._counts.discarded += len(line) + 1

    def _other(self, stop: int, line: bytes) -> None:
        """A line that is no sample: text of the device, or damaged."""
        text = line.decode("ascii", "replace").strip()
        if re.search(r"[A-Za-z]", text) and not re.search(r"\b(nan|inf|ovf)\b", text, re.IGNORECASE):
            self._counts.special += 1
            self._events.append(Event(stop, "reply", {"text": text[:200]}))
        else:
            self._discard(line)

    def _discard(self, line: bytes) -> None:
        self._counts.discarded += len(line) + 1
        self._counts.resyncs += not self._rejecting
        self._rejecting = True


def encode(samples: Samples, settings: Settings) -> bytes:
    """Lines `$IMU,seq,micros,ax,ay,az,gx,gy,gz,T*CC` with m/s^2 and deg/s, which have a checksum and a counter."""
    lines, form = [], "IMU,{},{}" + 3 * ",{:.5f}" + 3 * ",{:.4f}" + ",{:.2f}"
    for sample in samples:
        micros = int(sample.counter * 1e6 / (settings.rate_hz or 100.0)) % 2**32
        others = np.nan_to_num([*sample.rate, sample.temperature])
        body = form.format(sample.counter, micros, *sample.force * STANDARD_GRAVITY_MS2, *others)
        lines.append(f"${body}*{exclusive_or(body.encode()):02X}\r\n")
    return "".join(lines).encode()


PROTOCOL = Protocol(
    name="text",
    title="lines of numbers (CSV, tabs, NMEA-like)",
    decoder=lambda settings=None, **options: TextDecoder(**options),
    encode=encode,
    bauds=(115200, 9600, 57600, 230400, 921600),
    counter=DeviceCounter(modulus=2**32, ticks_per_s=None),
    checked=False,
    options=("columns", "unit", "whole"),
)
