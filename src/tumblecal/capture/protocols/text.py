"""Lines of numbers, as boards with a sketch print them: commas, tabs, semicolons or spaces; header line or none.

The layout is learned from the stream (or given) and shown: separator, leading word, number of columns, which columns
are specific force, rate, temperature, time and counter, and the unit, from the column names or from a triple whose
length is one g in some usual unit. A `*CC` check (exclusive or, NMEA-like) is verified where there is one and then
required. A stream without one is unprotected: a lost character makes a plausible wrong number.
"""

import re
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.checks import exclusive_or
from tumblecal.capture.protocols import DeviceCounter, Protocol
from tumblecal.capture.samples import Counts, Decoded, Event, Samples, Settings, blank
from tumblecal.errors import InputError
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


# How many of one unit make one standard g.
UNITS_PER_G: dict[str, float] = {
    "g": 1.0,
    "mg": 1000.0,
    "m/s2": STANDARD_GRAVITY_MS2,
    "LSB 2048/g": 2048.0,
    "LSB 4096/g": 4096.0,
    "LSB 8192/g": 8192.0,
    "LSB 16384/g": 16384.0,
    "LSB 256/g": 256.0,
}
_LEARN_LINES = 25
_LOCK_LINES = 5
_GIVE_UP_LINES = 400
_LONGEST_LINE = 1024
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
_NUMBER_COMMA = re.compile(r"[+-]?\d+,\d+$")
_ROLES = {
    "ax": r"^(acc?(el)?(eration)?[ _.]?x|a_?x|x_?acc?)$",
    "ay": r"^(acc?(el)?(eration)?[ _.]?y|a_?y|y_?acc?)$",
    "az": r"^(acc?(el)?(eration)?[ _.]?z|a_?z|z_?acc?)$",
    "gx": r"^(gyro?[ _.]?x|g_?x|w_?x|rate[ _.]?x)$",
    "gy": r"^(gyro?[ _.]?y|g_?y|w_?y|rate[ _.]?y)$",
    "gz": r"^(gyro?[ _.]?z|g_?z|w_?z|rate[ _.]?z)$",
    "t": r"^(t|temp|temperature|tmp)$",
    "counter": r"^(seq|n|count(er)?|index|packet|sample|no)$",
    "time": r"^(time|millis|micros|ms|us|timestamp|t_?ms|t_?us)$",
}


@dataclass(frozen=True)
class TextLayout:
    """How the lines are read.

    **Arguments:**

    - `columns`: role of each column: ax, ay, az, gx, gy, gz, t, counter, time, or "-" for one not used.
    - `unit`: unit of the specific force, a key of `UNITS_PER_G`.
    - `separator`: between numbers; " " means any white space.
    - `decimal_comma`: 1,5 for 1.5.
    - `checked`: lines end in `*CC`.
    """

    columns: tuple[str, ...]
    unit: str
    separator: str = ","
    decimal_comma: bool = False
    checked: bool = False

    def __post_init__(self) -> None:
        unknown = [c for c in self.columns if c not in _ROLES and c != "-"]
        missing = [c for c in ("ax", "ay", "az") if c not in self.columns]
        if unknown or missing:
            raise InputError(
                f"text columns {','.join(self.columns)}: "
                + (f"{', '.join(unknown)} not known" if unknown else f"{', '.join(missing)} missing")
                + f"; a list of {', '.join(_ROLES)} or - for a column not used"
            )
        if self.unit not in UNITS_PER_G:
            raise InputError(f"text unit {self.unit!r}: not known; one of {', '.join(UNITS_PER_G)}")


def split_line(text: str, separator: str, decimal_comma: bool) -> list[str]:
    """The words of a line, a leading name taken off."""
    words = text.split() if separator == " " else [w.strip() for w in text.split(separator)]
    if words and not _NUMBER.match(words[0]) and not _NUMBER_COMMA.match(words[0]):
        words = words[1:]
    if words and words[-1] == "":
        words = words[:-1]
    return [w.replace(",", ".") for w in words] if decimal_comma else words


def _separator_of(lines: list[str]) -> tuple[str, bool]:
    """The separator that gives the most numbers, and whether numbers have a decimal comma."""
    joined = "\n".join(lines)
    for separator in (";", "\t"):
        if separator in joined:
            words = [w.strip() for line in lines for w in line.split(separator)]
            return separator, sum(bool(_NUMBER_COMMA.match(w)) for w in words) > len(lines)
    if "," not in joined:
        return " ", False
    by_space = [w for line in lines for w in line.split()]
    commas = sum(bool(_NUMBER_COMMA.match(w)) for w in by_space)
    if commas > 2 * len(lines) and not re.search(r"\d\.\d", joined):
        return " ", True
    return ",", False


