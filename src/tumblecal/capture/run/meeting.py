"""Contact with the device: wait for its port, query its identity, and check that it is the same."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.decoding.samples import Event, Settings
from tumblecal.capture.decoding.sniff import described
from tumblecal.capture.journal import RunState
from tumblecal.capture.port.live import LiveStream
from tumblecal.capture.run.identity import WAITS_S
from tumblecal.ground.errors import InputError


_FIRST_DATA_S = 4.0

_FEWEST_FRAMES = 20
# Stretches by which the sample rate is measured: their length, how many, and differences that two may have.
_STRETCH_S, _MOST_STRETCHES, _SAME_SHARE, _SAME_COUNT = 1.5, 12, 0.03, 2
OTHER_UNIT = "this run began with serial number {began}, but {seen} is connected: connect {began}, or begin a new run"
OTHER_SETTINGS = (
    "the settings of the instrument differ from those of this run: restore them, then --resume, or begin a new run"
)

# Sleeps for some seconds; may raise to end the wait.
Pause = Callable[[float], None]


@dataclass(frozen=True)
class Device:
    """The device as it identified itself: serial number, settings, and the sample rate for counting."""

    serial_number: str | None
    settings: Settings | None
    rate_hz: float
    events: list[dict[str, Any]]


def await_port(url: str, limit_s: float, pause: Pause = time.sleep) -> None:
    """Wait some time for a port that does not exist yet; opening it raises if it did not appear."""
    deadline = time.monotonic() + limit_s
    if "://" in url or Path(url).exists() or limit_s <= 0:
        return
    print(f"port {url}: not available yet; waiting up to {limit_s:g} s")
    while not Path(url).exists() and time.monotonic() < deadline:
        pause(0.05)


def meet(
    stream: LiveStream,
    plan: CapturePlan,
    report: Callable[[str], None] = lambda text: None,
    pause: Pause = time.sleep,
    state: RunState | None = None,
) -> Device:
    """Query the identity of the device, with growing waits (`identity.WAITS_S`), and wait for its first samples.

    `state`: state of a resumed run: its settings are used if the device does not state them now.

    **Raises:** `InputError` in one line for silence, a wrong protocol, a wrong baud rate, or unreadable data.
    """
    name, url = stream.protocol, plan.port.url
    expected = state.serial_number if state is not None else None
    wanted = (
        {"configuration", "serial_number"} if name.range_from_stream else {"serial_number"} if name.queries else set()
    )
    # An instrument that stated its serial number before can do so again: its answer may only be late.
    waits = WAITS_S if name.range_from_stream or expected is not None else WAITS_S[:1]
    events: list[Event] = []
    frames = tries = 0
    begun = asked = time.monotonic()
    while True:
        now = time.monotonic()
        complete = wanted <= {e.kind for e in events}
        enough, late = frames >= _FEWEST_FRAMES, now > begun + _FIRST_DATA_S
        if (complete and (enough or late)) or (late and not frames):
            break
        if not complete and (tries == 0 or now > asked + waits[tries - 1]):
            if tries == len(waits):
                break
            for query in name.queries:
                stream.recording.send(query)
                pause(0.05)
            tries, asked = tries + 1, time.monotonic()
        part = stream.poll()
        events += part.events
        frames += len(part.samples)
        pause(0.05)
    if not frames:
        raise InputError(_why_no_samples(stream, plan))
    content = {k: v for e in events for k, v in e.content.items()}
    known = state is not None and state.configuration is not None
    if name.range_from_stream and "range_g" not in content and plan.port.range_g is None and not known:
        raise InputError(
            f"port {url}: the {name.title} does not state its range when asked; "
            "connect its receive line, or set port.range_g in the plan"
        )
    serial = content.get("serial_number")
    before = state.device.get("rate_hz") if state is not None else None
    rate = content.get("rate_hz") or before or plan.port.rate_hz or _rate_of(stream, plan.port.speed, pause)
    no_serial = f"not stated (asked {tries} times)" if tries else "not stated"
    report(
        f"{name.title}, serial number {serial or no_serial}, {rate:g} Hz, range {content.get('range_g') or 'not stated'}"
    )
    return Device(serial, None, float(rate), [{"kind": e.kind, **e.content} for e in events])


def _why_no_samples(stream: LiveStream, plan: CapturePlan) -> str:
    port = f"port {plan.port.url} at {stream.recording.baud} baud"
    received = stream.tally.bytes
    if received == 0:
        return (
            f"{port}: no data in {_FIRST_DATA_S:g} s: check power and cable, and whether the device waits for a command"
        )
    if received < 40:
        return f"{port}: only {received} bytes in {_FIRST_DATA_S:g} s: wrong baud rate, or a very low sample rate of the device"
    return f"{port}: {described(stream.recent, plan.port.protocol)}"


def _rate_of(stream: LiveStream, speed: float, pause: Pause) -> float:
    """The sample rate by the host's clock, if neither device nor plan state it: of two successive stretches that agree.

    Samples that the device sent before the port was opened arrive together at first.
    """

    def counted_hz() -> float:
        start, first = time.monotonic(), stream.tally.counts.frames
        while time.monotonic() - start < _STRETCH_S:
            stream.poll()
            pause(0.05)
        return (stream.tally.counts.frames - first) / (time.monotonic() - start)

    before, rate = counted_hz(), counted_hz()
    for _ in range(_MOST_STRETCHES - 2):
        if abs(rate - before) <= _SAME_SHARE * rate + _SAME_COUNT / _STRETCH_S:
            break
        before, rate = rate, counted_hz()
    measured = (rate + min(before, rate)) / 2 / speed
    usual = [10, 20, 25, 50, 100, 120, 125, 200, 250, 400, 500, 800, 1000, 2000, 4000]
    near = min(usual, key=lambda r: abs(r / measured - 1)) if measured else 1.0
    return float(near) if measured and abs(near / measured - 1) < 0.03 else max(measured, 1.0)


def check_same_device(state: RunState, device: Device) -> None:
    """Raise for a different unit, or for different settings from those at the start of the run.

    **Raises:** `InputError`.
    """
    if not state.device:
        return
    began, seen = state.serial_number, device.serial_number
    # A missing answer does not mean a different instrument: the guide compares its readings with a finished position.
    if began is not None and seen is not None and began != seen:
        raise InputError(OTHER_UNIT.format(began=began, seen=seen))
    settings = state.configuration
    now = [e for e in device.events if e["kind"] == "configuration"]
    if settings and now and settings.get("raw") != now[-1].get("raw"):
        raise InputError(OTHER_SETTINGS)
