"""Contact with the instrument: its identity, which must be that of the run, and its sample rate.

A missing answer does not mean a different instrument: the receive line may not be connected, or the answer may be late. If
the line was interrupted and the instrument does not state the serial number of the run, nothing is recorded until it does, or
the operator confirms that it is the same one.
"""

import time
from collections.abc import Callable
from pathlib import Path

from tumblecal.capture.decoding.samples import Entry, Event
from tumblecal.capture.decoding.sniff import described
from tumblecal.capture.port.live import LiveStream
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.ground.errors import InputError


# Seconds to wait for an answer after each question, and between two commands.
WAITS_S = (1.0, 2.0, 3.0, 4.0, 6.0)
_BETWEEN_S = 0.05
# Shortest time in which an instrument can be exchanged behind the same adapter, s.
_EXCHANGE_S = 3.0
_FIRST_DATA_S = 4.0
_FEWEST_BYTES = 40
# Length of a stretch by which the sample rate is measured, and how far it may be from a usual one.
_STRETCH_S, _SAME_SHARE = 2.0, 0.03
_USUAL_HZ = (10, 20, 25, 50, 100, 120, 125, 200, 250, 400, 500, 800, 1000, 2000, 4000)

# Sleeps for some seconds; may raise to end the wait.
Pause = Callable[[float], None]


def await_port(url: str, limit_s: float, pause: Pause = time.sleep) -> None:
    """Wait some time for a port that does not exist yet; opening it raises if it did not appear."""
    deadline = time.monotonic() + limit_s
    if "://" in url or Path(url).exists() or limit_s <= 0:
        return
    print(f"port {url}: not available yet; waiting up to {limit_s:g} s")
    while not Path(url).exists() and time.monotonic() < deadline:
        pause(0.05)


