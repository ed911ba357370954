"""ArduPilot DataFlash logs (.bin): a table for each message and instance of a sensor that has accelerations.

A message is 0xA3 0x95, its type (1 byte) and its fields; messages of type 0x80 (FMT) state the length, name, number formats and
fields of each type. https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
"""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError
from tumblecal.recordings.formats.already_corrected import ardupilot_correction
from tumblecal.recordings.table import Reader, Source, Table, of_arrays


_MARK, _FMT, _HEADER = b"\xa3\x95", 0x80, 3
_FMT_FIELDS = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("formats", "S16"), ("fields", "S64")])
_FORMATS = {
    "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8", "g": "<f2", "f": "<f4",
    "d": "<f8", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "M": "u1", "n": "S4", "N": "S16", "Z": "S64",
    "a": "V64",
}  # fmt: skip
# Formats of numbers times 100.
_HUNDREDTHS = "cCeE"
# SI units of the body's axes; T is the sensor's temperature, degC. Older logs have milliseconds.
ROLES = {"SampleUS": "time_us", "TimeUS": "time_us", "TimeMS": "time_ms", "T": "temperature_degc"}
ROLES |= {f"Acc{axis.upper()}": f"a{axis}_ms2" for axis in "xyz"} | {
    f"Gyr{axis.upper()}": f"g{axis}_rads" for axis in "xyz"
}
FORCE = frozenset(("AccX", "AccY", "AccZ"))
_TIMES = ("SampleUS", "TimeUS", "TimeMS")
_INSTANCE = "I"
_PARAMETER, _CORRECTION = "PARM", re.compile(rb"INS_TCAL(\d)_ENABLE\0*")


@dataclass(frozen=True)
class _Kind:
    """A type of message: its length in bytes including the header, its name, number formats and fields."""

    length: int
    name: str
    formats: str
    fields: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype:
        """The dtype of its fields."""
        return np.dtype([(name, _FORMATS[code]) for name, code in zip(self.fields, self.formats, strict=True)])

    @property
    def sound(self) -> bool:
        """Whether its formats are known and agree with its length."""
        known = len(self.fields) == len(self.formats) == len(set(self.fields)) and set(self.formats) <= set(_FORMATS)
        return known and self.dtype.itemsize == self.length - _HEADER


def _kind(content: bytes) -> tuple[int, _Kind]:
    stated = np.frombuffer(content, _FMT_FIELDS)[0]
    name, formats, fields = (
        bytes(stated[key]).decode("ascii", "replace").strip() for key in ("name", "formats", "fields")
    )
    return int(stated["type"]), _Kind(int(stated["length"]), name, formats, tuple(fields.split(",")))


def _scanned(log: bytes) -> tuple[dict[int, _Kind], dict[int, list[int]], int, int]:
    """The types, the places of their messages, the number of bytes outside messages, and the first of these bytes."""
    kinds = {
        _FMT: _Kind(_FMT_FIELDS.itemsize + _HEADER, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
    }
    places: dict[int, list[int]] = {}
    lengths = [0] * 256
    lengths[_FMT] = kinds[_FMT].length
    at, end, skipped, first = 0, len(log), 0, -1
    while at + _HEADER <= end:
        kind = log[at + 2]
        length = lengths[kind]
        if log[at] != _MARK[0] or log[at + 1] != _MARK[1] or not length or at + length > end:
            found = log.find(_MARK, at + 1)
            following = found if found >= 0 else end
            first = at if first < 0 else first
            skipped, at = skipped + following - at, following
            continue
        if kind == _FMT:
            number, stated = _kind(log[at + _HEADER : at + length])
            if stated.length >= _HEADER and number not in kinds:
                kinds[number] = stated
                lengths[number] = stated.length
        else:
            places.setdefault(kind, []).append(at)
        at += length
    return kinds, places, skipped + end - at, first if first >= 0 else at


def _read(source: Source) -> list[Table]:
    log = source.path.read_bytes()
    kinds, places, skipped, first = _scanned(log)
    enabled = _corrections(kinds, places, log)
    tables = [
        table
        for number, kind in kinds.items()
        if number in places and kind.sound and set(kind.fields) >= FORCE
        for table in _tables(kind, log, np.array(places[number]), enabled)
    ]
    if skipped:
        source.damage.report(
            f"{counted(skipped, 'byte')} outside messages, the first at byte {first}: messages there are lost"
        )
    if not tables:
        there = ", ".join(
            f"{kinds[number].name} ({len(starts)})" for number, starts in places.items() if number in kinds
        )
        raise InputError(
            f"{source.path}: no message has AccX, AccY, AccZ; it has {there or 'none'}. Set LOG_BITMASK to log IMU"
        )
    return tables


def _values(kind: _Kind, log: bytes, places: NDArray[np.int64]) -> np.ndarray:
    """The fields of some messages."""
    # A view of the fields at every byte, indexed only at the messages.
    anywhere = np.ndarray((len(log) - kind.length + 1,), kind.dtype, log, _HEADER, (1,))
    return anywhere[places]


def _corrections(kinds: dict[int, _Kind], places: dict[int, list[int]], log: bytes) -> set[int]:
    """The numbers n of `INS_TCALn_ENABLE` with the value 1."""
    parameters = [
        _values(kind, log, np.array(places[number]))
        for number, kind in kinds.items()
        if kind.name == _PARAMETER and number in places and kind.sound and {"Name", "Value"} <= {*kind.fields}
    ]
    return {
        int(match[1])
        for values in parameters
        for name, value in zip(values["Name"], values["Value"], strict=True)
        if value == 1 and (match := _CORRECTION.fullmatch(bytes(name)))
    }


def _tables(kind: _Kind, log: bytes, places: NDArray[np.int64], enabled: set[int]) -> list[Table]:
    """A table for each instance of a sensor, `IMU/1`; one table for older logs, with a name for each instance."""
    values = _values(kind, log, places)
    columns = {
        name: values[name] * 0.01 if code in _HUNDREDTHS else values[name].copy()
        for name, code in zip(kind.fields, kind.formats, strict=True)
        if name in (*ROLES, _INSTANCE) and np.issubdtype(values[name].dtype, np.number)
    }
    time = next((name for name in _TIMES if name in columns and columns[name].any()), None)
    roles = {name: role for name, role in ROLES.items() if name in columns and (name == time or name not in _TIMES)}
    if _INSTANCE not in columns:
        own = ardupilot_correction(enabled, int(kind.name[-1]) - 1 if kind.name[-1:].isdigit() else 0)
        return [of_arrays(kind.name, columns, roles=roles, row_word="message", stated=own)]
    instances = columns.pop(_INSTANCE)
    names = [(number, f"{kind.name}/{number}" if number else kind.name) for number in np.unique(instances).tolist()]
    return [
        of_arrays(
            name,
            {key: column[instances == number] for key, column in columns.items()},
            roles=roles,
            row_word="message",
            stated=ardupilot_correction(enabled, number),
        )
        for number, name in names
    ]


READER = Reader("ArduPilot DataFlash .bin", lambda path, head: head.startswith(_MARK + bytes([_FMT])), _read)
