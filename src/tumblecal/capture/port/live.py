"""The guide's side of the recorder: starts the process, follows its log, and decodes the stream."""

import os
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tumblecal.capture.decoding.samples import Entry, Event, Floats, Integers, Samples, Settings, joined
from tumblecal.capture.decoding.tally import Tally
from tumblecal.capture.log import LogReader, Record, RecordKind
from tumblecal.capture.port.recorder import FAILED
from tumblecal.capture.protocols import Protocol
from tumblecal.ground.errors import InputError


_START_S, _STOP_S = 10.0, 5.0
_RECENT_BYTES = 65536


class Recording:
    """A running recorder, which is started again if it dies.

    **Arguments:**

    - `log`: the raw log; followed from its end.
    - `url`, `baud`: the port, and its speed in bits per second.

    `pid`: process number of the recorder. `restarts`: number of times that it was started again.

    **Raises:** `InputError` if the port or the log cannot be opened.
    """

    def __init__(self, log: Path, url: str, baud: int):
        self.log, self._url, self.baud, self.restarts = log, url, baud, 0
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
    def position(self) -> int:
        """Place in the log up to which records were read."""
        return self._reader.position

    def _launch(self) -> None:
        command = [sys.executable, "-m", "tumblecal.capture.port.recorder", str(self.log), self._url, str(self.baud)]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, start_new_session=True)
        self.pid, deadline = self._process.pid, time.monotonic() + _START_S
        self._first = list[Record]()
        while time.monotonic() < deadline and self._process.poll() is None:
            self._first += self._reader.records()
            if any(record.kind == RecordKind.EVENT and record.content()["event"] == "opened" for record in self._first):
                return
            time.sleep(0.01)
        words = f"{self.log}: the recorder did not start; check whether {sys.executable} can run"
        raise InputError(self._end() or words)

    def poll(self) -> list[Record]:
        """New records; restarts the recorder if it died.

        **Raises:** `InputError` if the disk is full or failed, or the port cannot be reopened.
        """
        code = self._process.poll()
        records, self._first = [*self._first, *self._reader.records()], []
        if code == FAILED:
            raise InputError(self._end() or f"{self.log}: the recorder ended with code {code}")
        if code is not None:
            self.restarts += 1
            self._end()
            self._launch()
        return records

    def sync(self) -> None:
        """Write the data read from the log to the disk: a position may be accepted only after this.

        **Raises:** `InputError` if the disk fails.
        """
        self._reader.sync()

    def send(self, data: bytes) -> None:
        """Have the recorder write a command to the device."""
        with suppress(OSError, ValueError):
            os.write(self._process.stdin.fileno(), data.hex().encode() + b"\n")  # type: ignore[union-attr]

    def stop(self) -> list[Record]:
        """End the recorder cleanly and return the last records."""
        self._end()
        records = list(self._reader.records())
        self._reader.close()
        return records

    def _end(self) -> str:
        """End the process; returns the reason for which it ended by itself, or an empty text."""
        try:
            return self._process.communicate(timeout=_STOP_S)[0].strip()
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.communicate()[0].strip()


@dataclass(frozen=True)
class Arrived:
    """New samples: `host_s` stamp of the read that completed each, `log_start` and `log_stop` of its record."""

    samples: Samples
    host_s: Floats
    log_start: Integers
    log_stop: Integers
    events: list[Event]
    notices: list[Entry]


class LiveStream:
    """Follows a recording and decodes it.

    **Arguments:**

    - `recording`: the running recorder.
    - `protocol`: protocol of the device.
    - `settings`: range, rate and columns, as far as the stream does not state them.

    `tally`: all counts. `recent`: the last bytes.
    """

    def __init__(self, recording: Recording, protocol: Protocol, settings: Settings):
        self.recording, self.protocol = recording, protocol
        self._decoder, self.tally, self.recent = protocol.decoder(settings), Tally(protocol.counter), b""
        # End in the stream, place in the log and stamp of the records whose samples are not complete.
        self._records = list[tuple[int, int, int, float]]()

    def poll(self) -> Arrived:
        """The samples since the last call."""
        tally, raw, notices = self.tally, b"", list[Entry]()
        for record in self.recording.poll():
            if record.kind == RecordKind.EVENT:
                notices.append(record.content())
                tally.reopened += notices[-1]["event"] == "reopened"
            else:
                raw += record.payload
                tally.bytes += len(record.payload)
                self._records.append((tally.bytes, record.offset, record.stop, record.stamp_ns * 1e-9))
        self.recent = (self.recent + raw)[-_RECENT_BYTES:]
        decoded = self._decoder.feed(raw)
        tally.add(decoded)
        ends, start, stop, stamp_s = np.array(self._records or np.zeros((0, 4))).T
        which = np.searchsorted(ends, decoded.samples.stop)
        self._records = self._records[which[-1] if len(which) else 0 :]
        places = start[which].astype(int), stop[which].astype(int)
        return Arrived(decoded.samples, stamp_s[which], *places, decoded.events, notices)


def collected(parts: list[Arrived]) -> tuple[Samples, Floats]:
    """Samples and stamps of several polls together."""
    return joined(p.samples for p in parts), np.concatenate([np.zeros(0), *(p.host_s for p in parts)])
