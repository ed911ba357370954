"""PX4 ULog, by pyulog: a table for each topic."""

import struct
from typing import Any

import numpy as np

from tumblecal.ground.decoding import decoding, silenced
from tumblecal.ground.numbers_shown import counted
from tumblecal.recordings.formats.already_corrected import PX4_CORRECTED_TOPICS, px4_correction
from tumblecal.recordings.table import Reader, Source, Table, library, of_arrays


_HEADER_SIZE = 16
_MESSAGE = struct.Struct("<HB")
_TYPES = frozenset(b"BFIMPQARDLCSO")
_TIMES = ("timestamp_sample", "timestamp")
# https://docs.px4.io/main/en/msg_docs/: the fields of these topics are SI units of the body's axes.
_ROLES = {
    "sensor_combined": {f"accelerometer_m_s2[{k}]": f"a{axis}_ms2" for k, axis in enumerate("xyz")}
    | {f"gyro_rad[{k}]": f"g{axis}_rads" for k, axis in enumerate("xyz")},
    "sensor_accel": {axis: f"a{axis}_ms2" for axis in "xyz"} | {"temperature": "temperature"},
    "sensor_gyro": {axis: f"g{axis}_rads" for axis in "xyz"} | {"temperature": "temperature"},
}


def _fault(log: bytes) -> str:
    """The first fault in the sequence of messages, in words; "" if there is none."""
    at = _HEADER_SIZE
    while at + _MESSAGE.size <= len(log):
        size, kind = _MESSAGE.unpack_from(log, at)
        if kind not in _TYPES or (kind != ord("S") and not size):
            return f"byte {at} is not the start of a message: data after it may be lost or wrong"
        if at + _MESSAGE.size + size > len(log):
            break
        at += _MESSAGE.size + size
    end = f"the file ends within a message (byte {at} of {len(log)}): data after it are missing"
    return end if at < len(log) else ""


def _read(source: Source) -> list[Table]:
    pyulog: Any = library("pyulog", source.path)
    with decoding(source.path, "ULog"), silenced():
        log = pyulog.ULog(str(source.path))
        fault = _fault(source.path.read_bytes())
        selections = [data.data.get("accel_device_id", ()) for data in log.data_list if data.name == "sensor_selection"]
        selected = {int(number) for numbers in selections for number in numbers if number}
        corrected = px4_correction(log.initial_parameters, selected, [data.name for data in log.data_list])
    if not fault and log.file_corruption:
        fault = "messages that do not fit their formats were left out; messages next to them may be wrong"
    if fault:
        source.damage.report(fault)
    if log.dropouts:
        lost_ms = sum(dropout.duration for dropout in log.dropouts)
        source.damage.report(f"the logger lost messages {counted(len(log.dropouts), 'time')}, {lost_ms} ms in all")
    tables = []
    for data in log.data_list:
        columns = {name: np.asarray(values) for name, values in data.data.items()}
        times = [name for name in _TIMES if name in columns and columns[name].any()]
        roles = _ROLES.get(data.name, {}) | dict.fromkeys(times[:1], "time_us")
        stated = {"system": str(log.msg_info_dict.get("sys_name", ""))}
        tables.append(
            of_arrays(
                f"{data.name}/{data.multi_id}" if data.multi_id else data.name,
                columns,
                roles={name: role for name, role in roles.items() if name in columns},
                stated=stated | (corrected if data.name in PX4_CORRECTED_TOPICS else {}),
            )
        )
    return tables


READER = Reader("PX4 ULog", lambda path, head: head.startswith(b"ULog\x01\x12\x35"), _read)
