"""The line of the virtual chamber: commands in text on a pseudo-terminal."""

import contextlib
from pathlib import Path

from tumblecal.capture.emulator.climate import VirtualChamber
from tumblecal.capture.emulator.virtual_port import VirtualPort


class ChamberPort:
    """Answers `MEAS:TEMP?`, `SOUR:TEMP:SPO?` and `*IDN?`, and obeys `SOUR:TEMP:SPO 40.0`; other commands get no answer.

    **Arguments:**

    - `chamber`: the chamber. `link`: name of the port.
    """

    def __init__(self, chamber: VirtualChamber, link: Path):
        self._chamber, self._port, self._input = chamber, VirtualPort(link), b""

    def serve(self) -> None:
        """Obey the commands that have arrived."""
        *lines, self._input = (self._input + self._port.read()).replace(b"\r", b"\n").split(b"\n")
        for line in filter(None, lines):
            if answer := self._answer(line.decode(errors="replace").strip().upper()):
                self._port.write(f"{answer}\r\n".encode())

    def _answer(self, command: str) -> str:
        match command.split():
            case ["*IDN?"]:
                return "tumblecal,virtual chamber,0,1"
            case ["MEAS:TEMP?"]:
                return f"{self._chamber.air_degc:.2f}"
            case ["SOUR:TEMP:SPO?"]:
                return f"{self._chamber.set_point_degc:.2f}"
            case ["SOUR:TEMP:SPO", number]:
                with contextlib.suppress(ValueError):
                    self._chamber.set_temperature(float(number))
        return ""

    def close(self) -> None:
        """Remove the port."""
        self._port.close()
