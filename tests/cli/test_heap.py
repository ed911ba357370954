"""Threads share one heap once a command asked for it."""

import platform
import subprocess
import sys

import pytest


_THREADS = """
import ctypes, threading
from tumblecal.ground.heap import one_heap
{first}
gate = threading.Barrier(3)
def fill():
    gate.wait()
    blocks = [bytearray(5000) for _ in range(200)]
threads = [threading.Thread(target=fill) for _ in range(3)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
ctypes.CDLL(None).malloc_stats()
"""


def heaps_after(first: str) -> int:
    script = [sys.executable, "-c", _THREADS.format(first=first)]
    return subprocess.run(script, capture_output=True, text=True, check=True).stderr.count("Arena ")


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the heap is another library's")
def test_threads_have_heaps_of_their_own_until_one_is_asked_for():
    assert heaps_after("") > 1
    assert heaps_after("one_heap()") == 1
