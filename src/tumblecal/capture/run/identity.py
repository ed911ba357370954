"""Whether the instrument on the line is the one with which the run began.

A missing answer does not mean a different instrument: the receive line may not be connected, or the answer may be late. If
the line was interrupted and the instrument does not state the serial number of the run, nothing is recorded until it does, or
the operator confirms that it is the same one.
"""

from collections.abc import Callable
from typing import Any

from tumblecal.capture.decoding.samples import Event
from tumblecal.capture.journal import Journal
from tumblecal.capture.run.contact import Questions
from tumblecal.ground.errors import InputError


# Shortest time in which an instrument can be exchanged behind the same adapter, s.
_EXCHANGE_S = 3.0


class Identity:
    """Checks whether the instrument on the line is the one of the run.

    **Arguments:**

    - `journal`: of the run; results are written into it.
    - `send`: sends a command to the instrument. `queries`: commands that make it state its serial number and settings.
    - `trust`: the operator states that it is the same instrument.

    `serial_number`: as stated since the line was connected; None if it was not. `asking`: the questions in progress, so that
    nothing may be accepted yet; None for none.
    """

    serial_number: str | None
    asking: Questions | None

    def __init__(self, journal: Journal, send: Callable[[bytes], None], queries: tuple[bytes, ...], *, trust: bool):
        self._journal, self._send, self._queries, self._trust = journal, send, queries, trust
        self.serial_number = self.asking = None

    @property
    def confirmed(self) -> bool:
        """Whether the instrument stated the serial number of the run since its line was connected."""
        return self.serial_number is not None and self.serial_number == self._journal.state.serial_number

    @property
    def doubted(self) -> bool:
        """Whether the instrument must be confirmed before the run continues."""
        return self._journal.state.to_confirm

    @property
    def text(self) -> str:
        """Message for the screen; empty if there is no doubt."""
        if self.asking is not None:
            return f"querying the serial number of the instrument, attempt {self.asking.tries}"
        if self.confirmed or not self._journal.state.doubts:
            return ""
        again = ": press Enter if it is the same one, otherwise connect that one" if self.doubted else ""
        return f"identity not confirmed: the instrument does not state its serial number{again}"

    def check(self, events: list[Event]) -> None:
        """Evaluate answers of the instrument.

        **Raises:** `InputError` if it is a different instrument, or has different settings.
        """
        state = self._journal.state
        began, settings = state.serial_number, (state.configuration or {}).get("raw")
        for event in events:
            if event.kind == "serial_number":
                self.serial_number = str(event.content["serial_number"])
                if began not in (None, self.serial_number):
                    raise InputError(
                        f"this run began with serial number {began}, but {self.serial_number} is connected: connect {began}, "
                        "or begin a new run"
                    )
            if (
                event.kind == "configuration"
                and settings is not None
                and event.content.get("raw") not in (None, settings)
            ):
                raise InputError(
                    "the settings of the instrument differ from those of this run: restore them, then --resume, or begin a "
                    "new run"
                )

    def begin(self, tries: int, position: int) -> None:
        """Start or resume a run at a position, after so many questions."""
        if not self.confirmed and self._journal.state.serial_number is not None:
            self._not_confirmed(tries, position)
        elif self.doubted and self._trust:
            self.trusted()

    def interrupted(self, notice: dict[str, Any], speed: float) -> None:
        """Register an interruption of the line: the instrument may be a different one, unless the interruption was short."""
        if notice["event"] == "reopened" or notice.get("after_s", 0.0) * speed > _EXCHANGE_S:
            known = self._journal.state.serial_number is not None
            self.serial_number, self.asking = None, Questions(self._send, self._queries if known else ())

    def hear(self, events: list[Event], position: int) -> bool:
        """Evaluate answers of the instrument, and repeat the questions when they are due; whether it must now be confirmed.

        **Raises:** `InputError` if it is a different instrument, or has different settings.
        """
        before = self.confirmed
        self.check(events)
        if self.confirmed and not before:
            self.asking = None
            self._journal.write("identity_confirmed", serial_number=self.serial_number)
        elif self.asking is not None and not self.asking.open():
            tries, self.asking = self.asking.tries, None
            self._not_confirmed(tries, position)
            return self.doubted
        return False

    def trusted(self) -> None:
        """The operator confirms the instrument."""
        self._journal.write("identity_trusted", text="the operator states that it is the same instrument")

    def _not_confirmed(self, tries: int, position: int) -> None:
        asked = f"asked {tries} times" if tries else "this kind of instrument states none"
        text = f"identity not confirmed: no serial number stated since the line was connected ({asked})"
        began = self._journal.state.serial_number
        self._journal.write("identity_not_confirmed", position=position, serial_number=began, asked=tries, text=text)
        if self.doubted and self._trust:
            self.trusted()
