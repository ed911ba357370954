"""Check that the instrument is still the same: questions with growing waits, answers at any time.

A missing answer does not mean a different instrument: the receive line may not be connected, or the answer may be late.
"""

import time
from collections.abc import Callable
from enum import Enum

from tumblecal.capture.decoding.samples import Event


# Seconds to wait for an answer after each question.
WAITS_S = (1.0, 2.0, 3.0, 4.0, 6.0)


class Answer(Enum):
    """Identity of the instrument on the line."""

    CONFIRMED = "confirmed"
    ASKED = "asked"
    NONE = "none"
    OTHER = "other"
    OTHER_SETTINGS = "other settings"


class Identity:
    """Comparison of the instrument of a run with the one on the line.

    **Arguments:**

    - `send`: sends a command to the instrument. `queries`: commands that make it state its serial number and settings.
    - `serial_number`: serial number of the run's instrument; None if it never stated one.
    - `configuration`: its settings as it stated them; None if it did not.
    - `confirmed`: whether the instrument now on the line has stated that serial number.

    `heard`: the serial number that was stated last. `tries`: number of queries since the line was interrupted.
    """

    tries: int

    def __init__(
        self,
        send: Callable[[bytes], None],
        queries: tuple[bytes, ...],
        serial_number: str | None,
        configuration: str | None,
        *,
        confirmed: bool,
    ):
        self._send, self._queries, self._configuration = send, queries, configuration
        self.serial_number = serial_number
        self.answer = Answer.CONFIRMED if confirmed else Answer.NONE
        self.heard: str | None = serial_number if confirmed else None
        self.tries = 0
        self._until_s = 0.0

    def interrupted(self) -> None:
        """Query the instrument after an interruption of the line."""
        self.tries, self.heard = 0, None
        self.answer = Answer.ASKED
        self._ask()

    def look(self, events: list[Event]) -> Answer:
        """Evaluate answers, and repeat the query when it is due."""
        for event in events:
            if event.kind == "serial_number":
                self.heard = str(event.content["serial_number"])
                if self.serial_number is not None:
                    self.answer = Answer.CONFIRMED if self.heard == self.serial_number else Answer.OTHER
            raw = event.content.get("raw") if event.kind == "configuration" else None
            if raw is not None and self._configuration is not None and raw != self._configuration:
                self.answer = Answer.OTHER_SETTINGS
            if self.answer in (Answer.OTHER, Answer.OTHER_SETTINGS):
                return self.answer
        if self.answer == Answer.ASKED and time.monotonic() > self._until_s:
            self._ask()
        return self.answer

    def _ask(self) -> None:
        if self.serial_number is None or not self._queries or self.tries == len(WAITS_S):
            self.answer = Answer.NONE
            return
        for query in self._queries:
            self._send(query)
        self._until_s = time.monotonic() + WAITS_S[self.tries]
        self.tries += 1