def _names(words: list[str]) -> list[str]:
    """Roles from a header line; "-" where a name says nothing."""
    roles = []
    for word in words:
        name = re.sub(r"[\[(].*", "", word).strip().lower()
        roles.append(next((r for r, pattern in _ROLES.items() if re.match(pattern, name)), "-"))
    return roles


def _unit_of_names(words: list[str]) -> str | None:
    for word in words:
        found = re.search(r"[\[(]\s*(g|mg|m/s\^?2|m/s2|ms-2)\s*[\])]", word)
        if found and re.match(r"a", word.strip().lower()):
            unit = found.group(1)
            return unit if unit in ("g", "mg") else "m/s2"
    return None


def _unit_of_length(length: float) -> str | None:
    """The unit in which this length of the specific force is one g, within a tenth."""
    return next((u for u, per_g in UNITS_PER_G.items() if abs(length / per_g - 1) < 0.1), None)


def learn(lines: list[str], header: list[str] | None = None, checked: bool = False) -> TextLayout | None:
    """The layout of these lines; None when no specific force can be found in them.

    **Arguments:**

    - `lines`: lines of numbers, without their check.
    - `header`: words of a header line seen before.
    """
    separator, decimal_comma = _separator_of(lines)
    rows = [split_line(line, separator, decimal_comma) for line in lines]
    width = max({len(r) for r in rows}, key=lambda n: sum(len(r) == n for r in rows))
    good = [r for r in rows if len(r) == width and all(_NUMBER.match(w) for w in r)]
    if len(good) < _LOCK_LINES or width < 3:
        return None
    table = np.array(good, float)
    roles = _names(header) if header and len(header) == width else ["-"] * width
    if not {"ax", "ay", "az"} <= set(roles):
        roles = _roles_of_values(table, roles)
    if not {"ax", "ay", "az"} <= set(roles):
        return None
    force = table[:, [roles.index(r) for r in ("ax", "ay", "az")]]
    unit = _unit_of_names(header) if header else None
    unit = unit or _unit_of_length(float(np.median(np.linalg.norm(force, axis=1))))
    if unit is None:
        return None
    return TextLayout(tuple(roles), unit, separator, decimal_comma, checked)


def _roles_of_values(table: NDArray[np.float64], roles: list[str]) -> list[str]:
    """Roles from the numbers alone: the first triple of one g is the force, a triple behind it the rate."""
    roles = list(roles)
    width = table.shape[1]
    for first in range(width - 2):
        length = float(np.median(np.linalg.norm(table[:, first : first + 3], axis=1)))
        moving = np.diff(table[:, first : first + 3], axis=0)
        if _unit_of_length(length) and not ((moving > 0).all(0) & (np.ptp(moving, axis=0) == 0)).any():
            roles[first : first + 3] = ["ax", "ay", "az"]
            if first + 6 <= width:
                roles[first + 3 : first + 6] = ["gx", "gy", "gz"]
            break
    for at in range(width):
        step = np.diff(table[:, at])
        if roles[at] == "-" and (step > 0).all():
            roles[at] = "counter" if (step == 1).all() and "counter" not in roles else "time"
    if roles[-1] == "-" and -40 < float(np.median(table[:, -1])) < 125 and "az" in roles:
        roles[-1] = "t"
    return roles


