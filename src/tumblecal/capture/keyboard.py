"""Single keys from a terminal, without waiting; characters from other inputs."""

import contextlib
import os
import select
import sys
import termios
import tty
from types import TracebackType


class Keyboard:
    """Keys pressed since the last call.

    On a terminal each key is read separately; from a pipe, each character is a key.
    """

    def __init__(self) -> None:
        self._saved: list | None = None
        self._open = True

    def __enter__(self) -> "Keyboard":
        if sys.stdin.isatty():
            with contextlib.suppress(termios.error):
                self._saved = termios.tcgetattr(sys.stdin.fileno())
                tty.setcbreak(sys.stdin.fileno())
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._saved is not None:
            with contextlib.suppress(termios.error):  # the terminal may be closed
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSADRAIN, self._saved)

    def pressed(self) -> str:
        """The keys pressed since the last call, in order."""
        keys = ""
        while self._open and select.select([sys.stdin], [], [], 0)[0]:
            data = b""
            with contextlib.suppress(OSError):  # the terminal is closed
                data = os.read(sys.stdin.fileno(), 1024)
            if not data:
                self._open = False
                break
            keys += data.decode(errors="replace")
        return keys
