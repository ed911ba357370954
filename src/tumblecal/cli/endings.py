"""The end of the process by a signal, with one line; while nothing is incomplete, at once."""

# The compiled part of `signal`, and no `contextlib`: the handlers must be installed as early as possible.
import _signal as signal  # pyright: ignore[reportMissingImports]
import os
import sys


TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType

# Last words of an interrupted command.
NOTHING_HALF_WRITTEN = "no file was left half-written"
_WORDS: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}
ALL = tuple(_WORDS)
# Handlers that may be replaced: those of Python, and of this program. A caller ignores signals with `nohup`.
_REPLACED = [signal.SIG_DFL, signal.default_int_handler]


def leave_when_asked() -> None:
    """From now on a signal ends the process at once, with one line."""
    handled_by(leave, ALL)


def line_of(number: int, words: str = NOTHING_HALF_WRITTEN) -> str:
    """The last line of an interrupted command."""
    return f"tumblecal: {_WORDS.get(number, 'interrupted')}; {words}"


def end_by(number: int) -> None:
    """End this process by a signal after a clean exit, so that the caller sees the signal; after Ctrl-C just return."""
    if number != signal.SIGINT:
        _printed()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)


def finished() -> None:
    """Ignore signals after all output is written: Python removes its handlers before it exits."""
    _printed()
    handled_by(signal.SIG_IGN, ALL)


def _printed() -> None:
    for stream in (sys.stdout, sys.stderr):
        try:  # noqa: SIM105
            stream.flush()
        except (OSError, ValueError):
            pass


def handled_by(handler, numbers: tuple[int, ...]) -> None:
    """Install a handler for signals that the caller does not ignore (`nohup`) or handle."""
    for number in numbers:
        if signal.getsignal(number) in _REPLACED:
            try:
                signal.signal(number, handler)
            except ValueError:  # not the main thread, which alone receives signals
                return
    _REPLACED.append(handler)


def leave(number: int, frame: "FrameType | None") -> None:
    """End the process at once, with one line."""
    try:  # noqa: SIM105
        os.write(2, f"{line_of(number)}\n".encode())
    except OSError:
        pass
    if number != signal.SIGINT:
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
    os._exit(128 + number)
