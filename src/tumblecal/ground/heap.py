"""Heap of the C library."""

import ctypes
from contextlib import suppress


# M_ARENA_MAX of glibc's malloc.h.
_ARENA_MAX = -8


def one_heap() -> None:
    """Use one heap for all threads with glibc; no effect otherwise. Must be called before threads are started.

    Otherwise each thread keeps its freed memory: compilers and table readers leave tens of megabytes unused.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(_ARENA_MAX, 1)
