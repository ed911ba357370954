"""Ctrl-C, SIGTERM and SIGHUP end a command in order and with one line, wherever in Python or in a compiled module they arrive.

Before a command runs and after it nothing is half done: the process leaves at once. While it runs the signal is raised as
`KeyboardInterrupt`, so that what was begun is taken back; within an import, which it could break, a moment later.
"""

# The compiled part of `signal`, and no `contextlib`: each millisecond before the handlers is one without them.
import _signal as signal  # pyright: ignore[reportMissingImports]
import os
import sys
import time


TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType

# What a command says last that was ended so.
NOTHING_HALF_WRITTEN = "no file was left half-written"
_WORDS: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}
_OURS = tuple(_WORDS)
_IMPORTING = "<frozen importlib._bootstrap>"
# After so many seconds it is tried again.
_AGAIN_S = 0.02
# A signal this long after the first one is of somebody who will not wait any longer.
_PATIENCE_S = 1.0
# The signal that was received first, 0 for none, and when.
_asked, _asked_at = 0, 0.0


def leave_when_asked() -> None:
    """From here on a signal ends the process at once, with one line."""
    _handled_by(_leave, _OURS)


def interrupts_kept(numbers: tuple[int, ...] = (signal.SIGINT,)) -> None:
    """From here on these signals are raised as `KeyboardInterrupt`, remembered, and cannot be lost in a callback.

    A callback of the garbage collector or of a weak reference lets no exception out: Python prints it and goes on.
    """
    _handled_by(_interrupt, numbers)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _asked_again


def all_interrupts_kept() -> None:
    """The same of all three signals: for the process of a command; one that works for another leaves the others as they are."""
    interrupts_kept(_OURS)


def interrupted() -> bool:
    """Whether a signal asked for the end: compiled modules turn its exception into errors of their own."""
    return _asked != 0


def interrupted_by() -> int:
    """The signal that asked for the end; 0 for none."""
    return _asked


def line_of(number: int, words: str = NOTHING_HALF_WRITTEN) -> str:
    """The line that a command ends with."""
    return f"tumblecal: {_WORDS.get(number, 'interrupted')}; {words}"


def end_by(number: int) -> None:
    """End this process by a signal that was obeyed in order, so that the caller sees it; after Ctrl-C just return."""
    if number != signal.SIGINT:
        _printed()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)


def finished() -> None:
    """All is printed and written: while Python is taken down, which would lose its handlers first, signals come too late."""
    _printed()
    _handled_by(signal.SIG_IGN, _OURS)


def _printed() -> None:
    for stream in (sys.stdout, sys.stderr):
        try:  # noqa: SIM105
            stream.flush()
        except (OSError, ValueError):
            pass


def _handled_by(handler, numbers: tuple[int, ...]) -> None:
    """Give signals a handler, but for those that the caller ignores (`nohup`) or handles by itself."""
    before = (signal.SIG_DFL, signal.default_int_handler, _leave, _interrupt)
    for number in numbers:
        if signal.getsignal(number) in before:
            try:
                signal.signal(number, handler)
            except ValueError:  # not the main thread, which alone is given signals
                return


def _leave(number: int, frame: "FrameType | None") -> None:
    try:  # noqa: SIM105
        os.write(2, f"{line_of(number)}\n".encode())
    except OSError:
        pass
    if number != signal.SIGINT:
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
    os._exit(128 + number)


def _interrupt(number: int, frame: "FrameType | None") -> None:
    global _asked, _asked_at
    if not _asked:
        _asked, _asked_at = signal.SIGINT if number == signal.SIGALRM else number, time.monotonic()
    elif number != signal.SIGALRM:
        # What was begun is being taken back.
        if time.monotonic() > _asked_at + _PATIENCE_S:
            _leave(number, frame)
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
    """Try again a moment later."""
    signal.signal(signal.SIGALRM, _interrupt)
    signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)


def _asked_again(swallowed: "sys.UnraisableHookArgs") -> None:
    """A swallowed Ctrl-C comes again a moment later, outside the callback; anything else is shown as ever."""
    if issubclass(swallowed.exc_type, KeyboardInterrupt):
        _again()
    else:
        sys.__unraisablehook__(swallowed)
