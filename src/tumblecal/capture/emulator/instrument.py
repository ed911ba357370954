"""A running virtual instrument: device time follows the host's clock, faults occur, the head is turned."""

import contextlib
import json
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tumblecal.capture.emulator.climate import Climate
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.virtual_port import VirtualPort
from tumblecal.ground.atomic import write_text


_TICK_S = 0.004
_LONGEST_STEP_S, _STALLS_S = 0.25, (0.02, 0.4)
_FRAME_BYTES = 38

# Called at every tick with the device; may turn the head, knock it, or return False to end.
Operator = Callable[[VirtualDevice], bool]


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
        self._unplugs = sorted(self.faults.unplug_at_s)
        self._replug_s = self._held_until_s = 0.0
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
            self._serve(self.chamber_port, device.climate)
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

    def _serve(self, port: VirtualPort, climate: Climate) -> None:
        """Obey the commands that a chamber of SCPI has received; to others there is no answer."""
        *lines, self._commands = (self._commands + port.read()).replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            match line.decode(errors="replace").upper().split():
                case ["*IDN?"]:
                    port.write(b"tumblecal,virtual chamber,0,1\r\n")
                case ["MEAS:TEMP?"]:
                    port.write(f"{climate.air_degc:.2f}\r\n".encode())
                case ["SOUR:TEMP:SPO?"]:
                    port.write(f"{climate.set_point_degc:.2f}\r\n".encode())
                case ["SOUR:TEMP:SPO", number]:
                    with contextlib.suppress(ValueError):
                        climate.set_temperature(float(number))
