"""A temperature chamber on a serial line (or a socket) with commands in text, such as those of SCPI."""

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

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


class Chamber(Protocol):
    """A temperature chamber; its methods raise `InputError` in one line if it does not answer or accept a temperature."""

    @property
    def name(self) -> str:
        """Name in the journal and in messages."""
        ...

    def set_temperature(self, degc: float) -> None:
        """Request a temperature; does not wait until it is reached."""
        ...

    def temperature(self) -> float | None:
        """The temperature of the chamber, degC; None if it has no thermometer."""
        ...

    def close(self) -> None:
        """Release the line to the chamber; its temperature remains set."""
        ...


class TextChamber:
    """A `Chamber` with commands in text; its port is opened again after an interruption.

    **Arguments:**

    - `table`: port and commands.

    **Raises:** `InputError` if the port cannot be opened.
    """

    name: str

    def __init__(self, table: ChamberTable):
        self.name, self._table = table.url, table
        self._port: Port | None = None
        with self._line():
            pass

    def set_temperature(self, degc: float) -> None:
        """Request a temperature; the set point is read back if the table has a command for it."""
        table, command = self._table, self._table.set.format(float(degc))
        with self._line() as port:
            self._send(port, command)
        stated = self._asked(table.set_query, table.set_query_field) if table.set_query else degc
        if abs(stated - degc) > _SET_WITHIN_DEGC:
            raise InputError(
                f"chamber {self.name}: the set point is {stated:g} degC after {command!r}: correct its limits, or chamber.set "
                "of the plan"
            )

    def temperature(self) -> float:
        """The temperature of the chamber, degC."""
        return self._asked(self._table.query, self._table.query_field)

    def close(self) -> None:
        """Release the port."""
        if self._port is not None:
            self._port.close()
            self._port = None

    @contextmanager
    def _line(self) -> Iterator[Port]:
        """The port, opened if needed."""
        try:
            if self._port is None:
                self._port = Port(self.name, self._table.baud)
                for command in self._table.start:
                    self._send(self._port, command)
            yield self._port
        except InputError as error:
            raise InputError(f"chamber: {error}") from error
        except OSError as error:
            self.close()
            raise InputError(
                f"chamber {self.name}: the line is interrupted ({error}); check its cable and power"
            ) from error

    def _send(self, port: Port, command: str) -> None:
        """Send a command; answers to earlier ones are discarded."""
        port.read()
        port.write((command + _TERMINATORS[self._table.terminator]).encode())

    def _asked(self, query: str, field: int) -> float:
        """The number in the answer to a query, which is repeated twice if there is none."""
        seen = ""
        for _ in range(_TRIES):
            with self._line() as port:
                self._send(port, query)
                for line in self._lines(port):
                    if (value := _temperature_in(line, field)) is not None:
                        return value
                    seen = line
        fault = f"no answer in {self._table.timeout_s:g} s; check cable, baud rate ({self._table.baud}) and terminator"
        if seen:
            fault = (
                f"the answer {shown(seen)} has no temperature in degC at field {field}; set the controller to degC, "
                "or correct chamber.query and query_field of the plan"
            )
        raise InputError(f"chamber {self.name}: {query!r}, asked {_TRIES} times: {fault}")

    def _lines(self, port: Port) -> Iterator[str]:
        """The lines of an answer until the timeout; an unfinished line at the end."""
        rest, deadline = b"", time.monotonic() + self._table.timeout_s
        while time.monotonic() < deadline:
            *lines, rest = re.split(rb"[\r\n]+", rest + port.read())
            yield from (line.decode(errors="replace").strip() for line in lines if line.strip())
            time.sleep(_POLL_S)
        if rest.strip():
            yield rest.decode(errors="replace").strip()


def _temperature_in(line: str, field: int) -> float | None:
    """The number at a field (from 1) of a line, degC; None if it is none, or has another unit."""
    fields = re.split(r"[,;]|\s+(?=[-+.\d])", line.strip())
    found = _DEGC.fullmatch(fields[field - 1].strip()) if len(fields) >= field else None
    return float(found[1]) if found and _LOWEST_DEGC <= float(found[1]) <= _HIGHEST_DEGC else None
