"""A chamber on a serial line (or a socket) that understands commands in text, such as those of SCPI."""

import re
import time
from collections.abc import Iterator

from tumblecal.capture.chamber.chamber_tables import ChamberTable
from tumblecal.capture.port.transport import Port
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


_TRIES = 3
_TERMINATORS = {"LF": "\n", "CR": "\r", "CRLF": "\r\n"}
_POLL_S = 0.01
# Answers outside are no temperature of a chamber, degC.
_LOWEST_DEGC, _HIGHEST_DEGC = -200.0, 400.0
_SET_WITHIN_DEGC = 0.11
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:(?:deg|°)?\s*([CFK]))?", re.IGNORECASE)


class TextChamber:
    """A chamber with commands in text.

    **Arguments:**

    - `table`: port and commands.

    **Raises:** `InputError` if the port cannot be opened.
    """

    def __init__(self, table: ChamberTable):
        self._table = table
        self._port: Port | None = None
        self._open()

    @property
    def name(self) -> str:
        """The port."""
        return self._table.url

    def set_temperature(self, degc: float) -> None:
        """Request a temperature; the set point is read back if the table has a command for it.

        **Raises:** `InputError` if the chamber is not connected or does not accept the set point.
        """
        table = self._table
        command = table.set.format(float(degc))
        self._send(command)
        if not table.set_query:
            return
        stated = self._asked(table.set_query, table.set_query_field)
        if abs(stated - degc) > _SET_WITHIN_DEGC:
            raise InputError(
                f"chamber {self.name}: the set point is {stated:g} degC after {command!r}: correct its limits, or chamber.set "
                "of the plan"
            )

    def temperature(self) -> float:
        """The temperature of the chamber, degC.

        **Raises:** `InputError` if it does not answer, or not with a temperature.
        """
        return self._asked(self._table.query, self._table.query_field)

    def close(self) -> None:
        """Release the port."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _open(self) -> Port:
        if self._port is None:
            try:
                self._port = Port(self._table.url, self._table.baud)
            except InputError as error:
                raise InputError(f"chamber: {error}") from error
            for command in self._table.start:
                self._send(command)
        return self._port

    def _send(self, command: str) -> None:
        """Send a command; answers to earlier ones are discarded."""
        port = self._open()
        try:
            port.read()
            port.write((command + _TERMINATORS[self._table.terminator]).encode())
        except OSError as error:
            self.close()
            raise InputError(
                f"chamber {self.name}: the line is interrupted ({error}); check its cable and power"
            ) from error

    def _asked(self, query: str, field: int) -> float:
        """The number in the answer to a query, which is repeated twice if there is none."""
        seen = ""
        for _ in range(_TRIES):
            self._send(query)
            for line in self._lines():
                value, seen = _temperature_in(line, field), line
                if value is not None:
                    return value
        about = f"chamber {self.name}: {query!r}, asked {_TRIES} times:"
        if not seen:
            raise InputError(
                f"{about} no answer in {self._table.timeout_s:g} s; check cable, baud rate ({self._table.baud}) and terminator"
            )
        raise InputError(
            f"{about} the answer {shown(seen)} has no temperature in degC at field {field}; set the controller to degC, "
            "or correct chamber.query and query_field of the plan"
        )

    def _lines(self) -> Iterator[str]:
        """The lines of an answer until the timeout; an unfinished line at the end."""
        port, rest = self._open(), b""
        deadline = time.monotonic() + self._table.timeout_s
        try:
            while time.monotonic() < deadline:
                rest += port.read()
                *whole, rest = re.split(rb"[\r\n]+", rest)
                for line in whole:
                    if line.strip():
                        yield line.decode(errors="replace").strip()
                time.sleep(_POLL_S)
        except OSError as error:
            self.close()
            raise InputError(
                f"chamber {self.name}: the line is interrupted ({error}); check its cable and power"
            ) from error
        if rest.strip():
            yield rest.decode(errors="replace").strip()


def _temperature_in(line: str, field: int) -> float | None:
    """The number at a field (from 1) of a line, degC; None if it is none, or has the unit F or K."""
    fields = re.split(r"[,;]|\s+(?=[-+.\d])", line.strip())
    found = _NUMBER.fullmatch(fields[field - 1].strip()) if len(fields) >= field else None
    if found is None or (found[2] or "C").upper() != "C":
        return None
    value = float(found[1])
    return value if _LOWEST_DEGC <= value <= _HIGHEST_DEGC else None
