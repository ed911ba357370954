"""Byte logs of the MIMU4444 and similar devices (Inertial Elements, OpenShoe): several IMUs in a frame, one table for each.

A frame is AA, a running number (u16), the length of the payload (u8), ticks of 64 MHz (u32), for each IMU ax ay az gx gy gz
(i16), and the sum of all bytes before it (u16); numbers are big-endian.
"""

import numpy as np

from tumblecal.ground.decoding import damaged
from tumblecal.recordings.table import Reader, Source, Table, of_arrays


_TICKS_PER_S = 64e6
# MPU-9150 at the ranges that the firmware sets: 16 g and 2000 deg/s.
_PER_UNIT = {"a": 2048.0, "g": 16.4}
_NAMES = [f"{kind}{axis}" for kind in "ag" for axis in "xyz"]


def _frame_at(data: bytes, start: int) -> int:
    """Length of the complete frame at this place; 0 if there is none."""
    if len(data) < start + 4 or data[start] != 0xAA:
        return 0
    payload = data[start + 3]
    length = 4 + payload + 2
    frame = data[start : start + length]
    whole = len(frame) == length and payload >= 16 and (payload - 4) % 12 == 0
    return length if whole and sum(frame[:-2]) & 0xFFFF == int.from_bytes(frame[-2:], "big") else 0


def _first_frame(data: bytes) -> tuple[int, int]:
    """Start and length of the first frame that is followed by a second one; zeros if there is none."""
    for start in range(min(len(data), 4096)):
        length = _frame_at(data, start)
        if length and _frame_at(data, start + length):
            return start, length
    return 0, 0


def _read(source: Source) -> list[Table]:
    data = source.path.read_bytes()
    start, length = _first_frame(data)
    if not length:
        raise damaged(source.path, "MIMU log", "no frame")
    whole, rows = [], 0
    content = np.frombuffer(data, np.uint8)
    while start + length <= len(data):
        # All contiguous frames with a correct checksum are read at once.
        count = min((len(data) - start) // length, 1 << 14)
        frames = content[start : start + count * length].reshape(count, length)
        right = (frames[:, :-2].sum(1, dtype=np.int64) & 0xFFFF) == frames[:, -2].astype(int) * 256 + frames[:, -1]
        right &= frames[:, 0] == 0xAA
        good = int(np.argmin(np.append(right, False)))
        whole.append(frames[:good])
        rows += good
        start += good * length if good else 1
    frames = np.concatenate(whole)
    if outside := len(data) - rows * length:
        source.damage.report(
            f"{outside} of {len(data)} bytes are outside complete frames with a correct checksum and are left out"
        )
    ticks = np.ascontiguousarray(frames[:, 4:8]).view(">u4")[:, 0].astype(np.int64)
    time_s = np.concatenate([[0], np.cumsum(np.diff(ticks) % (1 << 32))]) / _TICKS_PER_S
    values = np.ascontiguousarray(frames[:, 8:-2]).view(">i2").reshape(rows, -1, 6)
    roles = {"time": "time_s"} | {name: f"{name}_counts" for name in _NAMES}
    return [
        of_arrays(
            f"imu{k + 1}",
            {"time": time_s} | {name: values[:, k, column].astype(float) for column, name in enumerate(_NAMES)},
            roles=roles,
            per_unit=_PER_UNIT,
            words=f"{rows} frames",
        )
        for k in range(values.shape[1])
    ]


READER = Reader("MIMU4444 bytes", lambda path, head: bool(_first_frame(head)[1]), _read, rank=1)
