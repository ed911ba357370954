"""Meeting the device: waiting for its port, asking who it is, and knowing it again."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.journal import Standing
from tumblecal.capture.live import Arrived, LiveStream
from tumblecal.capture.samples import Event, Settings
from tumblecal.capture.sniff import described
from tumblecal.ground.errors import InputError


_FIRST_DATA_S = 4.0

# Sleeps for some seconds; may raise to end what waits.
Pause = Callable[[float], None]


@dataclass(frozen=True)
class Device:
    """The device as it presented itself: serial number, settings, and the sample rate to count with."""

    serial_number: str | None
    settings: Settings | None
    rate_hz: float
    events: list[dict]


def await_port(url: str, limit_s: float, pause: Pause = time.sleep) -> None:
    """Give a port that is not there yet some time to appear; opening it tells when it did not."""
    deadline = time.monotonic() + limit_s
    if "://" in url or Path(url).exists() or limit_s <= 0:
        return
    print(f"port {url}: not there yet; waiting up to {limit_s:g} s for it")
    while not Path(url).exists() and time.monotonic() < deadline:
        pause(0.05)


def meet(
    stream: LiveStream, plan: CapturePlan, said: Callable[[str], None] = lambda text: None, pause: Pause = time.sleep
) -> Device:
    """Ask the device who it is and wait for its first samples.

    **Raises:** `InputError` in one line for silence, a wrong protocol, a wrong baud rate, nonsense.
    """
    name, url = stream.protocol, plan.port.url
    for query in name.queries:
        stream.recording.send(query)
        pause(0.05)
    events: list[Event] = []
    deadline, asked, frames = time.monotonic() + _FIRST_DATA_S, 0, 0
    while True:
        part = stream.poll()
        events += part.events
        frames += len(part.samples)
        known = {e.kind for e in events}
        complete = not name.range_from_stream or {"configuration", "serial_number"} <= known
        if frames >= 20 and complete:
            break
        if time.monotonic() > deadline:
            if frames and not complete and asked < 2:
                asked += 1
                deadline = time.monotonic() + 2.0
                for query in name.queries:
                    stream.recording.send(query)
                continue
            break
        pause(0.05)
    if not frames:
        raise InputError(_why_no_samples(stream, plan))
    content = {k: v for e in events for k, v in e.content.items()}
    if name.range_from_stream and "range_g" not in content and plan.port.range_g is None:
        raise InputError(
            f"port {url}: the {name.title} does not tell its range when asked; "
            "connect its receive line, or set port.range_g in the plan"
        )
    serial = content.get("serial_number")
    rate = content.get("rate_hz") or plan.port.rate_hz or _rate_of(stream, plan.port.speed, pause)
    said(
        f"{name.title}, serial number {serial or 'not told'}, {rate:g} Hz, range {content.get('range_g') or 'not told'}"
    )
    return Device(serial, None, float(rate), [{"kind": e.kind, **e.content} for e in events])


def _why_no_samples(stream: LiveStream, plan: CapturePlan) -> str:
    port = f"port {plan.port.url} at {stream.recording.baud} baud"
    received = stream.tally.bytes
    if received == 0:
        return (
            f"{port}: silence, not one byte in {_FIRST_DATA_S:g} s: power, cable, or a device that waits for a command"
        )
    if received < 40:
        return f"{port}: only {received} bytes in {_FIRST_DATA_S:g} s: wrong baud rate, or the device is set to a very low rate"
    return f"{port}: {described(stream.recent, plan.port.protocol)}"


def _rate_of(stream: LiveStream, speed: float, pause: Pause) -> float:
    """The sample rate by the host's clock, when neither device nor plan tell it: counted over three seconds."""
    start, first = time.monotonic(), stream.tally.counts.frames
    while time.monotonic() - start < 3.0:
        stream.poll()
        pause(0.05)
    measured = (stream.tally.counts.frames - first) / (time.monotonic() - start) / speed
    usual = [10, 20, 25, 50, 100, 120, 125, 200, 250, 400, 500, 800, 1000, 2000, 4000]
    near = min(usual, key=lambda r: abs(r / measured - 1)) if measured else 1.0
    return float(near) if measured and abs(near / measured - 1) < 0.03 else max(measured, 1.0)


def check_same_device(standing: Standing, device: Device) -> None:
    """Refuse another unit, or one that was set otherwise since the run began.

    **Raises:** `InputError`.
    """
    before = standing.device
    if not before:
        return
    if before.get("serial_number") != device.serial_number:
        raise InputError(
            f"this run began with serial number {before.get('serial_number')}, now there is {device.serial_number}: "
            "connect the first one, or begin a new run"
        )
    settings = [{k: v for k, v in e.items() if k == "raw"} for e in before["events"] if e["kind"] == "configuration"]
    now = [{k: v for k, v in e.items() if k == "raw"} for e in device.events if e["kind"] == "configuration"]
    if settings and now and settings[-1] != now[-1]:
        raise InputError("the device is set otherwise than when this run began: set it back, or begin a new run")


def meet_again(stream: LiveStream, device: Device, take: Callable[[Arrived], None], pause: Pause = time.sleep) -> None:
    """After an unplug: the same unit, or the run stops. Samples that come meanwhile go to `take`.

    **Raises:** `InputError` when another unit answers.
    """
    if device.serial_number is None or not stream.protocol.queries:
        return
    for query in stream.protocol.queries:
        stream.recording.send(query)
    events: list[Event] = []
    deadline = time.monotonic() + 3.0
    while time.monotonic() < deadline:
        part = stream.poll()
        events += part.events
        take(part)
        if {"serial_number", "configuration"} <= {e.kind for e in events}:
            break
        pause(0.05)
    content = {k: v for e in events for k, v in e.content.items()}
    seen = content.get("serial_number")
    if seen is not None and seen != device.serial_number:
        raise InputError(
            f"serial number {seen} was plugged in, this run began with {device.serial_number}: "
            "connect the first one, then --resume"
        )
