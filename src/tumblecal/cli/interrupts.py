"""Ctrl-C is never lost, wherever in Python or in a compiled module it arrives."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


_ASKED = threading.Event()


def interrupts_kept() -> None:
    """From here on Ctrl-C is remembered (`interrupted`) and cannot be lost in a callback.

    A callback of the garbage collector or of a weak reference lets no exception out: Python prints it and goes on.
    """
    on_main = threading.current_thread() is threading.main_thread()
    if on_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _asked_again


def interrupted() -> bool:
    """Whether Ctrl-C was pressed: compiled modules turn its exception into errors of their own."""
    return _ASKED.is_set()


def _interrupt(number: int, frame: FrameType | None) -> None:
    _ASKED.set()
    raise KeyboardInterrupt


def _asked_again(swallowed: "sys.UnraisableHookArgs") -> None:
    """A swallowed Ctrl-C comes again a moment later, outside the callback; anything else is shown as ever."""
    main = threading.main_thread().ident
    if issubclass(swallowed.exc_type, KeyboardInterrupt) and main is not None:
        # To the main thread itself: a signal to another would not wake it out of a wait.
        threading.Timer(0.02, signal.pthread_kill, [main, signal.SIGINT]).start()
    else:
        sys.__unraisablehook__(swallowed)


@contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Ctrl-C while compiled modules are being imported would be lost in them or crash them: it waits until the end."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    earlier = signal.signal(signal.SIGINT, lambda number, frame: received.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, earlier)
    if received:
        signal.raise_signal(signal.SIGINT)


def end_by(number: int) -> None:
    """End this process by a signal that was obeyed in order, so that the caller sees it; after Ctrl-C just return."""
    if number != signal.SIGINT:
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
