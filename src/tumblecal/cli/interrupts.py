"""Ctrl-C, SIGTERM and SIGHUP end a command cleanly with one line, also if they arrive in a compiled module.

Before and after a command no work is incomplete, so the process exits at once. During a command the signal is raised as
`KeyboardInterrupt`, so that incomplete work is undone; during an import, which it could break, it is raised a moment later.
"""

# The compiled part of `signal`: see `endings`.
import _signal as signal  # pyright: ignore[reportMissingImports]
import sys
import time

from tumblecal.cli.endings import handled_by, leave


TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType

_IMPORTING = "<frozen importlib._bootstrap>"
# Delay before a signal is raised again, s.
_AGAIN_S = 0.02
# A second signal after this time, s, ends the process at once.
_PATIENCE_S = 1.0
# The first received signal, 0 for none, and its time.
_asked, _asked_at = 0, 0.0


def interrupts_kept(numbers: tuple[int, ...] = (signal.SIGINT,)) -> None:
    """From now on these signals are recorded, raised as `KeyboardInterrupt`, and cannot be lost in a callback.

    An exception in a callback of the garbage collector or of a weak reference is printed by Python, but not raised.
    """
    handled_by(_interrupt, numbers)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _asked_again


def interrupted_by() -> int:
    """The received signal, 0 for none: compiled modules convert its exception into other errors."""
    return _asked


def _interrupt(number: int, frame: "FrameType | None") -> None:
    global _asked, _asked_at
    if not _asked:
        _asked, _asked_at = signal.SIGINT if number == signal.SIGALRM else number, time.monotonic()
    elif number != signal.SIGALRM:
        # Incomplete work is being undone.
        if time.monotonic() > _asked_at + _PATIENCE_S:
            leave(number, frame)
        return
    if _within_import(frame):
        _again()
    else:
        raise KeyboardInterrupt


def _within_import(frame: "FrameType | None") -> bool:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORTING:
            return True
        frame = frame.f_back
    return False


def _again() -> None:
    """Raise the signal again a moment later."""
    signal.signal(signal.SIGALRM, _interrupt)
    signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)


def _asked_again(swallowed: "sys.UnraisableHookArgs") -> None:
    """Raise a swallowed Ctrl-C again a moment later, outside the callback; other exceptions are printed as usual."""
    if issubclass(swallowed.exc_type, KeyboardInterrupt):
        _again()
    else:
        sys.__unraisablehook__(swallowed)
