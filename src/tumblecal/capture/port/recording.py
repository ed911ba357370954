"""The guide's side of the recorder: starts the process, follows its log, passes commands, and restarts it if it dies."""

import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

from tumblecal.capture.log import LogReader, Record
from tumblecal.capture.port.recorder import FAILED
from tumblecal.ground.errors import InputError


_START_S = 10.0
_STOP_S = 5.0


class Recording:
    """A running recorder.

    **Arguments:**

    - `log`: the raw log; followed from its end.
    - `url`, `baud`: the port, and its speed in bits per second.

    `synced`: end of the part of the log that is on the disk.

    **Raises:** `InputError` if the port or the log cannot be opened.
    """

    def __init__(self, log: Path, url: str, baud: int):
        self.log, self._url, self.baud = log, url, baud
        self.synced = self.restarts = 0
        # The log exists before the recorder begins, and is followed from its present end.
        try:
            log.touch()
            self._reader = LogReader(log, log.stat().st_size)
        except OSError as error:
            raise InputError(f"{log}: cannot be written ({error.strerror})") from error
        try:
            self._launch()
        except InputError:
            self._reader.close()
            raise

    @property
    def pid(self) -> int:
        """Process number of the recorder."""
        return self._process.pid

    @property
    def position(self) -> int:
        """Place in the log up to which records were read."""
        return self._reader.position

    def _launch(self) -> None:
        command = [sys.executable, "-m", "tumblecal.capture.port.recorder", str(self.log), self._url, str(self.baud)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        self._output, deadline = b"", time.monotonic() + _START_S
        words = f"{self.log}: the recorder did not start; check whether {sys.executable} can run"
        while time.monotonic() < deadline and self._process.poll() is None:
            messages = self._messages()
            if any("opened" in message for message in messages):
                return
            if errors := [message["error"] for message in messages if "error" in message]:
                words = errors[0]
                break
            time.sleep(0.01)
        words = next((message["error"] for message in self._messages() if "error" in message), words)
        self._end()
        raise InputError(words)

    def _messages(self) -> list[dict]:
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self._output += self._process.stdout.read() or b""
        *lines, self._output = self._output.split(b"\n")
        messages = [json.loads(line) for line in lines]
        for message in messages:
            self.synced = message.get("synced", self.synced)
        return messages

    def poll(self) -> list[Record]:
        """New records; restarts the recorder if it died.

        **Raises:** `InputError` if the disk is full or failed, or the port cannot be reopened.
        """
        code = self._process.poll()
        error = next((message["error"] for message in self._messages() if "error" in message), None)
        records = list(self._reader.records())
        if error is not None or code == FAILED:
            raise InputError(error or f"{self.log}: the recorder ended with code {code}")
        if code is not None:
            self.restarts += 1
            self._close_pipes()
            self._launch()
        return records

    def sync(self) -> None:
        """Write the data read from the log to the disk: a position may be accepted only after this.

        **Raises:** `InputError` if the disk fails.
        """
        self._reader.sync()

    def send(self, data: bytes) -> None:
        """Have the recorder write a command to the device."""
        self._command({"send": data.hex()})

    def _command(self, content: dict) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError, ValueError):
            self._process.stdin.write((json.dumps(content) + "\n").encode())
            self._process.stdin.flush()

    def stop(self) -> list[Record]:
        """End the recorder cleanly and return the last records."""
        self._end()
        records = list(self._reader.records())
        self._reader.close()
        return records

    def _end(self) -> None:
        self._command({"stop": True})
        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        with contextlib.suppress(ValueError):
            self._messages()
        self._close_pipes()

    def _close_pipes(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
