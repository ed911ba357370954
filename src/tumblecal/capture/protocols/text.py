"""Lines of numbers, as boards with a sketch print them: commas, tabs, semicolons or spaces, with a header line.

Columns without a header line must be given; lines `$IMU,counter,microseconds,ax,ay,az,gx,gy,gz,T` (m/s^2, deg/s, degC) need
neither. Separator and decimal mark are learned from the lines and shown. The unit is given, comes from the column names, or is
the usual one in which the specific force has a length of one g. A header line begins a new layout from its line on.

A `*CC` checksum (exclusive or, NMEA-like) is verified if there is one, and then required. A stream without checksums is
unprotected: a lost character makes a plausible wrong number.
"""

import re
from collections.abc import Sequence

import numpy as np

from tumblecal.capture.decoding.checks import exclusive_or
from tumblecal.capture.decoding.samples import UNKNOWN, Counts, Decoded, Event, Floats, Samples, Settings, samples_of
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.data.column_names import FORCE, RATE, parsed, role_of
from tumblecal.data.text_cells import separator_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2, UNITS_PER_G


_LEARN_LINES, _GIVE_UP_LINES, _LONGEST_LINE, _CHECKED_LINES = 25, 400, 1024, 3
# Lines of a layout from which its columns are proposed.
_FEWEST_LINES = 5
# A number, or a word that boards print instead of a missing one.
_CELL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)$|[+-]?(?:nan|inf(?:inity)?|ovf)$", re.IGNORECASE)
_ROLES = (*FORCE, *RATE, "t", "counter", "time")
# Names with another meaning, or none, in other tables.
_NAMES = {"tms": "time", "tus": "time", "temperature": "t"} | {f"g_{axis}": f"g{axis}" for axis in "xyz"}
_NAMES |= dict.fromkeys(("seq", "n", "count", "counter", "index", "packet", "sample", "no"), "counter")
# The columns of lines `$IMU,...`, as `encode` writes them.
_IMU = ["counter", "time", "ax_ms2", "ay_ms2", "az_ms2", *RATE, "temperature"]


class _Layout:
    """Layout of the lines: separator (" " means any white space), decimal mark, quantity of each column, unit of the force."""

    def __init__(self, lines: list[str]):
        self.separator = separator_of(lines)
        # Between other separators a comma is a decimal mark: boards write no thousands separators.
        self.decimal_comma = self.separator != "," and any("," in line for line in lines)
        self.columns, self.unit, self.checked = (), "", False

    def numbers(self, line: str) -> list[float]:
        """The numbers of a line, without a leading name, NaN for nan, inf and ovf; empty for a line with other words."""
        words = line.split(None if self.separator == " " else self.separator)
        words = [word.strip().replace(",", ".") if self.decimal_comma else word.strip() for word in words]
        if words and not _CELL.match(words[0]):
            words = words[1:]
        if words and words[-1] == "":
            words = words[:-1]
        cells = [_CELL.match(word) for word in words]
        return [float(cell[1] or "nan") for cell in cells if cell] if all(cells) else []

    def learn(self, lines: list[str], header: list[str], columns: Sequence[str], unit: str) -> str:
        """Learn columns and unit; returns a question to the user. Both are empty if the lines have no specific force, or are
        too few.

        **Arguments:**

        - `header`: words of a header line before the lines; empty for none. `columns`, `unit`: of the user; empty for none.
        """
        rows = [row for line in lines if (row := self.numbers(line))]
        widths = [len(row) for row in rows]
        width = max(set(widths), key=widths.count, default=0)
        # A leading word was removed from the rows.
        named = [_role_of(word) for word in (header[1:] if len(header) == width + 1 else header)]
        columns = columns or [role for role, _ in named]
        table = np.array([row for row in rows if len(row) == width and np.isfinite(row).all()])
        if not len(table) or width < 3:
            return ""
        if len(columns) == width and {*FORCE} <= {*columns}:
            units = [unit, *(of.replace("ms2", "m/s2") for role, of in named if role in FORCE)]
            units.append(_unit_by_length(table[:, [columns.index(role) for role in FORCE]]))
            self.unit = next((unit for unit in units if unit in UNITS_PER_G), "")
            if not self.unit:
                return f"the unit of the specific force is not known: give --unit ({', '.join(UNITS_PER_G)})"
            self.columns = tuple(columns)
            return ""
        steps = np.diff(table, axis=0)
        rising = np.logical_and.reduce(steps > 0)
        for first in range(width - 2) if len(table) >= _FEWEST_LINES else ():
            # A column that only rises is a time or a counter.
            by_length = unit or _unit_by_length(table[:, first : first + 3])
            if by_length and not rising[first : first + 3].any():
                names = np.where((steps == 1).all(axis=0), "counter", np.where(rising, "time", "-")).tolist()
                triads = FORCE + RATE if first + 6 <= width else FORCE
                names[first : first + len(triads)] = triads
                return (
                    f"lines of {width} numbers without names: give --columns {','.join(names)} --unit '{by_length}' "
                    "(proposed from the values, check them), or port.columns and port.unit in the plan of a capture"
                )
        return ""


