"""Byte logs of the MIMU4444 and similar devices (Inertial Elements, OpenShoe): several IMUs in a frame, one table for each.

A frame is AA, a running number (u16), the length of the payload (u8), ticks of 64 MHz (u32), for each IMU ax ay az gx gy gz
(i16), and the sum of all bytes before it (u16); numbers are big-endian.
"""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.framing import Frames, find, rows_of
from tumblecal.ground.decoding import damaged
from tumblecal.recordings.table import Reader, Source, Table, of_arrays


_MARK, _HEADER, _CHECK, _TICKS, _OF_IMU = b"\xaa", 4, 2, 4, 12
_TICKS_PER_S = 64e6
# MPU-9150 at the ranges that the firmware sets: 16 g and 2000 deg/s.
_PER_UNIT = {"a": 2048.0, "g": 16.4}
_NAMES = [f"{kind}{axis}" for kind in "ag" for axis in "xyz"]


def _numbers(frames: NDArray[np.uint8], first: int, stop: int | None, kind: str) -> NDArray[np.int64]:
    """Some bytes of each frame as numbers."""
    return np.ascontiguousarray(frames[:, first:stop]).view(kind).astype(np.int64)


def _sizes(data: NDArray[np.uint8], places: NDArray[np.int64]) -> NDArray[np.int64]:
    payload = data[places + 3].astype(np.int64)
    possible = (payload >= _TICKS + _OF_IMU) & ((payload - _TICKS) % _OF_IMU == 0)
    return np.where(possible, _HEADER + payload + _CHECK, 0)


def _intact(frames: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return frames[:, :-_CHECK].sum(1, dtype=np.int64) & 0xFFFF == _numbers(frames, -_CHECK, None, ">u2")[:, 0]


def _frames(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The complete frames with a correct checksum (n, length), from the first one that is followed by a second one."""
    starts, sizes, _ = find((Frames((_MARK,), _HEADER, _sizes, _intact),), data, final=True)
    followed = np.flatnonzero(np.isin(starts + sizes, starts))[:1]
    if not len(followed):
        return np.zeros((0, 0), np.uint8)
    length = int(sizes[followed[0]])
    return rows_of(data, starts[(starts >= starts[followed[0]]) & (sizes == length)], length)


def _read(source: Source) -> list[Table]:
    data = np.memmap(source.path, np.uint8, "r")
    frames = _frames(data)
    if not len(frames):
        raise damaged(source.path, "MIMU log", "no frame")
    if outside := len(data) - frames.size:
        source.damage.report(
            f"{outside} of {len(data)} bytes are outside complete frames with a correct checksum and are left out"
        )
    ticks = _numbers(frames, _HEADER, _HEADER + _TICKS, ">u4")[:, 0]
    time_s = np.cumsum(np.diff(ticks, prepend=ticks[0]) % (1 << 32)) / _TICKS_PER_S
    values = _numbers(frames, _HEADER + _TICKS, -_CHECK, ">i2").astype(float)
    columns = values.reshape(len(frames), -1, len(_NAMES)).transpose(1, 2, 0)
    roles = {"time": "time_s"} | {name: f"{name}_counts" for name in _NAMES}
    return [
        of_arrays(
            f"imu{number}",
            {"time": time_s} | dict(zip(_NAMES, imu, strict=True)),
            roles=roles,
            per_unit=_PER_UNIT,
            words=f"{len(frames)} frames",
        )
        for number, imu in enumerate(columns, start=1)
    ]


def _recognised(path: object, head: bytes) -> bool:
    return bool(_frames(np.frombuffer(head, np.uint8)).size)


READER = Reader("MIMU4444 bytes", _recognised, _read, rank=1)