class Contact:
    """Checks whether the instrument on the line is the one of the run.

    **Arguments:**

    - `run`: the plan, and the journal for the results. `stream`: the live samples.
    - `trust`: the operator states that it is the same instrument.

    `serial_number`: as stated since the line was connected; None if it was not. `asked`: number of questions since then.
    `asking`: whether an answer may still come, so that nothing may be accepted yet. `rate_hz`: sample rate, set by `meet`.
    """

    def __init__(self, run: RunFolder, stream: LiveStream, *, trust: bool = False):
        self._plan, self._journal, self.stream, self._trust = run.plan, run.journal, stream, trust
        self.rate_hz, self._until_s = 0.0, 0.0
        self.serial_number: str | None = None
        self.asked, self.asking = 0, False

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
        if self.asking:
            return f"querying the serial number of the instrument, attempt {self.asked}"
        if self.confirmed or not self._journal.state.doubts:
            return ""
        again = ": press Enter if it is the same one, otherwise connect that one" if self.doubted else ""
        return f"identity not confirmed: the instrument does not state its serial number{again}"

    def meet(self, pause: Pause = time.sleep) -> None:
        """Ask the instrument for its identity, wait for its first samples, and write it into the journal.

        `rate_hz` is then its sample rate: as it states it, otherwise of the plan, otherwise measured.

        **Raises:** `InputError` in one line for silence, a wrong protocol or baud rate, an unknown range, or an instrument that
        is not the one of the plan or of the run.
        """
        stream, state, port = self.stream, self._journal.state, self._plan.port
        protocol, events, stated, counts = stream.protocol, list[Event](), Entry(), stream.tally.counts
        self._connected()
        wanted = {"serial_number"} if protocol.queries else set()
        wanted |= {"range_g"} if protocol.range_from_stream else set()
        late_s = time.monotonic() + _FIRST_DATA_S
        while not counts.frames or not (wanted <= stated.keys() or not self._ask()):
            if time.monotonic() > late_s and not counts.frames:
                words = described(stream.recent, port.protocol)
                if (received := stream.tally.bytes) < _FEWEST_BYTES:
                    words = f"{received or 'no'} bytes in {_FIRST_DATA_S:g} s: check power, cable and baud rate"
                raise InputError(f"port {port.url} at {stream.recording.baud} baud: {words}")
            for event in stream.poll().events:
                events.append(event)
                stated |= event.content
            pause(0.05)
        self.asking = False
        self._check(events)
        range_g, stated_rate_hz = stated.get("range_g"), stated.get("rate_hz") or state.device.get("rate_hz")
        if protocol.range_from_stream and range_g is port.range_g is state.configuration is None:
            raise InputError(
                f"port {port.url}: the {protocol.title} does not state its range when asked; "
                "connect its receive line, or set port.range_g in the plan"
            )
        self.rate_hz = float(stated_rate_hz or port.rate_hz or self._measured_hz(pause))
        serial = self.serial_number or f"not stated (asked {self.asked} times)"
        print(f"{protocol.title}, serial number {serial}, {self.rate_hz:g} Hz, range {range_g or 'not stated'}")
        if port.serial_number not in (None, self.serial_number) and not (self._trust and self.serial_number is None):
            raise InputError(
                f"serial number {serial}: the plan is for {port.serial_number}; connect that one, with its receive line "
                "(--trust-instrument, if it cannot state its number)"
            )
        self._journal.write(
            "device",
            serial_number=self.serial_number,
            rate_hz=self.rate_hz,
            protocol=protocol.name,
            baud=stream.recording.baud,
            events=[{"kind": event.kind, **event.content} for event in events],
            clocks=clocks(),
            log_position=stream.recording.position,
        )
        if state.serial_number is not None and not self.confirmed:
            self._missed(state.open_after(-1, self._plan.soaks) or 0)
        elif self.doubted and self._trust:
            self.trusted()

    def interrupted(self, notice: Entry) -> None:
        """Register an interruption of the line: the instrument may be a different one, unless the interruption was short."""
        if notice["event"] == "reopened" or notice.get("after_s", 0.0) * self._plan.port.speed > _EXCHANGE_S:
            self._connected()

    def hear(self, events: list[Event], position: int) -> bool:
        """Evaluate answers of the instrument, and repeat the questions when they are due; whether it must now be confirmed.

        **Raises:** `InputError` if it is a different instrument, or has different settings.
        """
        before = self.confirmed
        self._check(events)
        if self.confirmed and not before:
            self.asking = False
            self._journal.write("identity_confirmed", serial_number=self.serial_number)
        elif self.asking and not self._ask():
            self.asking = False
            self._missed(position)
            return self.doubted
        return False

    def trusted(self) -> None:
        """The operator confirms the instrument."""
        self._journal.write("identity_trusted", text="the operator states that it is the same instrument")

    def _connected(self) -> None:
        """The line was connected: ask who is there."""
        self.serial_number, self.asked, self.asking, self._until_s = None, 0, True, 0.0

    def _ask(self) -> bool:
        """Whether an answer may still come; asks when it is due."""
        if time.monotonic() <= self._until_s:
            return True
        if not self.stream.protocol.queries or self.asked == len(WAITS_S):
            return False
        for command in self.stream.protocol.queries:
            self.stream.recording.send(command)
            time.sleep(_BETWEEN_S)
        self._until_s = time.monotonic() + WAITS_S[self.asked]
        self.asked += 1
        return True

    def _check(self, events: list[Event]) -> None:
        """Evaluate answers of the instrument.

        **Raises:** `InputError` if it is a different instrument, or has different settings.
        """
        state = self._journal.state
        for event in events:
            words, before, now = "", None, None
            if event.kind == "serial_number":
                before, now = state.serial_number, event.content.get("serial_number")
                self.serial_number, words = now, f"serial number {before}, but {now} is connected"
            elif event.kind == "configuration" and state.configuration:
                before, now = state.configuration.get("raw"), event.content.get("raw")
                words = "other settings of the instrument"
            if None not in (before, now) and before != now:
                raise InputError(
                    f"this run began with {words}: connect the instrument of this run, with its settings, "
                    "then --resume, or begin a new run"
                )

    def _missed(self, position: int) -> None:
        """All questions are asked, and the answer is missing: the operator must confirm the instrument."""
        asked = f"asked {self.asked} times" if self.asked else "this kind of instrument states none"
        self._journal.write(
            "identity_not_confirmed",
            position=position,
            serial_number=self._journal.state.serial_number,
            asked=self.asked,
            text=f"identity not confirmed: no serial number stated since the line was connected ({asked})",
        )
        if self.doubted and self._trust:
            self.trusted()

    def _measured_hz(self, pause: Pause) -> float:
        """The sample rate by the host's clock, if neither device nor plan state it.

        Samples that the device sent before the port was opened arrive together at first, so the second stretch is used.
        """
        measured, counts = 0.0, self.stream.tally.counts
        for _ in range(2):
            start_s, first = time.monotonic(), counts.frames
            while time.monotonic() < start_s + _STRETCH_S:
                self.stream.poll()
                pause(0.05)
            measured = max((counts.frames - first) / (time.monotonic() - start_s) / self._plan.port.speed, 1.0)
        near = min(_USUAL_HZ, key=lambda usual: abs(usual / measured - 1))
        return float(near) if abs(near / measured - 1) < _SAME_SHARE else measured
