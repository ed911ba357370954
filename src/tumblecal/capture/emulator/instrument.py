"""A running virtual instrument: device time follows the host's clock, faults occur, the head is turned."""

import json
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tumblecal.capture.emulator.chamber_port import ChamberPort
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.virtual_port import VirtualPort
from tumblecal.ground.atomic import write_text


_TICK_S = 0.004
_LONGEST_STEP_S = 0.25

# Called at every tick with the device; may turn the head, knock it, or return False to end.
Operator = Callable[[VirtualDevice], bool]


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

    device: VirtualDevice
    port: VirtualPort

    def __init__(
        self,
        device: VirtualDevice,
        link: Path,
        speed: float = 1.0,
        operator: Operator | None = None,
        ledger: Path | None = None,
        chamber_link: Path | None = None,
    ):
        self.device, config = device, device.config
        self.port = VirtualPort(link)
        self._chamber_port = None if chamber_link is None else ChamberPort(device.chamber, chamber_link)
        self._config, self._speed, self._operator, self._ledger = config, speed, operator, ledger
        self._random = np.random.default_rng([config.noise.seed, 2])
        self._unplugs = sorted(config.faults.unplug_at_s)
        self._restarts = sorted(config.faults.restart_at_s)
        self._replug_s = 0.0
        self._held_until_s = 0.0
        self._held = b""

    def run(self, seconds: float | None = None) -> None:
        """Run for this many seconds of device time, or until the operator ends it."""
        start, rate = time.monotonic(), self._config.instrument.rate_hz
        next_note = start + 1.0
        try:
            while seconds is None or self.device.time_s < seconds:
                due = int((time.monotonic() - start) * self._speed * rate) - self.device.ledger.generated
                # A late computer sends in pieces, as the device would have done meanwhile.
                count = min(due, math.ceil(_LONGEST_STEP_S * rate))
                self._note_lag(due, due - count)
                self.step(count)
                if self._operator is not None and not self._operator(self.device):
                    break
                if time.monotonic() > next_note:
                    self._note()
                    next_note = time.monotonic() + 1.0
                time.sleep(_TICK_S)
        finally:
            self._note()
            self.port.close()
            if self._chamber_port is not None:
                self._chamber_port.close()

    def step(self, n: int) -> None:
        """Let the device make `n` samples and send them, with the faults in between."""
        self._cable()
        if self._chamber_port is not None:
            self._chamber_port.serve()
        if self.port.plugged:
            self.device.command(self.port.read())
        data = self.device.advance(n)
        if not self.port.plugged:
            return
        data = self._stalled(data, n)
        overrun = self.port.write(data)
        if overrun:
            self.device.ledger.overrun += overrun // 38 + 1

    def _cable(self) -> None:
        now = self.device.time_s
        if self._restarts and now >= self._restarts[0]:
            self._restarts.pop(0)
            self.device.restart()
        if self._unplugs and now >= self._unplugs[0] and self.port.plugged:
            self._unplugs.pop(0)
            self.port.unplug()
            self._held = b""
            self.device.plugged = False
            self._replug_s = now + self._config.faults.unplug_for_s
        elif not self.port.plugged and now >= self._replug_s:
            self.port.plug()
            self.device.plugged = True

    def _stalled(self, data: bytes, n: int) -> bytes:
        """Delay the bytes occasionally and send them late: nothing is lost."""
        faults, now = self._config.faults, self.device.time_s
        if now < self._held_until_s:
            self._held += data
            return b""
        if faults.stalls_per_s and self._random.random() < faults.stalls_per_s * n / self._config.instrument.rate_hz:
            self._held_until_s = now + self._random.uniform(0.02, faults.stall_longest_s)
            self.device.ledger.stalls += 1
        data, self._held = self._held + data, b""
        return data

    def _note_lag(self, due: int, remaining: int) -> None:
        """Number of samples due now, and number remaining after this step."""
        ledger, rate = self.device.ledger, self._config.instrument.rate_hz
        ledger.latest_ms = max(ledger.latest_ms, 1e3 * due / rate / self._speed)
        ledger.behind_s = remaining / rate
        ledger.longest_behind_s = max(ledger.longest_behind_s, ledger.behind_s)

    def _note(self) -> None:
        if self._ledger is not None:
            content = self.device.ledger.as_dict() | {"lost": self.device.ledger.lost(), "time_s": self.device.time_s}
            write_text(self._ledger, json.dumps(content, indent=1) + "\n")
