"""PX4 ULog, by pyulog: a table for each topic."""

import mmap
import struct
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.ground.counted import counted
from tumblecal.ground.decoding import decoding, silenced
from tumblecal.recordings.formats.already_corrected import PX4_CORRECTED_TOPICS, px4_correction
from tumblecal.recordings.table import Reader, Source, Table, library, of_arrays


_HEADER_SIZE = 16
_MESSAGE = struct.Struct("<HB")
_TYPES = frozenset(b"BFIMPQARDLCSO")
# Flag bits: eight bytes of compatible flags, eight of others, three places where a later writer appended data.
_FLAGS = struct.Struct("<8xB7x3Q")
_APPENDED = 1


def message_fault(path: Path) -> str:
    """The first fault in the sequence of messages, in words; "" if there is none."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as log:
        at = start = _HEADER_SIZE
        for stop in (*_appended(log), len(log)):
            at, size = start, 0
            while at + _MESSAGE.size <= stop:
                size, kind = _MESSAGE.unpack_from(log, at)
                if kind not in _TYPES or (kind != ord("S") and not size):
                    return f"byte {at} is not the start of a message: data after it may be lost or wrong"
                if at + _MESSAGE.size + size > stop:
                    break
                at += _MESSAGE.size + size
            start = stop
        # Data may be appended after a crash within a message: only the end of the file shows a truncation.
        if at < len(log):
            return f"the file ends within a message (byte {at} of {len(log)}): data after it are missing"
    return ""


def _appended(log: mmap.mmap) -> list[int]:
    """The places where a later writer appended data."""
    if len(log) < _HEADER_SIZE + _MESSAGE.size + _FLAGS.size:
        return []
    size, kind = _MESSAGE.unpack_from(log, _HEADER_SIZE)
    flags, *places = _FLAGS.unpack_from(log, _HEADER_SIZE + _MESSAGE.size)
    if kind != ord("B") or size < _FLAGS.size or not flags & _APPENDED:
        return []
    return [place for place in places if _HEADER_SIZE < place < len(log)]


_TIME = {"timestamp_sample": "time_us", "timestamp": "time_us"}
# https://docs.px4.io/main/en/msg_docs/: the fields of these topics are SI units of the body's axes.
_ACCELEROMETER = {"x": "ax_ms2", "y": "ay_ms2", "z": "az_ms2", "temperature": "temperature"}
_GYRO = {"x": "gx_rads", "y": "gy_rads", "z": "gz_rads", "temperature": "temperature"}
_ROLES = {
    "sensor_combined": {f"accelerometer_m_s2[{k}]": f"a{axis}_ms2" for k, axis in enumerate("xyz")}
    | {f"gyro_rad[{k}]": f"g{axis}_rads" for k, axis in enumerate("xyz")},
    "sensor_accel": _ACCELEROMETER,
    "sensor_gyro": _GYRO,
}


def _read(source: Source) -> list[Table]:
    pyulog: Any = library("pyulog", source.path)
    with decoding(source.path, "ULog"), silenced():
        log = pyulog.ULog(str(source.path))
        if fault := message_fault(source.path):
            source.damage.report(fault)
        elif log.file_corruption:
            source.damage.report(
                "messages that do not fit their formats were left out; messages next to them may be wrong"
            )
        if log.dropouts:
            lost_ms = sum(dropout.duration for dropout in log.dropouts)
            source.damage.report(f"the logger lost messages {counted(len(log.dropouts), 'time')}, {lost_ms} ms in all")
    comments = {"system": str(log.msg_info_dict.get("sys_name", ""))}
    corrected = px4_correction(log.initial_parameters, _selected(log), [data.name for data in log.data_list])
    tables = []
    for data in log.data_list:
        columns = {name: np.asarray(values) for name, values in data.data.items()}
        roles = {name: role for name, role in _ROLES.get(data.name, {}).items() if name in columns}
        time = next((name for name in _TIME if name in columns and np.any(columns[name])), None)
        roles |= {time: _TIME[time]} if time else {}
        name = data.name if not data.multi_id else f"{data.name}/{data.multi_id}"
        stated = comments | (corrected if data.name in PX4_CORRECTED_TOPICS else {})
        tables.append(of_arrays(name, columns, roles=roles, stated=stated))
    return tables


def _selected(log: Any) -> set[int]:
    """The device ids of the selected accelerometers; none if the log does not state them."""
    selections = [data.data.get("accel_device_id", ()) for data in log.data_list if data.name == "sensor_selection"]
    return {int(number) for numbers in selections for number in numbers if number}


READER = Reader("PX4 ULog", lambda path, head: head.startswith(b"ULog\x01\x12\x35"), _read)
