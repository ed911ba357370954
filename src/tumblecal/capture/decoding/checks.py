"""The check values of serial frames; those of numpy frames for many frames of one size at once."""

from binascii import crc_hqx
from collections.abc import Callable
from functools import reduce
from operator import xor

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Bytes, Integers


CRC32_MPEG2_POLYNOMIAL = 0x04C11DB7
# Contribution of a byte value to the check, shape (256,).
_CRC32 = np.arange(256, dtype=np.uint32) << 24
for _ in range(8):
    _CRC32 = _CRC32 << 1 ^ (_CRC32 >> 31) * np.uint32(CRC32_MPEG2_POLYNOMIAL)
# Frames that remain in the processor's cache.
_BLOCK = 16384


def crc32_mpeg2(rows: Bytes, padding: int = 0) -> NDArray[np.uint32]:
    """CRC-32/MPEG-2 of the rows of a (n, length) array, each followed by `padding` zero bytes that are not sent (STIM300).

    Polynomial 0x04C11DB7, initial register all ones, not reflected, no final inversion.
    """
    check = np.full(len(rows), 0xFFFFFFFF, np.uint32)
    for first in range(0, len(rows), _BLOCK):
        register = check[first : first + _BLOCK]
        for column in [*rows[first : first + _BLOCK].T, *[0] * padding]:
            register[:] = register << 8 ^ _CRC32.take(register >> 24 ^ column)
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
