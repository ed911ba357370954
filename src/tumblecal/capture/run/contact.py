"""Contact with the instrument: wait for its port, ask for its identity, and find its sample rate."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.decoding.samples import Event
from tumblecal.capture.decoding.sniff import described
from tumblecal.capture.journal import RunState
from tumblecal.capture.port.live import LiveStream
from tumblecal.ground.errors import InputError


# Seconds to wait for an answer after each question, and between two commands.
WAITS_S = (1.0, 2.0, 3.0, 4.0, 6.0)
_BETWEEN_S = 0.05
_FIRST_DATA_S = 4.0
_FEWEST_FRAMES, _FEWEST_BYTES = 20, 40
# Stretches by which the sample rate is measured: their length, how many, and differences that two may have.
_STRETCH_S, _MOST_STRETCHES, _SAME_SHARE, _SAME_COUNT = 1.5, 12, 0.03, 2
_USUAL_HZ = (10, 20, 25, 50, 100, 120, 125, 200, 250, 400, 500, 800, 1000, 2000, 4000)

# Sleeps for some seconds; may raise to end the wait.
Pause = Callable[[float], None]


class Questions:
    """Questions for the identity of an instrument, repeated with growing waits.

    **Arguments:**

    - `send`: sends a command to the instrument. `commands`: these make it state its serial number and settings.
    - `most`: number of questions; None: one for each of `WAITS_S`.

    `tries`: number of questions so far.
    """

    tries: int

    def __init__(self, send: Callable[[bytes], None], commands: tuple[bytes, ...], most: int | None = None):
        self._send, self._commands, self._most = send, commands, most
        self.tries, self._until_s = 0, 0.0

    def open(self) -> bool:
        """Whether an answer may still come; asks when it is due."""
        if time.monotonic() <= self._until_s:
            return True
        waits = WAITS_S[: self._most] if self._commands else ()
        if self.tries == len(waits):
            return False
        for command in self._commands:
            self._send(command)
            time.sleep(_BETWEEN_S)
        self._until_s = time.monotonic() + waits[self.tries]
        self.tries += 1
        return True


class Device(NamedTuple):
    """The device as it identified itself after so many questions, and the sample rate for counting."""

    serial_number: str | None
    rate_hz: float
    events: list[Event]
    tries: int


def await_port(url: str, limit_s: float, pause: Pause = time.sleep) -> None:
    """Wait some time for a port that does not exist yet; opening it raises if it did not appear."""
    deadline = time.monotonic() + limit_s
    if "://" in url or Path(url).exists() or limit_s <= 0:
        return
    print(f"port {url}: not available yet; waiting up to {limit_s:g} s")
    while not Path(url).exists() and time.monotonic() < deadline:
        pause(0.05)


def meet(stream: LiveStream, plan: CapturePlan, state: RunState, pause: Pause = time.sleep) -> Device:
    """Ask the device for its identity, and wait for its first samples.

    `state`: of a resumed run: its settings are used if the device does not state them now.

    **Raises:** `InputError` in one line for silence, a wrong protocol, a wrong baud rate, or unreadable data.
    """
    protocol, events, frames, begun = stream.protocol, list[Event](), 0, time.monotonic()
    wanted = {"serial_number"} if protocol.queries else set()
    wanted |= {"configuration"} if protocol.range_from_stream else set()
    # An instrument that stated its serial number before can do so again: its answer may only be late.
    patient = protocol.range_from_stream or state.serial_number is not None
    questions = Questions(stream.recording.send, protocol.queries, None if patient else 1)
    complete = late = False
    while frames < (1 if late else _FEWEST_FRAMES) or not (complete or not questions.open()):
        if late and not frames:
            raise InputError(_why_no_samples(stream, plan))
        part = stream.poll()
        events += part.events
        frames += len(part.samples)
        complete, late = wanted <= {e.kind for e in events}, time.monotonic() > begun + _FIRST_DATA_S
        pause(0.05)
    content = {key: value for event in events for key, value in event.content.items()}
    serial, range_g = content.get("serial_number"), content.get("range_g")
    if protocol.range_from_stream and range_g is plan.port.range_g is state.configuration is None:
        raise InputError(
            f"port {plan.port.url}: the {protocol.title} does not state its range when asked; "
            "connect its receive line, or set port.range_g in the plan"
        )
    rate_hz = content.get("rate_hz") or state.device.get("rate_hz") or plan.port.rate_hz
    rate_hz = float(rate_hz or _rate_of(stream, plan.port.speed, pause))
    stated = serial or f"not stated{f' (asked {questions.tries} times)' if questions.tries else ''}"
    print(f"{protocol.title}, serial number {stated}, {rate_hz:g} Hz, range {range_g or 'not stated'}")
    return Device(serial, rate_hz, events, questions.tries)


def _why_no_samples(stream: LiveStream, plan: CapturePlan) -> str:
    received, words = stream.tally.bytes, described(stream.recent, plan.port.protocol)
    if received < _FEWEST_BYTES:
        words = f"{received or 'no'} bytes in {_FIRST_DATA_S:g} s: check power, cable and baud rate (or does it wait?)"
    return f"port {plan.port.url} at {stream.recording.baud} baud: {words}"


def _rate_of(stream: LiveStream, speed: float, pause: Pause) -> float:
    """The sample rate by the host's clock, if neither device nor plan state it: of two successive stretches that agree.

    Samples that the device sent before the port was opened arrive together at first.
    """
    rates, agree = list[float](), False
    while not agree and len(rates) < _MOST_STRETCHES:
        start, first = time.monotonic(), stream.tally.counts.frames
        while time.monotonic() - start < _STRETCH_S:
            stream.poll()
            pause(0.05)
        rates.append((stream.tally.counts.frames - first) / (time.monotonic() - start))
        limit = _SAME_SHARE * rates[-1] + _SAME_COUNT / _STRETCH_S
        agree = len(rates) > 1 and abs(rates[-1] - rates[-2]) <= limit
    measured = max((rates[-1] + min(rates[-2:])) / 2 / speed, 1.0)
    near = min(_USUAL_HZ, key=lambda usual: abs(usual / measured - 1))
    return float(near) if abs(near / measured - 1) < _SAME_SHARE else measured
