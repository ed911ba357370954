"""A temperature chamber on a serial line (or a socket) with commands in text, such as those of SCPI."""

import math
import re
import time

from tumblecal.capture.capture_plan import ChamberTable
from tumblecal.capture.port.transport import Port
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


_TRIES, _POLL_S = 3, 0.01
_TERMINATORS = {"LF": "\n", "CR": "\r", "CRLF": "\r\n"}
# Answers outside are no temperature of a chamber, degC.
_LOWEST_DEGC, _HIGHEST_DEGC = -200.0, 400.0
_SET_WITHIN_DEGC = 0.11
_DEGC = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:(?:deg|°)?\s*C)?", re.IGNORECASE)


class Chamber:
    """A chamber with commands in text; its port is opened again after a fault.

    The public methods are called in a thread, one at a time, so they may wait. They raise `InputError` in one line if the
    chamber does not answer or accept a temperature.

    **Arguments:**

    - `table`: port and commands. The `name`, in the journal and in messages, is that of the port.
    """

    def __init__(self, table: ChamberTable):
        self.name, self._table = table.url, table
        self._port: Port | None = None

    def set_temperature(self, degc: float) -> None:
        """Request a temperature; the set point is read back if the table has a command for it."""
        table, command = self._table, self._table.set.format(float(degc))
        self._exchange(command)
        stated = self._exchange(table.set_query, table.set_query_field) if table.set_query else degc
        if abs(stated - degc) > _SET_WITHIN_DEGC:
            raise InputError(
                f"chamber {self.name}: the set point is {stated:g} degC after {command!r}: correct its limits, or chamber.set "
                "of the plan"
            )

    def temperature(self) -> float | None:
        """The temperature of the chamber, degC; None, for a chamber of the user's, without a thermometer."""
        return self._exchange(self._table.query, self._table.query_field)

    def close(self) -> None:
        """Release the port; the temperature remains set."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _exchange(self, command: str, field: int = 0) -> float:
        """Send a command, and return the number at a field (from 1) of a line of the answer; NaN for a command without one."""
        try:
            if self._port is None:
                self._port = Port(self.name, self._table.baud)
                for first in self._table.start:
                    self._answer(self._port, first, 0)
            return self._answer(self._port, command, field)
        except (InputError, OSError) as error:
            self.close()
            words = f"the line is interrupted ({error}); check cable and power" if isinstance(error, OSError) else error
            raise InputError(f"chamber {self.name}: {words}") from error

    def _answer(self, port: Port, query: str, field: int) -> float:
        """The number in the answer to a query, which is repeated twice if there is none; NaN without a field."""
        seen = ""
        for _ in range(_TRIES):
            # Answers to earlier commands are discarded.
            port.read()
            port.write((query + _TERMINATORS[self._table.terminator]).encode())
            if not field:
                return math.nan
            answer, late, late_s = b"", False, time.monotonic() + self._table.timeout_s
            while not late:
                time.sleep(_POLL_S)
                answer += port.read()
                late = time.monotonic() >= late_s
                lines = re.split(r"[\r\n]+", answer.decode(errors="replace"))
                # The last line is unfinished, unless no more comes.
                for line in filter(None, map(str.strip, lines if late else lines[:-1])):
                    fields = re.split(r"[,;]|\s+(?=[-+.\d])", line)
                    number = _DEGC.fullmatch(fields[field - 1].strip()) if len(fields) >= field else None
                    if number and _LOWEST_DEGC <= float(number[1]) <= _HIGHEST_DEGC:
                        return float(number[1])
                    seen = line
        raise InputError(
            f"{query!r}, asked {_TRIES} times, {shown(seen) if seen else 'nothing'} came: no temperature in degC at field "
            f"{field}; check cable, baud rate ({self._table.baud}), terminator and query, and set the controller to degC"
        )