class TextDecoder:
    """Lines in, samples out.

    **Arguments:**

    - `layout`: how to read them; learned from the first lines when None.
    - `whole`: the first line is complete (a file); otherwise it is dropped, as a port opens anywhere.
    """

    def __init__(self, layout: TextLayout | None = None, whole: bool = False):
        self.layout = layout
        self._tail = b""
        self._offset = 0
        self._drop_first = not whole
        self._header: list[str] | None = None
        self._waiting: list[tuple[int, bytes]] = []
        self._checks_seen = 0
        self._told = layout is None
        self._rejecting = False

    def feed(self, data: bytes) -> Decoded:
        """Decode the lines that `data` completes."""
        text = self._tail + data
        *lines, self._tail = text.split(b"\n")
        numbered, place = [], self._offset
        for line in lines:
            place += len(line) + 1
            numbered.append((place, line))
        self._offset = place
        counts = Counts()
        if len(self._tail) > _LONGEST_LINE:
            counts.discarded += len(self._tail)
            self._offset += len(self._tail)
            self._tail, self._drop_first = b"", True
        if self._drop_first and numbered:
            counts.discarded += len(numbered[0][1]) + 1
            numbered = numbered[1:]
            self._drop_first = False
        return self._lines(numbered, counts, final=False)

    def finish(self) -> Decoded:
        """Learn from what there is if nothing was learned yet; a last line without end is discarded."""
        counts = Counts(discarded=len(self._tail))
        self._tail = b""
        return self._lines([], counts, final=True)

    def _lines(self, numbered: list[tuple[int, bytes]], counts: Counts, final: bool) -> Decoded:
        kept = [(stop, text) for stop, line in numbered if (text := self._checked(line, counts)) is not None]
        events: list[Event] = []
        if self.layout is None:
            self._waiting += kept
            ready = sum(_looks_numeric(t) for _, t in self._waiting) >= _LEARN_LINES
            if not ready and not final and len(self._waiting) < _GIVE_UP_LINES:
                return Decoded(blank(0), [], counts)
            self._learn()
            if self.layout is None and not final and len(self._waiting) < _GIVE_UP_LINES:
                return Decoded(blank(0), [], counts)
            if self.layout is None:
                counts.discarded += sum(len(t) + 1 for _, t in self._waiting)
                self._waiting = []
                return Decoded(blank(0), [], counts)
            kept, self._waiting = self._waiting, []
            content = asdict(self.layout) | {"unprotected": not self.layout.checked}
            events.append(Event(kept[0][0] if kept else self._offset, "layout", content))
        samples = self._samples(kept, counts, events)
        return Decoded(samples, events, counts)

    def _checked(self, line: bytes, counts: Counts) -> bytes | None:
        """The line without its check; None when it is wrong, or missing where lines have one."""
        line = line.rstrip(b"\r")
        body, star, check = line.rpartition(b"*")
        if star and re.fullmatch(rb"[0-9A-Fa-f]{2}", check):
            if int(check, 16) == exclusive_or(body.removeprefix(b"$")):
                self._checks_seen += 1
                self._rejecting = False
                return body
        elif self._checks_seen < 3 and not (self.layout and self.layout.checked):
            return line
        counts.check_failures += 1
        counts.discarded += len(line) + 1
        counts.resyncs += not self._rejecting
        self._rejecting = True
        return None

    def _learn(self) -> None:
        texts = [t.decode("ascii", "replace").strip() for _, t in self._waiting]
        for text in texts:
            if not _looks_numeric(text.encode("ascii", "replace")) and re.search(r"[A-Za-z]", text):
                separator, _ = _separator_of([text])
                words = text.split() if separator == " " else [w.strip() for w in text.split(separator)]
                words = words[1:] if words and words[0].upper() == "LABEL" else words
                if {"ax", "ay", "az"} <= set(_names(words)):
                    self._header = words
        numeric = [t for t in texts if _looks_numeric(t.encode("ascii", "replace"))]
        if len(numeric) >= _LOCK_LINES:
            self.layout = learn(numeric, self._header, checked=self._checks_seen >= 3)

    def _samples(self, lines: list[tuple[int, bytes]], counts: Counts, events: list[Event]) -> Samples:
        layout = self.layout
        assert layout is not None
        width = len(layout.columns)
        rows, stops = [], []
        for stop, raw in lines:
            row = _row(raw, layout, width)
            if row is None:
                self._reject(stop, raw, counts, events)
                continue
            self._rejecting = False
            rows.append(row)
            stops.append(stop)
        samples = blank(len(rows))
        if not rows:
            return samples
        counts.frames += len(rows)
        table = np.array(rows)
        places = {role: at for at, role in enumerate(layout.columns)}
        samples.stop[:] = stops
        samples.force[:] = table[:, [places["ax"], places["ay"], places["az"]]] / UNITS_PER_G[layout.unit]
        if {"gx", "gy", "gz"} <= set(places):
            samples.rate[:] = table[:, [places["gx"], places["gy"], places["gz"]]]
        if "t" in places:
            samples.temperature[:] = table[:, places["t"]]
        if "counter" in places:
            samples.counter[:] = table[:, places["counter"]].astype(np.int64)
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


def _looks_numeric(raw: bytes) -> bool:
    text = raw.decode("ascii", "replace")
    numbers = re.findall(r"[+-]?\d+(?:\.\d*)?", text)
    letters = re.findall(r"[A-Za-z]{2,}", text)
    return len(numbers) >= 3 and len(letters) <= 1


def _row(raw: bytes, layout: TextLayout, width: int) -> list[float] | None:
    try:
        text = raw.decode("ascii")
    except UnicodeDecodeError:
        return None
    words = split_line(text, layout.separator, layout.decimal_comma)
    if len(words) != width or not all(map(_NUMBER.match, words)):
        return None
    return [float(w) for w in words]


def encode(samples: Samples, settings: Settings) -> bytes:
    """Lines `$IMU,seq,micros,ax,ay,az,gx,gy,gz,T*CC` with m/s^2 and deg/s: the sketch line that can be trusted."""
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
    layout = TextLayout(tuple(columns.replace(" ", "").split(",")), unit or "g") if columns else None
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
    notes="without a *CC check a lost character makes a plausible wrong number; opening the port resets many boards",
)
