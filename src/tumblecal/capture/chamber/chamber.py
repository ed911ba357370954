"""Temperature chambers: their interface, the operator as one, and access to any of them without waiting."""

import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

from tumblecal.capture.chamber.chamber_tables import ChamberTable


OPERATOR = "operator"


class Chamber(Protocol):
    """A temperature chamber; `name` identifies it in the journal and in messages."""

    @property
    def name(self) -> str:
        """Name in the journal and in messages."""
        ...

    def set_temperature(self, degc: float) -> None:
        """Request a temperature; does not wait until it is reached.

        **Raises:** `InputError` in one line if the chamber does not accept it.
        """
        ...

    def temperature(self) -> float | None:
        """The temperature of the chamber, degC; None if it has no thermometer.

        **Raises:** `InputError` in one line if it does not answer, or not with a temperature.
        """
        ...

    def close(self) -> None:
        """Release the line to the chamber; its temperature remains set."""
        ...


class OperatorChamber:
    """A chamber that the operator sets when the screen requests it."""

    name = OPERATOR

    def set_temperature(self, degc: float) -> None:
        """Nothing: the screen shows the temperature."""

    def temperature(self) -> float | None:
        """None: only the operator sees it."""
        return None

    def close(self) -> None:
        """Nothing."""


def chamber_of(table: ChamberTable) -> Chamber:
    """The chamber of a plan.

    **Raises:** `InputError` if its port cannot be opened, or it does not answer.
    """
    if not table.url:
        return OperatorChamber()
    from tumblecal.capture.chamber.text_chamber import TextChamber

    return TextChamber(table)


class ChamberThread:
    """Access to a chamber in a separate thread: a slow answer does not delay a capture.

    **Arguments:**

    - `chamber`: the chamber. `interval_s`: time between two queries, s.

    `reading_degc`: its last temperature; None if it has no thermometer, or failed.
    """

    reading_degc: float | None

    def __init__(self, chamber: Chamber, interval_s: float):
        self.name, self._chamber, self._interval_s = chamber.name, chamber, interval_s
        self._thread = ThreadPoolExecutor(1)
        self._pending: Future[float | None] | None = None
        self._wanted: float | None = None
        self._due_s = 0.0
        self.reading_degc = None

    def request(self, degc: float) -> None:
        """Request a temperature at the next look."""
        self._wanted, self._due_s = degc, 0.0

    def look(self) -> bool:
        """Continue; return whether a new reading has come.

        **Raises:** `InputError` if the chamber failed; the next look tries again.
        """
        arrived = False
        if self._pending is not None:
            if not self._pending.done():
                return False
            answered, self._pending = self._pending, None
            self._due_s, self.reading_degc = time.monotonic() + self._interval_s, None
            self.reading_degc = answered.result()
            arrived = self.reading_degc is not None
        if time.monotonic() >= self._due_s:
            self._pending = self._thread.submit(self._exchange, self._wanted)
            self._wanted = None
        return arrived

    def _exchange(self, wanted: float | None) -> float | None:
        if wanted is not None:
            self._chamber.set_temperature(wanted)
        return self._chamber.temperature()

    def close(self, finish_degc: float | None = None) -> None:
        """Release the chamber after the exchange in progress; `finish_degc` is set first.

        **Raises:** `InputError` if this temperature cannot be set.
        """
        self._thread.shutdown(wait=True, cancel_futures=True)
        try:
            if finish_degc is not None:
                self._chamber.set_temperature(finish_degc)
        finally:
            self._chamber.close()
