"""A running virtual instrument behind pseudo-terminals: device time follows the host's clock, and faults occur."""

import contextlib
import json
import math
import os
import time
import tty
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError


_TICK_S, _LONGEST_STEP_S, _STALLS_S = 0.004, 0.25, (0.02, 0.4)
_FRAME_BYTES = 38
# Size of a real driver's buffer; bytes that do not fit are lost, as in reality.
_BUFFER_BYTES, _UNREAD_S = 1 << 20, 1.0

# Called at every tick with the device; may turn the head, knock it, or return False to end.
Operator = Callable[[VirtualDevice], bool]


class VirtualPort:
    """The virtual cable: a pseudo-terminal with a fixed name `link`, which can be unplugged and plugged in again.

    **Arguments:**

    - `link`: a name in the file system; created, and moved when the port is plugged in again.

    **Raises:** `InputError` if `link` is a different file already.
    """

    def __init__(self, link: Path):
        if link.exists() and not link.is_symlink():
            raise InputError(f"{link}: exists and is not a virtual port; give another name")
        self.link, self._waiting, self._read_at = link, bytearray(), time.monotonic()
        self.plug()

    def plug(self) -> None:
        """Make the pseudo-terminal and point the name at it."""
        self._ends = os.openpty()
        self.plugged = True
        tty.setraw(self._ends[1])
        os.set_blocking(self._ends[0], False)
        try:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(os.ttyname(self._ends[1]))
        except OSError as error:
            raise InputError(f"{self.link}: cannot be made ({error.strerror}); give another name") from error

    def unplug(self) -> None:
        """Unplug the cable, if it is plugged in: the name is removed, and readers get an error."""
        if self.plugged:
            self.plugged = False
            self.link.unlink(missing_ok=True)
            self._waiting.clear()
            for descriptor in self._ends:
                os.close(descriptor)

    def write(self, data: bytes) -> int:
        """Send the bytes that the terminal accepts now, and store the rest; returns the number of bytes that did not fit."""
        if self._waiting and time.monotonic() - self._read_at > _UNREAD_S:
            # Without a reader, a port stores nothing for a later one.
            self._waiting.clear()
        overrun = max(0, len(self._waiting) + len(data) - _BUFFER_BYTES)
        self._waiting += data[: len(data) - overrun]
        with contextlib.suppress(BlockingIOError):
            while self._waiting:
                del self._waiting[: os.write(self._ends[0], self._waiting[:65536])]
                self._read_at = time.monotonic()
        return overrun

    def read(self) -> bytes:
        """The commands sent to the device."""
        with contextlib.suppress(OSError):
            return os.read(self._ends[0], 4096)
        return b""


class VirtualInstrument:
    """Device, cable and clock together.

    **Arguments:**

    - `device`: the device, with its noise and faults.
    - `link`: name of the port.
    - `speed`: device seconds per second.
    - `operator`: turns the head; None for no turns.
    - `ledger`: file for the true events, written at the end.
    - `chamber_link`: name of the chamber's port; None for a chamber that only the operator sets.
    """

    def __init__(
        self,
        device: VirtualDevice,
        link: Path,
        speed: float = 1.0,
        operator: Operator = lambda device: True,
        ledger: Path | None = None,
        chamber_link: Path | None = None,
    ):
        self.device, self.port, self.faults = device, VirtualPort(link), device.config.faults
        self.chamber_port = None if chamber_link is None else VirtualPort(chamber_link)
        self._speed, self._operator, self._ledger = speed, operator, ledger
        self._random = np.random.default_rng([device.config.noise.seed, 2])
        self._unplugs, self._replug_s, self._held_until_s = sorted(self.faults.unplug_at_s), 0.0, 0.0
        self._held = self._commands = b""

    def run(self, seconds: float = math.inf) -> None:
        """Run for this many seconds of device time, or until the operator ends it."""
        ledger, rate_hz, start_s = self.device.ledger, self.device.rate_hz, time.monotonic()
        try:
            while self.device.time_s < seconds and self._operator(self.device):
                due = int((time.monotonic() - start_s) * self._speed * rate_hz) - ledger.generated
                # A late computer sends in pieces, as the device would have done meanwhile.
                count = min(due, math.ceil(_LONGEST_STEP_S * rate_hz))
                ledger.behind_s = (due - count) / rate_hz
                ledger.longest_behind_s = max(ledger.longest_behind_s, ledger.behind_s)
                self.step(count)
                time.sleep(_TICK_S)
        finally:
            if self._ledger is not None:
                write_text(self._ledger, json.dumps(ledger.as_dict() | {"time_s": self.device.time_s}, indent=1) + "\n")
            for port in filter(None, (self.port, self.chamber_port)):
                port.unplug()

    def step(self, n: int) -> None:
        """Let the device make `n` samples and send them, with the faults in between."""
        device, now_s = self.device, self.device.time_s
        if not self.port.plugged and now_s >= self._replug_s:
            self.port.plug()
        elif self._unplugs and now_s >= self._unplugs[0]:
            self._replug_s = self._unplugs.pop(0) + self.faults.unplug_for_s
            self.port.unplug()
            self._held = b""
        device.plugged = self.port.plugged
        if self.chamber_port is not None:
            self._serve(self.chamber_port)
        if device.plugged:
            device.command(self.port.read())
        self._held += device.advance(n)
        # A stall delays the bytes: nothing is lost.
        if self._random.random() < self.faults.stalls_per_s * n / device.rate_hz:
            self._held_until_s = now_s + self._random.uniform(*_STALLS_S)
            device.ledger.stalls += 1
        if device.plugged and now_s >= self._held_until_s:
            overrun, self._held = self.port.write(self._held), b""
            device.ledger.overrun += math.ceil(overrun / _FRAME_BYTES)

    def _serve(self, port: VirtualPort) -> None:
        """Obey the commands that a chamber of SCPI has received; to others there is no answer."""
        *lines, self._commands = (self._commands + port.read()).replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            match line.decode(errors="replace").upper().split():
                case ["*IDN?"]:
                    port.write(b"tumblecal,virtual chamber,0,1\r\n")
                case ["MEAS:TEMP?"]:
                    port.write(f"{self.device.air_degc:.2f}\r\n".encode())
                case ["SOUR:TEMP:SPO?"]:
                    port.write(f"{self.device.set_point_degc:.2f}\r\n".encode())
                case ["SOUR:TEMP:SPO", number]:
                    with contextlib.suppress(ValueError):
                        self.device.set_temperature(float(number))
