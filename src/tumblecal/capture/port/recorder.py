"""The recorder: its own small process between the port and the raw log.

It stamps the bytes that it reads and appends them to the log; other processes read them from there. It has no protocol, so
decoding, plotting and estimation cannot stall it. Commands are JSON lines on its input; it reports on its output how much
is safely on the disk. When its input ends (the guide was killed), it finishes cleanly.
"""

import contextlib
import json
import os
import select
import signal
import sys
import time
from pathlib import Path

from tumblecal.capture.log import DiskFull, LogWriter, RecordKind
from tumblecal.capture.port.transport import Port, available
from tumblecal.ground.errors import InputError


POLL_S = 0.01
_SYNC_S = 1.0
_ANCHOR_S = 60.0
_SILENCE_S = 1.0
_CLOCK_JUMP_S = 0.5
_REOPEN_LONGEST_S = 0.5
_PREDECESSOR_S = 5.0
CANNOT_RECORD, DISK_FULL, DISK_FAILED = 2, 3, 4


def clocks() -> dict[str, int]:
    """The three clocks at one moment: stamps are monotonic, the others give the date."""
    return {
        "monotonic_ns": time.monotonic_ns(),
        "wall_ns": time.time_ns(),
        "boot_ns": time.clock_gettime_ns(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else 0,
    }


def tell(**content: object) -> None:
    """Write one JSON line to the parent process, which may have ended."""
    with contextlib.suppress(OSError):
        os.write(1, (json.dumps(content) + "\n").encode())


class Recorder:
    """Records a port into a log until it receives a stop command.

    **Arguments:**

    - `log`: the log.
    - `url`, `baud`: the port.
    """

    def __init__(self, log: LogWriter, url: str, baud: int):
        self._log, self._url, self._baud = log, url, baud
        self._port: Port | None = None
        self._identity = None
        self._last_byte_ns = time.monotonic_ns()
        self._silent = False
        self._lost_at_ns = 0
        self._next_try_ns = 0
        self._pause_s = 0.02
        self._anchor = clocks()
        self._commands = b""
        self._ending = False

    def event(self, what: str, **content: object) -> None:
        """Write an event to the log and onto the disk."""
        self._log.append_json(RecordKind.EVENT, {"event": what, **content}, time.monotonic_ns())

    def run(self) -> None:
        """Record until the input ends or contains the stop command."""
        self.event(
            "started",
            pid=os.getpid(),
            cut_bytes=self._log.cut,
            boot_id=_boot_id(),
            url=self._url,
            baud=self._baud,
            **self._anchor,
        )
        self._port = Port(self._url, self._baud)
        self._identity = self._port.identity
        self.event("opened", identity=self._identity.as_dict(), line_errors=self._port.line_errors())
        tell(opened=self._url)
        next_sync = time.monotonic()
        while self._obey():
            self._take()
            if time.monotonic() >= next_sync:
                self._log.sync()
                self._log.check()
                tell(synced=self._log.position)
                next_sync = time.monotonic() + _SYNC_S
                self._watch_clocks()
            time.sleep(POLL_S)
        self._take()
        self.event("stopped", line_errors=self._port.line_errors() if self._port else None, **clocks())
        if self._port:
            # The port is closed before the log is released: the next process with the log finds the port free.
            self._port.close()
        tell(synced=self._log.position)

    def end(self, *_: object) -> None:
        """Finish cleanly (a signal handler)."""
        self._ending = True

    def _take(self) -> None:
        if self._port is None:
            self._try_reopen()
            return
        try:
            data = self._port.read()
        except OSError as error:
            self._lose(str(error))
            return
        now = time.monotonic_ns()
        if data:
            self._log.append(RecordKind.BYTES, data, now)
            if self._silent:
                self.event("data_again", after_s=(now - self._last_byte_ns) * 1e-9)
            self._last_byte_ns, self._silent = now, False
        elif not self._silent and now - self._last_byte_ns > _SILENCE_S * 1e9:
            self._silent = True
            self.event("silence", since_s=_SILENCE_S)

    def _lose(self, why: str) -> None:
        assert self._port is not None
        self._port.close()
        self._port = None
        self._lost_at_ns = self._next_try_ns = time.monotonic_ns()
        self._pause_s = 0.02
        self.event("port_lost", why=why)

    def _try_reopen(self) -> None:
        now = time.monotonic_ns()
        if now < self._next_try_ns:
            return
        self._pause_s = min(self._pause_s * 1.5, _REOPEN_LONGEST_S)
        self._next_try_ns = now + int(self._pause_s * 1e9)
        try:
            port = Port(self._url_now(), self._baud)
        except InputError:
            return
        assert self._identity is not None
        if not self._identity.same_unit(port.identity):
            port.close()
            self.event("other_device", identity=port.identity.as_dict())
            self._next_try_ns = now + int(2e9)
            return
        self._port = port
        self._last_byte_ns = now
        self.event("reopened", gap_s=(now - self._lost_at_ns) * 1e-9, identity=port.identity.as_dict())

    def _url_now(self) -> str:
        """The present path of the same USB unit: its name may have changed when it was plugged in again."""
        assert self._identity is not None
        if self._identity.vendor is not None:
            for found in available():
                if self._identity.same_unit(found):
                    return found.url
        return self._url

    def _obey(self) -> bool:
        """Execute commands of the parent; False after a stop command, the end of the parent, or a signal."""
        if self._ending:
            return False
        while select.select([0], [], [], 0)[0]:
            data = os.read(0, 65536)
            if not data:
                return False
            *lines, self._commands = (self._commands + data).split(b"\n")
            for line in lines:
                command = json.loads(line)
                if command.get("stop"):
                    return False
                if "send" in command:
                    self._send(bytes.fromhex(command["send"]))
        return True

    def _send(self, data: bytes) -> None:
        if self._port is None:
            return
        try:
            self._port.write(data)
        except OSError as error:
            self._lose(str(error))
            return
        self.event("sent", data=data.hex())

    def _watch_clocks(self) -> None:
        now = clocks()
        monotonic = now["monotonic_ns"] - self._anchor["monotonic_ns"]
        jump = now["wall_ns"] - self._anchor["wall_ns"] - monotonic
        asleep = now["boot_ns"] - self._anchor["boot_ns"] - monotonic
        if abs(asleep) > _CLOCK_JUMP_S * 1e9:
            self.event("suspended", seconds=asleep * 1e-9, **now)
            self._anchor = now
        elif abs(jump) > _CLOCK_JUMP_S * 1e9:
            self.event("clock_jump", seconds=jump * 1e-9, **now)
            self._anchor = now
        elif monotonic > _ANCHOR_S * 1e9:
            self.event("anchor", **now)
            self._anchor = now


def _boot_id() -> str:
    path = Path("/proc/sys/kernel/random/boot_id")
    return path.read_text().strip() if path.exists() else ""


def main(path: str, url: str, baud: str) -> int:
    """Record `url` into the log `path`; the exit code gives the reason for the end."""
    # The guide handles Ctrl-C and a closed terminal: it sends the stop command.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        log = LogWriter(Path(path), _PREDECESSOR_S)
    except InputError as error:
        tell(error=error.faults[0])
        return CANNOT_RECORD
    try:
        recorder = Recorder(log, url, int(baud))
        signal.signal(signal.SIGTERM, recorder.end)
        recorder.run()
    except InputError as error:
        with contextlib.suppress(OSError):
            log.sync()
        tell(error=error.faults[0])
        return CANNOT_RECORD
    except DiskFull:
        with contextlib.suppress(OSError):
            log.sync()
        tell(error=f"{path}: the disk is full; recording stopped, all data before are stored. Make room, then --resume")
        return DISK_FULL
    except OSError as error:
        tell(error=f"{path}: the disk failed ({error.strerror}); recording stopped. Check the disk, then --resume")
        return DISK_FAILED
    log.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:4]))
