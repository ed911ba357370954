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


class ChamberPort:
    """Answers `MEAS:TEMP?`, `SOUR:TEMP:SPO?` and `*IDN?`, and obeys `SOUR:TEMP:SPO 40.0`; other commands get no answer.

    **Arguments:**

    - `climate`: the chamber. `link`: name of the port.
    """

    def __init__(self, climate: Climate, link: Path):
        self._climate, self.port, self._input = climate, VirtualPort(link), b""

    def serve(self) -> None:
        """Obey the commands that have arrived."""
        *lines, self._input = (self._input + self.port.read()).replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            answer = ""
            match line.decode(errors="replace").upper().split():
                case ["*IDN?"]:
                    answer = "tumblecal,virtual chamber,0,1"
                case ["MEAS:TEMP?"]:
                    answer = f"{self._climate.air_degc:.2f}"
                case ["SOUR:TEMP:SPO?"]:
                    answer = f"{self._climate.set_point_degc:.2f}"
                case ["SOUR:TEMP:SPO", number]:
                    with contextlib.suppress(ValueError):
                        self._climate.set_temperature(float(number))
            if answer:
                self.port.write(f"{answer}\r\n".encode())


class VirtualInstrument:
    """Device, cable and clock together.

    **Arguments:**

    - `device`: the device, with its noise and faults.
    - `link`: name of the port.
    - `speed`: device seconds per second.
    - `operator`: turns the head; None for no turns.
    - `ledger`: file for the true events, written once a second and at the end.
    - `chamber_link`: name of the chamber's port; None for a chamber that only the operator sets.
    """

    def __init__(
        self,
        device: VirtualDevice,
        link: Path,
        speed: float = 1.0,
        operator: Operator | None = None,
        ledger: Path | None = None,
        chamber_link: Path | None = None,
    ):
        self.device, self.port, self.faults = device, VirtualPort(link), device.config.faults
        self._chamber = None if chamber_link is None else ChamberPort(device.climate, chamber_link)
        self._speed, self._operator, self._ledger = speed, operator or (lambda device: True), ledger
        self._random = np.random.default_rng([device.config.noise.seed, 2])
        self._unplugs = sorted(self.faults.unplug_at_s)
        self._replug_s = self._held_until_s = 0.0
        self._held = b""

    def run(self, seconds: float = math.inf) -> None:
        """Run for this many seconds of device time, or until the operator ends it."""
        ledger, rate_hz, start = self.device.ledger, self.device.rate_hz, time.monotonic()
        next_note = start + 1.0
        try:
            while self.device.time_s < seconds:
                due = int((time.monotonic() - start) * self._speed * rate_hz) - ledger.generated
                # A late computer sends in pieces, as the device would have done meanwhile.
                count = min(due, math.ceil(_LONGEST_STEP_S * rate_hz))
                ledger.behind_s = (due - count) / rate_hz
                ledger.longest_behind_s = max(ledger.longest_behind_s, ledger.behind_s)
                self.step(count)
                if not self._operator(self.device):
                    break
                if time.monotonic() > next_note:
                    self._note()
                    next_note = time.monotonic() + 1.0
                time.sleep(_TICK_S)
        finally:
            self._note()
            self.port.unplug()
            if self._chamber is not None:
                self._chamber.port.unplug()

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
        if self._chamber is not None:
            self._chamber.serve()
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

    def _note(self) -> None:
        if self._ledger is not None:
            content = self.device.ledger.as_dict() | {"time_s": self.device.time_s}
            write_text(self._ledger, json.dumps(content, indent=1) + "\n")
