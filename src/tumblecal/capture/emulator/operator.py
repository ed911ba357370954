"""Operators of the virtual head: typed commands, or an operator who follows the prompts in a capture's journal."""

import math
import os
import select
import sys
from contextlib import suppress
from pathlib import Path

from tumblecal.capture.capture_plan import OPERATOR
from tumblecal.capture.decoding.samples import Entry
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.journal import JOURNAL_NAME
from tumblecal.capture.log import LogReader


# Time after a turn until the recording must have begun, s.
_PATIENCE_S = 60.0


class Typist:
    """Turns the head when `ALPHA BETA` is typed, and sets the chamber with `chamber DEGC`; `knock` bumps the head, `restart`
    restarts the device, `quit` ends."""

    def __init__(self) -> None:
        self._text = ""

    def __call__(self, device: VirtualDevice) -> bool:
        """Execute the commands typed since the last call; False to end."""
        if select.select([sys.stdin], [], [], 0)[0]:
            with suppress(OSError):  # the terminal is closed
                self._text += os.read(sys.stdin.fileno(), 4096).decode(errors="replace")
        *lines, self._text = self._text.split("\n")
        for words in filter(None, map(str.split, lines)):
            try:
                match words:
                    case ["quit" | "q"]:
                        return False
                    case ["knock"]:
                        device.knock()
                    case ["restart"]:
                        device.restart()
                    case ["chamber", degc]:
                        device.set_temperature(float(degc))
                        print(f"chamber set to {device.set_point_degc:g} degC", flush=True)
                    case _:
                        alpha, beta = map(float, words)
                        device.turn(alpha, beta)
                        print(f"turning to alpha {alpha:g}, beta {beta:g}", flush=True)
            except ValueError:
                print("type ALPHA BETA (degrees), chamber DEGC, knock, restart or quit", flush=True)
        return True


class Follower:
    """Reads the journal of a capture, turns the head to the prompted positions, with the configured mistakes, and sets the
    chamber to the requested temperatures. Until a recording begins, the turn is repeated: its samples may be lost.

    **Arguments:**

    - `folder`: the capture's folder, which need not exist yet.
    - `config`: reaction time and mistakes.
    """

    def __init__(self, folder: Path, config: Emulation):
        self._path, self._reaction_s = folder / JOURNAL_NAME, config.head.reaction_s
        self._mistakes = {mistake.at: mistake for mistake in config.mistake}
        self._reader: LogReader | None = None
        # Number of prompts, angles of the last one and of the next turn, and the time of this turn, s.
        self._prompts, self._turn_s = 0, math.inf
        self._target = self._goal = (0.0, 0.0)

    def __call__(self, device: VirtualDevice) -> bool:
        """Execute the due actions; False when the capture has finished."""
        # The folder of a failed capture may be deleted and created again.
        with suppress(OSError):
            if self._reader is None or not os.path.samestat(os.stat(self._path), self._reader.stat()):
                if self._reader is not None:
                    self._reader.close()
                self._reader = LogReader(self._path)
        for record in self._reader.records() if self._reader is not None else ():
            entry = record.content()
            if entry["entry"] == "finished":
                return False
            self._hear(entry, device)
        if device.time_s >= self._turn_s:
            device.turn(*self._goal)
            self._turn_s = device.time_s + _PATIENCE_S
        return True

    def _hear(self, entry: Entry, device: VirtualDevice) -> None:
        """React to an entry of the journal."""
        due_s = device.time_s + self._reaction_s
        match entry["entry"]:
            case "session":
                self._prompts, self._turn_s = 0, math.inf
            case "recording":
                self._turn_s = math.inf
            case "prompted":
                self._prompts += 1
                self._target = self._goal = alpha, beta = entry["alpha_deg"], entry["beta_deg"]
                if mistake := self._mistakes.get(self._prompts):
                    self._goal = alpha + mistake.alpha_offset_deg, beta + mistake.beta_offset_deg
                self._turn_s = math.inf if tuple(device.angles()) == self._goal else due_s
            case "wrong_position":
                self._goal, self._turn_s = self._target, due_s
            case "soak" if entry["chamber"] == OPERATOR:
                device.set_temperature(entry["requested_degc"])
