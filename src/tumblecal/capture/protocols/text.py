"""Lines of numbers, as boards with a sketch print them: commas, tabs, semicolons or spaces; with or without a header line.

The layout is learned from the stream (or given) and shown; a later header line begins a new layout from its line on. A
`*CC` checksum (exclusive or, NMEA-like) is verified if there is one, and then required. A stream without checksums is
unprotected: a lost character makes a plausible wrong number.
"""

import re
from dataclasses import asdict

import numpy as np

from tumblecal.capture.decoding.checks import exclusive_or
from tumblecal.capture.decoding.samples import Counts, Decoded, Event, Samples, Settings, blank, not_a_number
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.capture.protocols.line_columns import LineColumns, header_words, learn, looks_numeric, names_of
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_LEARN_LINES = 25
_GIVE_UP_LINES = 400
_LONGEST_LINE = 1024
_CHECKED_LINES = 3


class TextDecoder:
    """Decodes lines to samples.

    **Arguments:**

    - `layout`: layout of the lines, which header lines do not change; learned from the first lines if None.
    - `whole`: the first line is complete (a file); otherwise it is dropped, since a port opens within a line.
    """

    def __init__(self, layout: LineColumns | None = None, whole: bool = False):
        self.layout, self._given = layout, layout is not None
        self._tail, self._offset, self._drop_first = b"", 0, not whole
        self._header: list[str] | None = None
        self._checks_seen, self._rejecting = 0, False
        # Lines of a layout that is not known yet.
        self._waiting, self._numeric = list[tuple[int, bytes]](), 0
        self._begin()

    def _begin(self) -> None:
        self._rows, self._counts, self._events = list[list[float]](), Counts(), list[Event]()

    def feed(self, data: bytes) -> Decoded:
        """Decode the lines that `data` completes."""
        *lines, self._tail = (self._tail + data).split(b"\n")
        for line in lines:
            self._offset += len(line) + 1
            if self._drop_first or len(line) > _LONGEST_LINE:
                self._counts.discarded += len(line) + 1
                self._drop_first = False
            else:
                self._line(self._offset, line.rstrip(b"\r"))
        if len(self._tail) > _LONGEST_LINE:
            self._counts.discarded += len(self._tail)
            self._offset += len(self._tail)
            self._tail, self._drop_first = b"", True
        return self._decoded()

    def finish(self) -> Decoded:
        """Learn the layout from the available lines if this was not done yet; a last line without end is discarded."""
        self._counts.discarded += len(self._tail)
        self._tail = b""
        self._learn(ended=True)
        return self._decoded()

    def _decoded(self) -> Decoded:
        samples = _samples(self._rows)
        self._counts.frames = len(samples)
        decoded = Decoded(samples, self._events, self._counts)
        self._begin()
        return decoded

    def _line(self, stop: int, line: bytes) -> None:
        """Read a line, or store it until the layout is known."""
        body, star, check = line.rpartition(b"*")
        has_check = bool(star and re.fullmatch(rb"[0-9A-Fa-f]{2}", check))
        if has_check and int(check, 16) == exclusive_or(body.removeprefix(b"$")):
            self._checks_seen += 1
            self._rejecting, line = False, body
        elif has_check or (self._has_checks() and not header_words(line)):
            self._counts.check_failures += 1
            self._discard(line)
            return
        if self.layout and self._read(stop, line, self.layout):
            return
        header = header_words(line)
        if header and header != self._header:
            self._begin_layout(stop, header)
        if self.layout:
            self._other(stop, line)
            return
        self._waiting.append((stop, line))
        if looks_numeric(line):
            self._numeric += 1
            if self._numeric % _LEARN_LINES == 0:
                self._learn()
        if len(self._waiting) >= _GIVE_UP_LINES:
            self._learn(ended=True)

    def _has_checks(self) -> bool:
        return self._checks_seen >= _CHECKED_LINES or bool(self.layout and self.layout.checked)

    def _begin_layout(self, stop: int, header: list[str]) -> None:
        """A new header line: it begins a new layout, or is reported if it contradicts the layout given by the user."""
        if not self._given:
            if self._numeric:
                self._learn(ended=True)
            self.layout = None
        self._header = header
        if self.layout:
            named, used = names_of(header), self.layout.columns
            if any(name not in ("-", role) for name, role in zip(named, used, strict=False)):
                text = f"a header line names the columns {','.join(named)}; used as given: {','.join(used)}"
                self._events.append(Event(stop, "refused", {"text": text}))

    def _learn(self, ended: bool = False) -> None:
        """Learn the layout of the stored lines and read them; discard them if their stretch has `ended`."""
        numeric = [line.decode("ascii", "replace").strip() for _, line in self._waiting if looks_numeric(line)]
        if not self._waiting:
            return
        layout = learn(numeric, self._header, checked=self._checks_seen >= _CHECKED_LINES)
        if layout is None and not ended:
            return
        waiting, self._waiting, self._numeric = self._waiting, [], 0
        self.layout = layout
        if layout is None:
            self._counts.discarded += sum(len(line) + 1 for _, line in waiting)
            if numeric:
                text = f"no specific force was found in the preceding {len(numeric)} lines of numbers: left out"
                self._events.append(Event(waiting[-1][0], "refused", {"text": text}))
            return
        self._events.append(Event(waiting[0][0], "layout", asdict(layout) | {"unprotected": not layout.checked}))
        for stop, line in waiting:
            if not self._read(stop, line, layout):
                self._other(stop, line)

    def _read(self, stop: int, line: bytes, layout: LineColumns) -> bool:
        row = layout.row(line)
        if row is not None:
            self._rejecting = False
            self._rows.append([stop, *row])
        return row is not None

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


def _samples(rows: list[list[float]]) -> Samples:
    samples, table = blank(len(rows)), np.array(rows, float).reshape(-1, 10).T
    samples.stop[:], samples.force[:], samples.rate[:] = table[0], table[1:4].T, table[4:7].T
    samples.temperature[:], samples.clock[:] = table[7], table[9]
    counted = np.abs(table[8]) < 2.0**62
    samples.counter[counted] = table[8][counted].astype(int)
    samples.status[:] = not_a_number(samples.force)
    return samples


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
