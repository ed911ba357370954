"""PX4 ULog, by pyulog: a table for each topic."""

from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.recordings.table import Reader, SourceTable, library, of_arrays
from tumblecal.capture.recordings.ulog_messages import message_fault
from tumblecal.ground.counted import counted
from tumblecal.ground.decoding import decoding, silenced


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


def _read(path: Path, options: RecordingOptions, damage: Damage) -> list[SourceTable]:
    pyulog: Any = library("pyulog", path)
    with decoding(path, "ULog"), silenced():
        log = pyulog.ULog(str(path))
        if fault := message_fault(path):
            damage.report(fault)
        elif log.file_corruption:
            damage.report("messages that do not fit their formats were left out; messages next to them may be wrong")
        if log.dropouts:
            lost_ms = sum(dropout.duration for dropout in log.dropouts)
            damage.report(f"the logger lost messages {counted(len(log.dropouts), 'time')}, {lost_ms} ms in all")
    comments = {"system": str(log.msg_info_dict.get("sys_name", ""))}
    tables = []
    for data in log.data_list:
        columns = {name: np.asarray(values) for name, values in data.data.items()}
        roles = {name: role for name, role in _ROLES.get(data.name, {}).items() if name in columns}
        time = next((name for name in _TIME if name in columns and np.any(columns[name])), None)
        roles |= {time: _TIME[time]} if time else {}
        name = data.name if not data.multi_id else f"{data.name}/{data.multi_id}"
        tables.append(of_arrays(name, columns, roles=roles, comments=comments))
    return tables


READER = Reader("PX4 ULog", lambda path, head: head.startswith(b"ULog\x01\x12\x35"), _read)
