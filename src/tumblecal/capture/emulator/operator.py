"""Operators of the virtual head: typed commands, or an operator who follows the prompts in a capture's journal."""

import contextlib
import math
import os
import select
import sys
from pathlib import Path

from tumblecal.capture.chamber.chamber import OPERATOR
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.journal import JOURNAL_NAME
from tumblecal.capture.log import LogReader, RecordKind


# Time after a turn until the recording must have begun.
_PATIENCE_S = 60.0


class Typist:
    """Turns the head when `ALPHA BETA` is typed, and sets the chamber with `chamber DEGC`; `knock` bumps the head, `restart`
    restarts the device, `quit` ends."""

    def __init__(self) -> None:
        self._text = ""

    def __call__(self, device: VirtualDevice) -> bool:
        """Execute the commands typed since the last call; False to end."""
        if not select.select([sys.stdin], [], [], 0)[0]:
            return True
        data = b""
        with contextlib.suppress(OSError):  # the terminal is closed
            data = os.read(sys.stdin.fileno(), 4096)
        *lines, self._text = (self._text + data.decode(errors="replace")).split("\n")
        return all([self._obey(line.split(), device) for line in lines])

    def _obey(self, words: list[str], device: VirtualDevice) -> bool:
        now = device.time_s
        match words:
            case []:
                return True
            case ["quit" | "q"]:
                return False
            case ["knock"]:
                device.head.knock(now)
            case ["restart"]:
                device.restart()
            case _:
                try:
                    if words[0] == "chamber":
                        (degc,) = (float(w) for w in words[1:])
                        device.chamber.set_temperature(degc)
                        print(f"chamber set to {device.chamber.set_point_degc:g} degC", flush=True)
                        return True
                    alpha, beta = (float(w) for w in words)
                except ValueError:
                    print("type ALPHA BETA (degrees), chamber DEGC, knock, restart or quit", flush=True)
                    return True
                device.head.turn(alpha, beta, now)
                print(f"turning to alpha {alpha:g}, beta {beta:g}", flush=True)
        return True


class Follower:
    """Reads the journal of a capture, turns the head to the prompted positions, with the configured mistakes, and sets the
    chamber to the requested temperatures. If no recording begins, the turn is repeated once: its samples may be lost.

    **Arguments:**

    - `folder`: the capture's folder, which need not exist yet.
    - `config`: reaction time and mistakes.
    """

    def __init__(self, folder: Path, config: Emulation):
        self._path = folder / JOURNAL_NAME
        self._reaction_s = config.head.reaction_s
        self._mistakes = {m.at: m for m in config.mistake}
        self._reader: LogReader | None = None
        self._prompts = 0
        self._due: tuple[float, float, float] | None = None
        self._chamber_due: tuple[float, float] | None = None
        self._target: tuple[float, float] | None = None
        self._again_s = math.inf

    def __call__(self, device: VirtualDevice) -> bool:
        """Execute the due actions; False when the capture has finished."""
        self._open_newest()
        if self._reader is None:
            return True
        now = device.time_s
        for record in self._reader.records():
            if record.kind != RecordKind.JOURNAL:
                continue
            entry = record.content()
            if entry["entry"] == "session":
                self._prompts, self._due, self._chamber_due = 0, None, None
            if entry["entry"] == "finished":
                return False
            if entry["entry"] in ("session", "prompted", "recording"):
                self._again_s = math.inf
            if entry["entry"] == "prompted":
                self._prompts += 1
                self._target = (entry["alpha_deg"], entry["beta_deg"])
                self._due = (now + self._reaction_s, *self._goal())
            if entry["entry"] == "soak" and entry["chamber"] == OPERATOR:
                self._chamber_due = (now + self._reaction_s, entry["requested_degc"])
            if entry["entry"] == "wrong_position" and self._target is not None:
                self._due = (now + self._reaction_s, *self._target)
        if self._due is not None and now >= self._due[0]:
            if device.head.angles(now) != self._due[1:]:
                device.head.turn(*self._due[1:], now)
                self._again_s = now + _PATIENCE_S
            self._due = None
        if now >= self._again_s:
            self._again_s = math.inf
            device.head.turn(*device.head.angles(now), now)
        if self._chamber_due is not None and now >= self._chamber_due[0]:
            device.chamber.set_temperature(self._chamber_due[1])
            self._chamber_due = None
        return True

    def _open_newest(self) -> None:
        """The present journal: the folder of a failed capture may be deleted and created again."""
        try:
            newest = os.stat(self._path)
            if self._reader is None or not os.path.samestat(newest, self._reader.stat()):
                fresh = LogReader(self._path)
                if self._reader is not None:
                    self._reader.close()
                self._reader = fresh
        except OSError:
            return

    def _goal(self) -> tuple[float, float]:
        assert self._target is not None
        mistake = self._mistakes.get(self._prompts)
        if mistake is None:
            return self._target
        return self._target[0] + mistake.alpha_offset_deg, self._target[1] + mistake.beta_offset_deg
