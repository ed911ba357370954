"""A virtual instrument and the capture command as processes of their own, and hands to work them."""

import contextlib
import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path


# Signals that the tests send, also where these run in the background of something that ignores them.
_SIGNALS = """
import signal
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
"""
_EMULATE = (
    _SIGNALS
    + """
import sys
from pathlib import Path
from tumblecal.cli.commands.emulate import emulate
follow, chamber = (Path(name) if name else None for name in sys.argv[4:6])
ledger = Path(sys.argv[2] + ".json")
emulate(Path(sys.argv[1]), port=Path(sys.argv[2]), speed=float(sys.argv[3]), ledger=ledger, follow=follow, chamber=chamber)
"""
)
_CAPTURE = (
    _SIGNALS
    + """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from tumblecal.capture.run import contact
# Seconds after each question for the serial number, shorter where a test wants no answer.
if "QUESTIONS" in os.environ:
    contact.WAITS_S = tuple(map(float, os.environ["QUESTIONS"].split()))
from tumblecal.cli.commands import app
from tumblecal.ground.errors import InputError
from tumblecal.cli.commands.capture import capture
from cyclopts import App
app = App(result_action="return_value")
app.default(capture)
try:
    app(sys.argv[1:])
except InputError as error:
    print("FAULT", *error.faults, flush=True)
    sys.exit(2)
"""
)


class Emulator:
    """`tumblecal emulate` in its own process; `turn` types angles into it, unless it follows a capture."""

    def __init__(self, folder: Path, config: str, speed: float = 20.0, follow: str | None = None, chamber: str = ""):
        self.port = folder / "imu"
        path = folder / "emulator.toml"
        path.write_text(config)
        names = [str(folder / name) if name else "" for name in (follow, chamber)]
        self.process = subprocess.Popen(
            [sys.executable, "-c", _EMULATE, str(path), str(self.port), str(speed), *names],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert "Ctrl-C ends" in line, line

    def turn(self, alpha: float, beta: float) -> None:
        self._type(f"{alpha} {beta}\n")

    def _type(self, text: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(text)
        self.process.stdin.flush()

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()

    def __enter__(self) -> "Emulator":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class CaptureProcess:
    """`tumblecal capture` on a controlling terminal of its own: lines come out, keys go in."""

    def __init__(self, folder: Path, *arguments: str, rows: int = 40, columns: int = 200, questions: str = ""):
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.terminal = os.ttyname(slave)
        self.raw = b""
        self.process = subprocess.Popen(
            [sys.executable, "-c", _CAPTURE, *arguments],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            cwd=folder,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm-256color", "NO_COLOR": "1"}
            | ({"QUESTIONS": questions} if questions else {}),
        )
        os.close(slave)
        os.set_blocking(self._master, False)
        self._rest = ""
        self.seen: list[str] = []

    def lines(self) -> list[str]:
        """New whole lines, and a question without line end."""
        with contextlib.suppress(OSError):
            data = os.read(self._master, 65536)
            self.raw += data
            self._rest += data.decode(errors="replace")
        *lines, self._rest = self._rest.replace("\r", "").replace("\a", "").split("\n")
        if self._rest.endswith("[y/n] "):
            lines, self._rest = [*lines, self._rest], ""
        self.seen += lines
        return lines

    def press(self, text: str) -> None:
        os.write(self._master, text.encode())

    def wait_for(self, seen: Callable[[], object], limit_s: float = 600.0) -> None:
        """Read what comes until something is so."""
        deadline = time.monotonic() + limit_s
        while not seen():
            assert time.monotonic() < deadline, self.raw[-2000:].decode(errors="replace")
            self.lines()
            time.sleep(0.01)

    def flags(self) -> int:
        """The terminal's local modes (echo, whole lines)."""
        return termios.tcgetattr(self._master)[3]

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def kill(self) -> None:
        self.process.kill()
        self.close()

    def hang_up(self) -> None:
        """Close the terminal's window."""
        os.close(self._master)

    def wait(self) -> int:
        """Wait for the end; the exit code."""
        deadline = time.monotonic() + 600
        while self.running and time.monotonic() < deadline:
            self.lines()
            time.sleep(0.02)
        if self.running:
            self.process.kill()
        return self.process.wait()

    def close(self) -> int:
        """Wait for the end and take the terminal away; the exit code."""
        code = self.wait()
        self.lines()
        os.close(self._master)
        return code
