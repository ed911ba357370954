"""ArduPilot DataFlash logs, binary or text: a table for each message and instance of a sensor that has accelerations.

A message is 0xA3 0x95, its type (1 byte) and its fields; messages of type 0x80 (FMT) state the length, name, number formats and
fields of each type; of text, lines FMT state them. https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
"""

import re
from dataclasses import dataclass, field

import numpy as np

from tumblecal.data.line_form import LineForm
from tumblecal.data.text_cells import pieces_of
from tumblecal.data.text_layout import TextLayout
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.text_file import shown
from tumblecal.recordings.formats.already_corrected import ardupilot_correction
from tumblecal.recordings.formats.text import text_table
from tumblecal.recordings.table import Reader, Source, Table, of_arrays


_MARK, _FMT, _HEADER = b"\xa3\x95", 0x80, 3
_STATED = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("formats", "S16"), ("fields", "S64")])
_FORMATS = dict(
    re.findall(
        r"(\w):(\S+)",
        "b:i1 B:u1 h:<i2 H:<u2 i:<i4 I:<u4 q:<i8 Q:<u8 g:<f2 f:<f4 d:<f8 c:<i2 C:<u2 e:<i4 E:<u4 L:<i4 M:u1 "
        "n:S4 N:S16 Z:S64 a:V64",
    )
)
# Formats of numbers times 100.
_HUNDREDTHS = "cCeE"
# SI units of the body's axes; T is the sensor's temperature, degC. Older logs have milliseconds.
TIMES = {"SampleUS": "time_us", "TimeUS": "time_us", "TimeMS": "time_ms"}
ROLES = TIMES | {"T": "temperature_degc"}
ROLES |= {f"Acc{axis.upper()}": f"a{axis}_ms2" for axis in "xyz"}
ROLES |= {f"Gyr{axis.upper()}": f"g{axis}_rads" for axis in "xyz"}
FORCE = frozenset(("AccX", "AccY", "AccZ"))
_TEXT_FORMAT = re.compile(rb"^FMT, *\d+, *\d+, *(\w+), *\w+, *([\w,]+)", re.MULTILINE)
# A parameter follows the time, which older logs do not have.
_TEXT_CORRECTION = re.compile(rb"^PARM,(?:[^,\n]*,)? *INS_TCAL(\d)_ENABLE, *1(?:\.0*)? *(?:[,\r\n]|$)", re.MULTILINE)
_INSTANCE, _CORRECTION = "I", re.compile(rb"INS_TCAL(\d)_ENABLE")


@dataclass
class _Kind:
    """A type of message: its length in bytes with the header, name, number formats, fields, and the places of its messages."""

    length: int
    name: str = "FMT"
    formats: str = ""
    fields: tuple[str, ...] = ()
    places: list[int] = field(default_factory=list)

    def values(self, log: bytes) -> np.ndarray:
        """The fields of its messages; none of them if its formats are unknown or do not agree with its length."""
        try:
            pairs = zip(self.fields, self.formats, strict=True)
            dtype = np.dtype([(name, _FORMATS[code]) for name, code in pairs])
        except (KeyError, ValueError):  # an unknown format; a field that occurs twice
            dtype = np.dtype([])
        if dtype.itemsize != self.length - _HEADER:
            return np.zeros(0, [])
        # A view of the fields at every byte, indexed only at the messages.
        anywhere = np.ndarray((max(0, len(log) - self.length + 1),), dtype, log, _HEADER, (1,))
        return anywhere[self.places]


def _scanned(log: bytes) -> tuple[list[_Kind], int, int]:
    """The types with their messages, the number of bytes outside messages, and the first of these bytes."""
    kinds = {_FMT: _Kind(_STATED.itemsize + _HEADER)}
    at, sound, skipped, first = 0, 0, 0, len(log)
    while (at := log.find(_MARK, at)) >= 0:
        kind = kinds.get(log[at + 2]) if at + 2 < len(log) else None
        if kind is None or at + kind.length > len(log):
            at += 1
            continue
        if at > sound:
            skipped, first = skipped + at - sound, min(first, sound)
        kind.places.append(at)
        if kind is kinds[_FMT]:
            number, length, *texts = np.frombuffer(log, _STATED, 1, at + _HEADER)[0].tolist()
            name, formats, fields = (text.decode("ascii", "replace").strip() for text in texts)
            if length >= _HEADER:
                kinds.setdefault(number, _Kind(length, name, formats, tuple(fields.split(","))))
        at = sound = at + kind.length
    first = min(first, sound)
    return [kind for kind in kinds.values() if kind.fields and kind.places], skipped + len(log) - sound, first


