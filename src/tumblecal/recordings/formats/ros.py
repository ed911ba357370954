"""ROS 1 and ROS 2 bags and MCAP files, by rosbags: a table for each topic with accelerations."""

import contextlib
import sqlite3
import struct
import zlib
from collections.abc import Iterator, Sequence
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from tumblecal.data.parquet import PIECE_ROWS
from tumblecal.ground.decoding import decoding
from tumblecal.recordings.table import Reader, Source, Table, library


_ROS1, _MCAP, _SQLITE = b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"SQLite format 3\x00"
# https://mcap.dev/spec: opcode, length; of the footer the starts of the summary and of its offsets, and the CRC-32.
_FOOTER, _DATA_END = struct.Struct("<BQQQI"), struct.Struct("<BQI")
_FOOTER_CODE, _DATA_END_CODE, _CRC_SIZE = 0x02, 0x0F, 4
_ADVICE = "copy it again, or repair it: rosbag reindex, ros2 bag reindex, mcap recover"
_IMU, _TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"
_FORCE, _RATE = "linear_acceleration", "angular_velocity"
# Types with a vector of acceleration, m/s^2, and its place (REP 103: SI units).
_PLACES = {_IMU: _FORCE, "geometry_msgs/msg/AccelStamped": "accel.linear", "geometry_msgs/msg/Vector3Stamped": "vector"}
_ROLES = {"time": "time_s", "temperature": "temperature_degc"}
_ROLES |= {
    f"{name}.{axis}": f"{letter}{axis}_{unit}"
    for name, letter, unit in ((_FORCE, "a", "ms2"), (_RATE, "g", "rads"))
    for axis in "xyz"
}


def _check(path: Path) -> None:
    """Check a file of a bag.

    **Raises:** `ValueError` if it is damaged.
    """
    mapped: Any = np.memmap(path, np.uint8, "r")
    content = memoryview(mapped)
    if content[: len(_MCAP)] == _MCAP:
        _check_mcap(content)
    elif content[: len(_SQLITE)] == _SQLITE:
        # The tables are compared with their indices, including the times of messages.
        with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)) as database:
            (found,) = database.execute("PRAGMA integrity_check(1)").fetchone()
        if found != "ok":
            raise ValueError(found.splitlines()[-1])


def _check_mcap(content: memoryview) -> None:
    """Compare the CRC-32 of data and summary, if the writer stated them."""
    at = len(content) - len(_MCAP) - _FOOTER.size
    if at < 0 or content[-len(_MCAP) :] != _MCAP:
        raise ValueError("the end of the file is missing")
    code, _, summary, _, of_summary = _FOOTER.unpack_from(content, at)
    start = summary or at
    if code != _FOOTER_CODE or start > at:
        raise ValueError("no footer")
    end = max(start - _DATA_END.size, 0)
    code, _, of_data = _DATA_END.unpack_from(content, end)
    if of_summary and zlib.crc32(content[start : at + _FOOTER.size - _CRC_SIZE]) != of_summary:
        raise ValueError("the CRC-32 of its summary is wrong")
    if code == _DATA_END_CODE and of_data and zlib.crc32(content[:end]) != of_data:
        raise ValueError("the CRC-32 of its data is wrong")


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """An open bag; faults of the library become faults of the file."""
    highlevel, typesys = library("rosbags.highlevel", path), library("rosbags.typesys", path)
    known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with decoding(path, "bag", _ADVICE), highlevel.AnyReader([path], default_typestore=known) as bag:
        yield bag


def _read(source: Source) -> list[Table]:
    with decoding(source.path, "bag", _ADVICE):
        for file in sorted(source.path.iterdir()) if source.path.is_dir() else [source.path]:
            if file.is_file() and file.stat().st_size:
                _check(file)
    with _opened(source.path) as bag:
        topics = {c.topic: (c.msgtype, bag.topics[c.topic].msgcount) for c in bag.connections}
    warm = next((topic for topic, (kind, _) in topics.items() if kind == _TEMPERATURE), "")
    return [_table(source, topic, kind, count, warm) for topic, (kind, count) in topics.items()]


def _table(source: Source, topic: str, kind: str, count: int, warm: str) -> Table:
    """The table of a topic; temperatures are those of the topic `warm`, the last before each message."""
    names = [name for name in _ROLES if kind == _IMU or name.startswith(("time", _FORCE))] if kind in _PLACES else []
    names = [name for name in names if warm or name != "temperature"]
    vectors = [name for name in names if "." in name]
    first_ns = list[int]()

    def rows() -> Iterator[tuple[float, ...]]:
        values_of = attrgetter(*(name.replace(_FORCE, _PLACES[kind]) for name in vectors))
        temperature, seen = float("nan"), 0
        with _opened(source.path) as bag:
            chosen = [c for c in bag.connections if c.topic in (topic, warm)]
            for connection, received_ns, data in bag.messages(connections=chosen):
                message = bag.deserialize(data, connection.msgtype)
                if connection.topic == warm:
                    temperature = float(message.temperature)
                    continue
                # A driver without a clock stamps nothing: then the time of reception is used, relative to the first, as
                # ns since 1970 do not fit a float.
                stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec or received_ns
                if not first_ns:
                    first_ns.append(stamp_ns)
                seen += 1
                yield (stamp_ns - first_ns[0]) * 1e-9, temperature, *values_of(message)
        if count and seen != count:
            source.damage.report(f"the bag has {seen} messages of {topic}, but its index states {count}")

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        found = rows() if names else iter(())
        while piece := list(islice(found, PIECE_ROWS)):
            yield pl.DataFrame(piece, schema=["time", "temperature", *vectors], orient="row").select(columns)

    return Table(
        *(topic, tuple(names), pieces, count, {name: _ROLES[name] for name in names}),
        words=kind,
        row_word="message",
        zero_s=lambda: sum(first_ns) * 1e-9,
    )


READER = Reader(
    "ROS 1 or ROS 2 bag, MCAP",
    lambda path, head: head.startswith((_ROS1, _MCAP, _SQLITE)) or (path / "metadata.yaml").is_file(),
    _read,
)