def _role_of(word: str) -> tuple[str, str]:
    """Quantity and unit of a name; "-" for an unknown one, and for accelerations without gravity."""
    role, unit = role_of(word)
    role = _NAMES.get(re.sub(r"[\[(].*", "", word).strip().lower(), _NAMES.get(role, role))
    return (role, unit) if role in _ROLES and parsed(word).state not in ("linear", "world", "free") else ("-", "")


@np.errstate(over="ignore", invalid="ignore")
def _unit_by_length(force: Floats) -> str:
    """The unit in which the usual length of the specific force (n, 3) is one g, within a tenth; "" for none."""
    length = float(np.median(np.linalg.norm(force, axis=1)))
    return next((unit for unit, per_g in UNITS_PER_G.items() if abs(length / per_g - 1) < 0.1), "")


def _looks_numeric(text: str) -> bool:
    """Whether a line has the numbers of a specific force."""
    return len(re.findall(r"[+-]?\d+(?:\.\d*)?", text)) >= 3 and len(re.findall(r"[A-Za-z]{2,}", text)) <= 1


def _header_words(text: str) -> list[str]:
    """The names in a header line; empty for a line without the three specific forces."""
    if not re.search(r"[A-Za-z]", text) or 3 * text.count("\ufffd") > len(text) or _looks_numeric(text):
        return []
    separator = separator_of([text])
    words = text.split() if separator == " " else [word.strip() for word in text.split(separator)]
    words = words[words[0].upper() == "LABEL" :]
    return words if {*FORCE} <= {_role_of(word)[0] for word in words} else []


