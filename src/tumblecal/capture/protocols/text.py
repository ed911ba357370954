"""Lines of numbers, as boards with a sketch print them: commas, tabs, semicolons or spaces; with or without a header line.

The layout is learned from the stream (or given) and shown; a later header line begins a new layout from its line on. A
`*CC` checksum (exclusive or, NMEA-like) is verified if there is one, and then required. A stream without checksums is
unprotected: a lost character makes a plausible wrong number.
"""

import re
from dataclasses import asdict

import numpy as np

from tumblecal.capture.decoding.checks import exclusive_or
from tumblecal.capture.decoding.samples import (
    Counts,
    Decoded,
    Event,
    Samples,
    Settings,
    blank,
    joined,
    not_a_number,
)
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.capture.protocols.line_columns import (
    LineColumns,
    header_words,
    learn,
    looks_numeric,
    names_of,
    numbers_of,
)
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2, UNITS_PER_G


_LEARN_LINES = 25
_GIVE_UP_LINES = 400
_LONGEST_LINE = 1024


class TextDecoder:
    """Decodes lines to samples.

    **Arguments:**

    - `layout`: layout of the lines, which header lines do not change; learned from the first lines if None.
    - `whole`: the first line is complete (a file); otherwise it is dropped, since a port opens within a line.
    """

    def __init__(self, layout: LineColumns | None = None, whole: bool = False):
        self.layout = layout
        self._given = layout is not None
        self._tail = b""
        self._offset = 0
        self._drop_first = not whole
        self._header: list[str] | None = None
        self._waiting: list[tuple[int, bytes]] = []
        self._numeric = 0
        self._rows: list[tuple[int, list[float]]] = []
        self._checks_seen = 0
        self._rejecting = False

    def feed(self, data: bytes) -> Decoded:
        """Decode the lines that `data` completes."""
        text = self._tail + data
        *lines, self._tail = text.split(b"\n")
        numbered, place, counts = [], self._offset, Counts()
        for line in lines:
            place += len(line) + 1
            if self._drop_first or len(line) > _LONGEST_LINE:
                counts.discarded += len(line) + 1
                self._drop_first = False
            else:
                numbered.append((place, line))
        self._offset = place
        if len(self._tail) > _LONGEST_LINE:
            counts.discarded += len(self._tail)
            self._offset += len(self._tail)
            self._tail, self._drop_first = b"", True
        return self._lines(numbered, counts, final=False)

    def finish(self) -> Decoded:
        """Learn the layout from the available lines if this was not done yet; a last line without end is discarded."""
        counts = Counts(discarded=len(self._tail))
        self._tail = b""
        return self._lines([], counts, final=True)

    def _lines(self, numbered: list[tuple[int, bytes]], counts: Counts, final: bool) -> Decoded:
        events: list[Event] = []
        parts: list[Samples] = []
        for stop, line in numbered:
            body = self._checked(line, counts)
            if body is None:
                continue
            row = numbers_of(body, self.layout) if self.layout is not None else None
            if row is not None:
                self._rejecting = False
                self._rows.append((stop, row))
                continue
            header = header_words(body)
            if header is not None and header != self._header and not self._given:
                if self.layout is not None or self._numeric:
                    self._learn(counts, events, ended=True)
                    parts.append(self._samples(counts))
                self.layout, self._header = None, header
            if self.layout is None:
                self._wait(stop, body, counts, events)
            else:
                self._report_other_names(stop, header, events)
                self._reject(stop, body, counts, events)
        if final:
            self._learn(counts, events, ended=True)
        return Decoded(joined([*parts, self._samples(counts)]), events, counts)

    def _checked(self, line: bytes, counts: Counts) -> bytes | None:
        """The line without its checksum; None if it is wrong, or missing although lines have one."""
        line = line.rstrip(b"\r")
        body, star, check = line.rpartition(b"*")
        if star and re.fullmatch(rb"[0-9A-Fa-f]{2}", check):
            if int(check, 16) == exclusive_or(body.removeprefix(b"$")):
                self._checks_seen += 1
                self._rejecting = False
                return body
        elif (self._checks_seen < 3 and not (self.layout and self.layout.checked)) or header_words(line):
            return line
        counts.check_failures += 1
        counts.discarded += len(line) + 1
        counts.resyncs += not self._rejecting
        self._rejecting = True
        return None

    def _report_other_names(self, stop: int, header: list[str] | None, events: list[Event]) -> None:
        """Report a header line that contradicts the layout given by the user, which is used."""
        layout = self.layout
        if header is None or layout is None or header == self._header:
            return
        self._header = header
        named = names_of(header)
        if any(name not in ("-", role) for name, role in zip(named, layout.columns, strict=False)):
            text = f"a header line names the columns {','.join(named)}; used as given: {','.join(layout.columns)}"
            events.append(Event(stop, "refused", {"text": text}))

    def _wait(self, stop: int, body: bytes, counts: Counts, events: list[Event]) -> None:
        """Store a line until there are enough to learn the layout."""
        self._waiting.append((stop, body))
        if looks_numeric(body):
            self._numeric += 1
            if self._numeric % _LEARN_LINES == 0:
                self._learn(counts, events)
        if len(self._waiting) >= _GIVE_UP_LINES:
            self._learn(counts, events, ended=True)

    def _learn(self, counts: Counts, events: list[Event], ended: bool = False) -> None:
        """Learn the layout of the stored lines and read them; discard them if their stretch has `ended`."""
        if self.layout is not None or not self._waiting:
            return
        numeric = [text.decode("ascii", "replace").strip() for _, text in self._waiting if looks_numeric(text)]
        self.layout = learn(numeric, self._header, checked=self._checks_seen >= 3)
        if self.layout is None and not ended:
            return
        waiting, self._waiting, self._numeric = self._waiting, [], 0
        if self.layout is None:
            counts.discarded += sum(len(text) + 1 for _, text in waiting)
            if numeric:
                text = f"no specific force was found in the preceding {len(numeric)} lines of numbers: left out"
                events.append(Event(waiting[-1][0], "refused", {"text": text}))
            return
        content = asdict(self.layout) | {"unprotected": not self.layout.checked}
        events.append(Event(waiting[0][0], "layout", content))
        for stop, text in waiting:
            row = numbers_of(text, self.layout)
            if row is None:
                self._reject(stop, text, counts, events)
            else:
                self._rejecting = False
                self._rows.append((stop, row))

    def _samples(self, counts: Counts) -> Samples:
        """The rows read since the last call, all with the present layout."""
        rows, self._rows = self._rows, []
        samples = blank(len(rows))
        layout = self.layout
        if not rows or layout is None:
            return samples
        counts.frames += len(rows)
        table = np.array([row for _, row in rows])
        places = {role: at for at, role in enumerate(layout.columns)}
        samples.stop[:] = [stop for stop, _ in rows]
        samples.force[:] = table[:, [places["ax"], places["ay"], places["az"]]] / UNITS_PER_G[layout.unit]
        if {"gx", "gy", "gz"} <= set(places):
            samples.rate[:] = table[:, [places["gx"], places["gy"], places["gz"]]]
        if "t" in places:
            samples.temperature[:] = table[:, places["t"]]
        if "time" in places:
            samples.clock[:] = table[:, places["time"]]
        if "counter" in places:
            values = table[:, places["counter"]]
            known = np.abs(values) < 2.0**62
            samples.counter[known] = values[known].astype(np.int64)
        samples.status[:] = not_a_number(samples.force)
        return samples

    def _reject(self, stop: int, raw: bytes, counts: Counts, events: list[Event]) -> None:
        text = raw.decode("ascii", "replace").strip()
        if text and re.search(r"[A-Za-z]", text) and not re.search(r"\b(nan|inf|ovf)\b", text, re.I):
            counts.special += 1
            events.append(Event(stop, "reply", {"text": text[:200]}))
            return
        counts.discarded += len(raw) + 1
        counts.resyncs += not self._rejecting
        self._rejecting = True


