"""ArduPilot DataFlash logs, binary or text: a table for each message and instance of a sensor that has accelerations.

A message is 0xA3 0x95, its type (1 byte) and its fields; messages of type 0x80 (FMT) state the length, name, number formats and
fields of each type; of text, lines FMT state them. https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.data.text_layout import ROW
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.recordings.formats.already_corrected import ardupilot_correction
from tumblecal.recordings.formats.arrays import of_frame
from tumblecal.recordings.table import Reader, Source, Table


_MARK, _FMT, _HEADER = b"\xa3\x95", 0x80, 3
_STATED = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("formats", "S16"), ("fields", "S64")])
_FORMATS = dict(
    re.findall(
        r"(\w):(\S+)",
        "b:i1 B:u1 h:<i2 H:<u2 i:<i4 I:<u4 q:<i8 Q:<u8 g:<f2 f:<f4 d:<f8 c:<i2 C:<u2 e:<i4 E:<u4 L:<i4 M:u1 "
        "n:S4 N:S16 Z:S64 a:V64",
    )
)
# SI units of the body's axes; T is the sensor's temperature, degC. Older logs have milliseconds.
_TIMES = {"SampleUS": "time_us", "TimeUS": "time_us", "TimeMS": "time_ms"}
_FORCE = {f"Acc{axis.upper()}": f"a{axis}_ms2" for axis in "xyz"}
_ROLES = {"T": "temperature_degc"} | _FORCE | {f"Gyr{axis.upper()}": f"g{axis}_rads" for axis in "xyz"}
_TEXT_FORMAT = re.compile(rb"^FMT, *\d+, *\d+, *\w+, *\w+, *[\w,]+", re.MULTILINE)
_INSTANCE, _PARAMETER, _CORRECTION = "I", ("Name", "Value"), re.compile(r"INS_TCAL(\d)_ENABLE")
_FIELDS = {*_TIMES, *_ROLES, *_PARAMETER, _INSTANCE}

# The name of a type of message and its rows, with the column `ROW`.
Messages = Iterator[tuple[str, pl.DataFrame]]


def _read(source: Source) -> list[Table]:
    """The tables of a log.

    **Raises:** `InputError` without accelerations.
    """
    with source.path.open("rb") as file:
        binary = file.read(len(_MARK)) == _MARK
    messages = list(_of_bytes(source) if binary else _of_text(source.path))
    enabled = {
        int(match[1])
        for _, frame in messages
        if {*_PARAMETER} <= {*frame.columns}
        for name, value in frame.select(pl.col("Name").cast(pl.String), pl.col("Value").cast(float)).iter_rows()
        if value == 1 and (match := _CORRECTION.fullmatch(name))
    }
    found = [(name, frame) for name, frame in messages if {*_FORCE} <= {*frame.columns} and len(frame)]
    if not found:
        there = ", ".join(name for name, _ in messages) or "none"
        raise InputError(f"{source.path}: no message has AccX, AccY, AccZ; it has {there}. Set LOG_BITMASK to log IMU")
    return [table for name, frame in found for table in _tables(name, frame, enabled, "message" if binary else "line")]


def _tables(name: str, frame: pl.DataFrame, enabled: set[int], row_word: str) -> Iterator[Table]:
    """A table for each instance of a sensor, `IMU/1`; one table for older logs, with a name for each instance."""
    times = [one for one in _TIMES if one in frame.columns and (frame[one] != 0).any()][:1]
    roles = {one: role for one, role in (_TIMES | _ROLES).items() if one in (*times, *_ROLES) and one in frame.columns}
    # The instance of a message of older logs: IMU2 is 1.
    parts = {int(name[-1]) - 1 if name[-1:].isdigit() else 0: frame}
    if _INSTANCE in frame.columns:
        numbers = frame.drop_nulls(_INSTANCE).partition_by(_INSTANCE, as_dict=True)
        parts = {int(key): numbers[key,] for (key,) in sorted(numbers)}
    for number, rows in parts.items():
        title = f"{name}/{number}" if number and _INSTANCE in frame.columns else name
        stated = ardupilot_correction(enabled, number)
        yield of_frame(title, rows.select(*roles, ROW), roles=roles, row_word=row_word, stated=stated)


def _of_bytes(source: Source) -> Messages:
    """The messages of a binary log; bytes outside messages are reported. Types whose formats are unknown, or do not agree with
    their length, are left out."""
    log = source.path.read_bytes()
    # Length with the header, name, formats, fields; and the places of the messages.
    kinds: dict[int, tuple[int, str, str, str]] = {_FMT: (_STATED.itemsize + _HEADER, "FMT", "", "")}
    places, at, sound, skipped, first = dict[int, list[int]](), 0, 0, 0, len(log)
    while (at := log.find(_MARK, at)) >= 0:
        number = log[at + 2] if at + 2 < len(log) else -1
        if number not in kinds or at + kinds[number][0] > len(log):
            at += 1
            continue
        if at > sound:
            skipped, first = skipped + at - sound, min(first, sound)
        if number == _FMT:
            stated, length, *texts = np.frombuffer(log, _STATED, 1, at + _HEADER)[0].tolist()
            name, formats, fields = (text.decode("ascii", "replace").strip() for text in texts)
            if length >= _HEADER:
                kinds.setdefault(stated, (length, name, formats, fields))
        places.setdefault(number, []).append(at)
        at = sound = at + kinds[number][0]
    if skipped := skipped + len(log) - sound:
        source.damage.report(
            f"{counted(skipped, 'byte')} outside messages, the first at byte {min(first, sound)}: messages there are lost"
        )
    for number, at_bytes in places.items():
        length, name, formats, fields = kinds[number]
        try:
            dtype = np.dtype([(one, _FORMATS[code]) for one, code in zip(fields.split(","), formats, strict=True)])
        except (KeyError, ValueError):  # an unknown format; a field that occurs twice
            continue
        if dtype.itemsize == length - _HEADER:
            # A view of the fields at every byte, indexed only at the messages.
            anywhere = np.ndarray((max(0, len(log) - length + 1),), dtype, log, _HEADER, (1,))[at_bytes]
            columns = {one: anywhere[one] for one in dtype.names or () if one in _FIELDS}
            yield name, pl.DataFrame(columns | {ROW: np.arange(1, len(anywhere) + 1)})


def _of_text(path: Path) -> Messages:
    """The messages of a text."""
    lines = pl.scan_csv(
        path,
        has_header=False,
        separator="\x1e",
        quote_char=None,
        schema={"line": pl.String},
        encoding="utf8-lossy",
        truncate_ragged_lines=True,
        row_index_name=ROW,
        row_index_offset=1,
    ).with_columns(pl.col("line").str.split(",").list.eval(pl.element().str.strip_chars()))
    kind = pl.col("line").list.first()
    for _, _, _, name, _, *fields in lines.filter(kind == "FMT").collect()["line"]:
        frame = pl.DataFrame()
        if {*_FORCE} <= {*fields} or {*_PARAMETER} <= {*fields}:
            cells = {
                field: pl.col("line")
                .list.get(k, null_on_oob=True)
                .cast(pl.String if field == "Name" else float, strict=False)
                for k, field in enumerate(fields, start=1)
                if field in _FIELDS
            }
            frame = lines.filter(kind == name).select(ROW, **cells).collect(engine="streaming")
        yield name, frame


def _recognised(path: object, head: bytes) -> bool:
    return head.startswith(_MARK + bytes([_FMT])) or bool(_TEXT_FORMAT.search(head[:8192]))


READER = Reader("ArduPilot DataFlash (.bin, .log)", _recognised, _read)