class TextDecoder:
    """Decodes lines to samples.

    **Arguments:**

    - `settings`: `columns` and `unit`, which header lines do not change; empty: those of a header line. Unless the stream is
      `whole`, the first line is dropped, since a port opens within a line.

    **Raises:** `InputError` for an unknown quantity or unit, or an incomplete specific force.
    """

    def __init__(self, settings: Settings = UNKNOWN):
        self._given = tuple(settings.columns.replace(" ", "").split(",")) if settings.columns else ()
        self._unit, self._drop_first = settings.unit, not settings.whole
        if self._given and not {*FORCE} <= {*self._given} <= {*_ROLES, "-"}:
            raise InputError(
                f"text columns {settings.columns}: give ax, ay and az, and {', '.join(_ROLES[3:])}, or - for an unused column"
            )
        if self._unit and self._unit not in UNITS_PER_G:
            raise InputError(f"text unit {self._unit!r}: unknown; give one of {', '.join(UNITS_PER_G)}")
        self._layout: _Layout | None = None
        self._tail, self._offset, self._header = b"", 0, list[str]()
        self._checks_seen, self._rejecting = 0, False
        # Lines of a layout that is not known yet, with their ends and sizes, and the reasons reported so far.
        self._waiting, self._reported = list[tuple[int, int, str]](), set[str]()
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
                self._line(line.rstrip(b"\r"))
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

    def _line(self, line: bytes) -> None:
        """Check a line, and store it until the layout is known."""
        body, star, check = line.rpartition(b"*")
        has_check = bool(star and re.fullmatch(rb"[0-9A-Fa-f]{2}", check))
        intact = has_check and int(check, 16) == exclusive_or(body.removeprefix(b"$"))
        required = self._checks_seen >= _CHECKED_LINES or (self._layout is not None and self._layout.checked)
        line = body if intact else line
        text = line.decode("ascii", "replace").strip()
        self._checks_seen += intact
        self._rejecting &= not intact
        header = _header_words(text)
        if not intact and (has_check or (required and not header)):
            self._counts.check_failures += 1
            self._discard(len(line))
            return
        if header and header != self._header:
            named = [_role_of(word)[0] for word in header]
            if not self._given:
                # It begins a new layout.
                if any(_looks_numeric(text) for *_, text in self._waiting):
                    self._read(ended=True)
                self._layout = None
            self._header = header
            if any(name not in ("-", role) for name, role in zip(named, self._given, strict=False)):
                used = ",".join(self._given)
                self._refuse(self._offset, f"a header line names the columns {','.join(named)}; used as given: {used}")
        self._waiting.append((self._offset, len(line), text))

    def _refuse(self, stop: int, text: str) -> None:
        if (reason := text.partition(":")[0]) not in self._reported:
            self._reported.add(reason)
            self._events.append(Event(stop, "refused", {"text": text}))

    def _read(self, ended: bool = False) -> None:
        """Read the stored lines if their layout is known, or can be learned; discard them if their stretch has `ended`."""
        waiting, question = self._waiting, ""
        if self._layout is None:
            numeric = [text for *_, text in waiting if _looks_numeric(text)]
            layout, imu = _Layout(numeric), 2 * sum(text.startswith("$IMU,") for text in numeric) > len(numeric)
            question = layout.learn(numeric, self._header or (_IMU if imu else []), self._given, self._unit)
            if not (layout.columns or question or ended or len(waiting) >= _GIVE_UP_LINES):
                return
            if layout.columns:
                layout.checked = self._checks_seen >= _CHECKED_LINES
                self._layout = layout
                self._events.append(Event(waiting[0][0], "layout", vars(layout) | {"unprotected": not layout.checked}))
            elif numeric:
                words = f"no specific force was found in {len(numeric)} lines of numbers: left out"
                self._refuse(waiting[-1][0], question or words)
        self._waiting = []
        for stop, size, text in waiting:
            numbers = self._layout.numbers(text) if self._layout else []
            if self._layout and len(numbers) == len(self._layout.columns):
                self._rejecting = False
                row = dict(zip(self._layout.columns, numbers, strict=True))
                force = [row[role] / UNITS_PER_G[self._layout.unit] for role in FORCE]
                counter = row.get("counter", -1.0)
                counter = int(counter) if abs(counter) < 2.0**62 else -1
                rate = [row.get(role, np.nan) for role in RATE]
                self._rows.append((stop, force, rate, row.get("t", np.nan), counter, 0, row.get("time", np.nan)))
            elif question and _looks_numeric(text):
                self._counts.special += 1
            elif not (self._layout or question):
                self._counts.discarded += size + 1
            elif re.search(r"[A-Za-z]", text) and not re.search(r"\b(nan|inf|ovf)\b", text, re.IGNORECASE):
                # No sample: text of the device.
                self._counts.special += 1
                self._events.append(Event(stop, "reply", {"text": text[:200]}))
            else:
                self._discard(size)

    def _discard(self, size: int) -> None:
        self._counts.discarded += size + 1
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
    decoder=TextDecoder,
    encode=encode,
    bauds=(115200, 9600, 57600, 230400, 921600),
    counter=DeviceCounter(modulus=2**32, ticks_per_s=None),
    checked=False,
    columns=True,
)
