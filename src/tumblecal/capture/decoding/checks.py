"""The check values of serial frames, for many frames at once.

Cyclic checks are linear over GF(2): the check of a frame is the exclusive or of one table entry a byte, so a
column of many frames is one table look-up. Sums over any stretch of bytes come from running sums.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray


CRC32_MPEG2_POLYNOMIAL = 0x04C11DB7
_ALL_ONES = 0xFFFFFFFF


@cache
def _crc32_byte_table() -> NDArray[np.uint32]:
    table = np.zeros(256, np.uint32)
    for byte in range(256):
        register = byte << 24
        for _ in range(8):
            register = (register << 1) ^ (CRC32_MPEG2_POLYNOMIAL if register & 0x80000000 else 0)
        table[byte] = register & _ALL_ONES
    return table


@cache
def _crc32_columns(length: int, padding: int) -> tuple[NDArray[np.uint32], np.uint32]:
    """Per column of a frame the contribution of each byte value, and that of the initial register."""
    table = _crc32_byte_table()
    columns = np.zeros((length + padding, 256), np.uint32)
    columns[-1] = table
    for j in range(length + padding - 2, -1, -1):
        after = columns[j + 1]
        columns[j] = (after << np.uint32(8)) ^ table[after >> np.uint32(24)]
    # An initial register of ones equals inverting the first four bytes.
    initial = np.bitwise_xor.reduce([columns[j][0xFF] for j in range(4)])
    return columns[:length], np.uint32(initial)


def crc32_mpeg2(rows: NDArray[np.uint8], padding: int = 0) -> NDArray[np.uint32]:
    """CRC-32/MPEG-2 of the rows of a (n, length) array, each followed by `padding` zero bytes that are not sent (STIM300).

    Polynomial 0x04C11DB7, initial register all ones, not reflected, no final inversion; `length` is at least 4.
    """
    columns, initial = _crc32_columns(rows.shape[1], padding)
    check = np.full(rows.shape[0], initial, np.uint32)
    for j in range(rows.shape[1]):
        check ^= columns[j].take(rows[:, j])
    return check


def crc16_xmodem(text: bytes) -> int:
    """CRC-16 with polynomial 0x1021, initial register 0, not reflected (VectorNav; check value 0x31C3)."""
    from binascii import crc_hqx

    return crc_hqx(text, 0)


def exclusive_or(text: bytes) -> int:
    """The exclusive or of all bytes (NMEA-like lines)."""
    if not text:
        return 0
    return int(np.bitwise_xor.reduce(np.frombuffer(text, np.uint8)))


class RunningSums:
    """Sums over any stretch `[start, stop)` of `data` in constant time each.

    **Arguments:**

    - `data`: the bytes; no longer than 2^31, so that the weighted sums stay exact.
    """

    def __init__(self, data: NDArray[np.uint8]):
        self._sum = np.concatenate([[0], np.cumsum(data, dtype=np.int64)])
        self._sum_of_sums = np.concatenate([[0], np.cumsum(self._sum[1:])])

    def plain(self, start: NDArray[np.integer], stop: NDArray[np.integer]) -> NDArray[np.int64]:
        """The sum of the bytes of each stretch."""
        return self._sum[stop] - self._sum[start]

    def fletcher(
        self, start: NDArray[np.integer], stop: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Fletcher's pair modulo 256: the sum, and the sum of the running sums, of each stretch (MIP)."""
        second = self._sum_of_sums[stop] - self._sum_of_sums[start] - (stop - start) * self._sum[start]
        return self.plain(start, stop) % 256, second % 256
