"""The recorder: its own small process between the port and the raw log.

It stamps the bytes that it reads and appends them to the log; other processes read them from there. It has no protocol, so
decoding, plotting and estimation cannot stall it. Its input has commands to the device, a line of hexadecimal digits each; when
the input ends (also because the guide was killed), it finishes cleanly. Its output is the reason for which it ended by itself.
"""

import contextlib
import os
import signal
import sys
import time
from pathlib import Path

from tumblecal.capture.log import LogWriter, RecordKind
from tumblecal.capture.port.transport import Port, available
from tumblecal.ground.errors import InputError


FAILED = 2
_POLL_S, _SYNC_S, _ANCHOR_S, _SILENCE_S, _CLOCK_JUMP_S = 0.01, 1.0, 60.0, 1.0, 0.5
_REOPEN_S, _OTHER_DEVICE_S, _PREDECESSOR_S = 0.1, 2.0, 5.0


def clocks() -> dict[str, int]:
    """The three clocks at one moment: stamps are monotonic, the others give the date."""
    return {
        "monotonic_ns": time.monotonic_ns(),
        "wall_ns": time.time_ns(),
        "boot_ns": time.clock_gettime_ns(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else 0,
    }


class Recorder:
    """Records a port into a log until its input ends, or a signal comes.

    **Arguments:**

    - `log`: the log.
    - `url`, `baud`: the port.
    """

    def __init__(self, log: LogWriter, url: str, baud: int):
        self._log, self._url, self._baud, self._anchor = log, url, baud, clocks()
        boot = Path("/proc/sys/kernel/random/boot_id")
        boot_id = boot.read_text().strip() if boot.exists() else ""
        self.event("started", pid=os.getpid(), cut_bytes=log.cut, boot_id=boot_id, url=url, baud=baud, **self._anchor)
        self._port: Port | None = Port(url, baud)
        self._identity = self._port.identity
        self.event("opened", identity=vars(self._identity))
        self._last_byte_s = self._lost_at_s = self._next_try_s = time.monotonic()
        self._silent = self._ending = False
        self._commands = b""

    def event(self, what: str, **content: object) -> None:
        """Write an event to the log and onto the disk."""
        self._log.append_json(RecordKind.EVENT, {"event": what, **content}, time.monotonic_ns())

    def run(self) -> None:
        """Record until the end."""
        next_sync = time.monotonic()
        while self._obey():
            self._take()
            if time.monotonic() >= next_sync:
                self._log.sync()
                self._log.check()
                next_sync = time.monotonic() + _SYNC_S
                self._watch_clocks()
            time.sleep(_POLL_S)
        self._take()
        self.event("stopped", **clocks())
        if self._port:
            # The port is closed before the log is released: the next process with the log finds the port free.
            self._port.close()

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
            self._lose(self._port, str(error))
            return
        stamp_ns = time.monotonic_ns()
        silent_s = stamp_ns * 1e-9 - self._last_byte_s
        if data:
            self._log.append(RecordKind.BYTES, data, stamp_ns)
            if self._silent:
                self.event("data_again", after_s=silent_s)
            self._last_byte_s, self._silent = stamp_ns * 1e-9, False
        elif not self._silent and silent_s > _SILENCE_S:
            self._silent = True
            self.event("silence", since_s=_SILENCE_S)

    def _lose(self, port: Port, why: str) -> None:
        port.close()
        self._port = None
        self._lost_at_s = self._next_try_s = time.monotonic()
        self.event("port_lost", why=why)

    def _try_reopen(self) -> None:
        """Open the same USB unit again: its name may have changed when it was plugged in again."""
        now = time.monotonic()
        if now < self._next_try_s:
            return
        self._next_try_s = now + _REOPEN_S
        units = available() if self._identity.vendor is not None else []
        try:
            port = Port(next((unit.url for unit in units if self._identity.same_unit(unit)), self._url), self._baud)
        except InputError:
            return
        if self._identity.same_unit(port.identity):
            self._port, self._last_byte_s = port, now
            self.event("reopened", gap_s=now - self._lost_at_s, identity=vars(port.identity))
        else:
            port.close()
            self.event("other_device", identity=vars(port.identity))
            self._next_try_s = now + _OTHER_DEVICE_S

    def _obey(self) -> bool:
        """Send commands of the parent to the device; False after the end of the input, or a signal."""
        with contextlib.suppress(BlockingIOError):
            data = os.read(0, 65536)
            self._ending |= not data
            *lines, self._commands = (self._commands + data).split(b"\n")
            for line in lines:
                if port := self._port:
                    try:
                        port.write(bytes.fromhex(line.decode()))
                        self.event("sent", data=line.decode())
                    except OSError as error:
                        self._lose(port, str(error))
        return not self._ending

    def _watch_clocks(self) -> None:
        now = clocks()
        passed = {name: (now[name] - self._anchor[name]) * 1e-9 for name in now}
        asleep, jump = (passed[name] - passed["monotonic_ns"] for name in ("boot_ns", "wall_ns"))
        if abs(asleep) > _CLOCK_JUMP_S:
            self.event("suspended", seconds=asleep, **now)
        elif abs(jump) > _CLOCK_JUMP_S:
            self.event("clock_jump", seconds=jump, **now)
        elif passed["monotonic_ns"] > _ANCHOR_S:
            self.event("anchor", **now)
        else:
            return
        self._anchor = now


def main(path: str, url: str, baud: str) -> int:
    """Record `url` into the log `path`; the parent reads the reason for an early end."""
    # The guide handles Ctrl-C and a closed terminal: it ends the input.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    os.set_blocking(0, False)
    try:
        with contextlib.closing(LogWriter(Path(path), _PREDECESSOR_S)) as log:
            recorder = Recorder(log, url, int(baud))
            signal.signal(signal.SIGTERM, recorder.end)
            recorder.run()
        return 0
    except InputError as error:
        with contextlib.suppress(OSError):  # the parent may have ended
            print(error.faults[0], flush=True)
        return FAILED


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:4]))
