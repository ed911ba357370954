"""The C library's heap."""

import ctypes
from contextlib import suppress


# M_ARENA_MAX of glibc's malloc.h.
_ARENA_MAX = -8


def one_heap() -> None:
    """One heap for all threads, where the C library is glibc; nothing elsewhere. To be called before threads are started.

    Else every thread keeps what it has freed for itself: compilers and table readers leave tens of megabytes unused.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(_ARENA_MAX, 1)
