"""The check values of serial frames; those of numpy frames for many frames of one size at once."""

from binascii import crc_hqx
from collections.abc import Callable
from functools import cache, reduce
from operator import xor

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Bytes, Integers


CRC32_MPEG2_POLYNOMIAL = 0x04C11DB7
# Frames that remain in the processor's cache.
_BLOCK = 16384


@cache
def _crc32_columns(length: int) -> tuple[NDArray[np.uint32], np.uint32]:
    """Contribution of each byte value in each column of a message, shape (length, 256), and that of the initial register.

    Cyclic checks are linear over GF(2): the check is the exclusive or of one entry a byte.
    """
    table = np.arange(256, dtype=np.uint32) << 24
    for _ in range(8):
        table = table << 1 ^ np.where(table >> 31, np.uint32(CRC32_MPEG2_POLYNOMIAL), np.uint32(0))
    columns = np.tile(table, (length, 1)).astype(np.uint32)
    for j in range(length - 1, 0, -1):
        columns[j - 1] = columns[j] << 8 ^ table[columns[j] >> 24]
    # An initial register of ones equals inverting the first four bytes.
    return columns, np.uint32(np.bitwise_xor.reduce(columns[:4, 0xFF]))


def crc32_mpeg2(rows: Bytes, padding: int = 0) -> NDArray[np.uint32]:
    """CRC-32/MPEG-2 of the rows of a (n, length) array, each followed by `padding` zero bytes that are not sent (STIM300).

    Polynomial 0x04C11DB7, initial register all ones, not reflected, no final inversion; `length` is at least 4.
    """
    columns, initial = _crc32_columns(rows.shape[1] + padding)
    check = np.full(len(rows), initial)
    for first in range(0, len(rows), _BLOCK):
        block = slice(first, first + _BLOCK)
        for column, contribution in zip(rows[block].T, columns, strict=False):
            check[block] ^= contribution.take(column.astype(np.intp), mode="wrap")
    return check


def crc16_xmodem(text: bytes) -> int:
    """CRC-16 with polynomial 0x1021, initial register 0, not reflected (VectorNav; check value 0x31C3)."""
    return crc_hqx(text, 0)


def exclusive_or(text: bytes) -> int:
    """The exclusive or of all bytes (NMEA-like lines)."""
    return reduce(xor, text, 0)


def byte_sum(rows: Bytes) -> Integers:
    """The sum of the bytes of each row, shape (n,)."""
    return rows.sum(axis=1, dtype=np.int64)


def ends_with(check: Callable[[Bytes], Bytes], size: int) -> Callable:
    """A function for whether frames, shape (n, length), end with the `size` bytes that `check` computes from those before."""
    return lambda rows: (check(rows[:, :-size]) == rows[:, -size:]).all(axis=1)
