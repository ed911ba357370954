"""A virtual instrument and the capture command as processes of their own, and hands to work them."""

import contextlib
import os
import pty
import subprocess
import sys
import time
from pathlib import Path


_EMULATE = """
import sys
from pathlib import Path
from tumblecal.cli.emulate import emulate
emulate(Path(sys.argv[1]), port=Path(sys.argv[2]), speed=float(sys.argv[3]), ledger=Path(sys.argv[2] + ".json"))
"""
_CAPTURE = """
import sys
from tumblecal.cli import app
from tumblecal.errors import InputError
from tumblecal.cli.capture import capture
from cyclopts import App
app = App(result_action="return_value")
app.default(capture)
try:
    app(sys.argv[1:])
except InputError as error:
    print("FAULT", *error.faults, flush=True)
    sys.exit(2)
"""


class Emulator:
    """`tumblecal emulate` in its own process; `turn` types angles into it."""

    def __init__(self, folder: Path, config: str, speed: float = 20.0):
        self.port = folder / "imu"
        path = folder / "emulator.toml"
        path.write_text(config)
        self._process = subprocess.Popen(
            [sys.executable, "-c", _EMULATE, str(path), str(self.port), str(speed)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert "Ctrl-C ends" in line, line

    def turn(self, alpha: float, beta: float) -> None:
        self._type(f"{alpha} {beta}\n")

    def _type(self, text: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(text)
        self._process.stdin.flush()

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()

    def __enter__(self) -> "Emulator":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class CaptureProcess:
    """`tumblecal capture` behind a pseudo-terminal of its own: lines come out, keys go in."""

    def __init__(self, folder: Path, *arguments: str):
        self._master, slave = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-c", _CAPTURE, *arguments],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            cwd=folder,
            start_new_session=True,
        )
        os.close(slave)
        os.set_blocking(self._master, False)
        self._rest = ""
        self.seen: list[str] = []

    def lines(self) -> list[str]:
        """New whole lines, and a question without line end."""
        with contextlib.suppress(OSError):
            self._rest += os.read(self._master, 65536).decode(errors="replace")
        *lines, self._rest = self._rest.replace("\r", "").replace("\a", "").split("\n")
        if self._rest.endswith("[y/n] "):
            lines, self._rest = [*lines, self._rest], ""
        self.seen += lines
        return lines

    def press(self, text: str) -> None:
        os.write(self._master, text.encode())

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def kill(self) -> None:
        self.process.kill()
        self.close()

    def close(self) -> int:
        """Wait for the end; the exit code."""
        deadline = time.monotonic() + 30
        while self.running and time.monotonic() < deadline:
            self.lines()
            time.sleep(0.02)
        if self.running:
            self.process.kill()
        code = self.process.wait()
        self.lines()
        os.close(self._master)
        return code