def encode(samples: Samples, settings: Settings) -> bytes:
    """Lines `$IMU,seq,micros,ax,ay,az,gx,gy,gz,T*CC` with m/s^2 and deg/s, which have a checksum and a counter."""
    lines = []
    for seq, force, rate, temperature in zip(
        samples.counter.tolist(),
        (samples.force * STANDARD_GRAVITY_MS2).tolist(),
        np.nan_to_num(samples.rate).tolist(),
        np.nan_to_num(samples.temperature).tolist(),
        strict=True,
    ):
        micros = int(seq * 1e6 / (settings.rate_hz or 100.0)) % 2**32
        numbers = [f"{v:.5f}" for v in force] + [f"{v:.4f}" for v in rate]
        body = ",".join(["IMU", str(seq), str(micros), *numbers, f"{temperature:.2f}"])
        lines.append(f"${body}*{exclusive_or(body.encode()):02X}\r\n")
    return "".join(lines).encode()


def _decoder(settings: Settings | None = None, columns: str = "", unit: str = "", whole: bool = False) -> TextDecoder:
    layout = LineColumns(tuple(columns.replace(" ", "").split(",")), unit or "g") if columns else None
    return TextDecoder(layout, whole)


PROTOCOL = Protocol(
    name="text",
    title="lines of numbers (CSV, tabs, NMEA-like)",
    decoder=_decoder,
    encode=encode,
    bauds=(115200, 9600, 57600, 230400, 921600),
    counter=DeviceCounter(modulus=2**32, ticks_per_s=None),
    checked=False,
    options=("columns", "unit", "whole"),
)