def _read(source: Source) -> list[Table]:
    with source.path.open("rb") as file:
        if file.read(len(_MARK)) != _MARK:
            return _read_text(source)
    log = source.path.read_bytes()
    kinds, skipped, first = _scanned(log)
    enabled = {
        int(match[1])
        for kind in kinds
        if kind.name == "PARM" and {"Name", "Value"} <= {*((values := kind.values(log)).dtype.names or ())}
        for name, value in values[["Name", "Value"]].tolist()
        if value == 1 and (match := _CORRECTION.fullmatch(name))
    }
    found = [(kind, kind.values(log)) for kind in kinds if {*kind.fields} >= FORCE]
    tables = [table for kind, values in found if values.dtype.names for table in _tables(kind, values, enabled)]
    if skipped:
        source.damage.report(
            f"{counted(skipped, 'byte')} outside messages, the first at byte {first}: messages there are lost"
        )
    if not tables:
        there = ", ".join(f"{kind.name} ({len(kind.places)})" for kind in sorted(kinds, key=lambda kind: kind.places))
        raise InputError(
            f"{source.path}: no message has AccX, AccY, AccZ; it has {there or 'none'}. Set LOG_BITMASK to log IMU"
        )
    return tables


def _tables(kind: _Kind, values: np.ndarray, enabled: set[int]) -> list[Table]:
    """A table for each instance of a sensor, `IMU/1`; one table for older logs, with a name for each instance."""
    hundredths = {name for name, code in zip(kind.fields, kind.formats, strict=False) if code in _HUNDREDTHS}
    columns = {
        name: values[name] * 0.01 if name in hundredths else values[name]
        for name in values.dtype.names or ()
        if name in (*ROLES, _INSTANCE) and np.issubdtype(values[name].dtype, np.number)
    }
    if not {*columns} >= FORCE:
        return []
    known = [name for name in TIMES if name in columns and columns[name].any()]
    roles = {name: role for name, role in ROLES.items() if name in columns and (name not in TIMES or name in known[:1])}
    instances = columns.pop(_INSTANCE, None)
    parts: list[tuple[str, int, np.ndarray | slice]] = [(kind.name, instance_of(kind.name), slice(None))]
    if instances is not None:
        numbers = np.unique(instances).tolist()
        parts = [(f"{kind.name}/{n}" if n else kind.name, n, instances == n) for n in numbers]
    return [
        of_arrays(
            name,
            {key: column[rows] for key, column in columns.items()},
            roles=roles,
            row_word="message",
            stated=ardupilot_correction(enabled, number),
        )
        for name, number, rows in parts
    ]


def instance_of(name: str) -> int:
    """The instance of the sensor of a message of older logs, from 0: IMU2 is 1."""
    return int(name[-1]) - 1 if name[-1:].isdigit() else 0


def _read_text(source: Source) -> list[Table]:
    fields, found, enabled = dict[bytes, list[bytes]](), dict[tuple[bytes, bytes], None](), set[int]()
    for piece in pieces_of(source.path):
        fields |= {name: names.split(b",") for name, names in _TEXT_FORMAT.findall(piece)}
        enabled |= {*map(int, _TEXT_CORRECTION.findall(piece))}
        for name in fields:
            if {*map(bytes.decode, fields[name])} >= FORCE:
                instances = {*re.findall(_message(name, fields[name], rb"(\d+)"), piece, re.MULTILINE)}
                found |= {(name, instance): None for instance in sorted(instances)}
    if not found:
        raise InputError(f"{source.path}: no accelerations among its messages {shown(b', '.join(fields).decode())}")
    return [_text_table(source, name, fields[name], instance, enabled) for name, instance in found]


def _message(name: bytes, fields: list[bytes], instance: bytes) -> bytes:
    """The pattern of a message to its instance; messages without one have the instance ""."""
    before = rb"(?:[^,\n]*,){%d} *%s," % (fields.index(b"I"), instance) if b"I" in fields else b"()"
    return b"^%s,%s" % (name, before)


def _text_table(source: Source, name: bytes, fields: list[bytes], instance: bytes, enabled: set[int]) -> Table:
    names, title = tuple(map(bytes.decode, fields)), name.decode()
    others = b"^(?!%s).*$" % _message(name, fields, instance)[1:]
    form = LineForm(re.compile(b"^%s, *" % name, re.MULTILINE), b"", names, re.compile(others, re.MULTILINE))
    layout = TextLayout(source.path, names, ",", None, 1, form)
    stated = ardupilot_correction(enabled, int(instance) if instance else instance_of(title))
    return text_table(source, layout, stated, f"{title}[{instance.decode()}]" if instance else title, ROLES)


def _recognised(path: object, head: bytes) -> bool:
    return head.startswith(_MARK + bytes([_FMT])) or bool(_TEXT_FORMAT.search(head[:8192]))


READER = Reader("ArduPilot DataFlash (.bin, .log)", _recognised, _read)
