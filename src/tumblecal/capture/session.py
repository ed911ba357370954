"""A capture from beginning to end: folder, checks before the start, the guided run, resuming."""

import platform
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from tumblecal.capture.estimate_worker import Estimate
from tumblecal.capture.guide import Guide, Phase
from tumblecal.capture.journal import (
    JOURNAL_NAME,
    PLAN_NAME,
    RAW_NAME,
    Journal,
    Standing,
    read_journal,
    replayed,
    sha256_of,
)
from tumblecal.capture.keyboard import Keyboard
from tumblecal.capture.live import LiveStream
from tumblecal.capture.log import Kind, read_log
from tumblecal.capture.plan import Plan, read_plan
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.recorder import clocks
from tumblecal.capture.recording import Recording
from tumblecal.capture.samples import Event, Settings
from tumblecal.capture.screen import Screen
from tumblecal.capture.sniff import described
from tumblecal.data.atomic import writable_folder
from tumblecal.errors import InputError


_LOOK_S = 0.25
_LOOKS_A_DRAWING = 2
_FIRST_DATA_S = 4.0
_BYTES_TO_JUDGE = 2000


@dataclass(frozen=True)
class Device:
    """The device as it presented itself: serial number, settings, and the sample rate to count with."""

    serial_number: str | None
    settings: Settings | None
    rate_hz: float
    events: list[dict]


def begin(plan_path: Path, folder: Path) -> Plan:
    """Make a capture's folder with its own copy of the plan.

    **Raises:** `InputError` when the plan is faulty, the folder holds a capture already or the disk is too small.
    """
    plan = read_plan(plan_path)
    protocol(plan.port.protocol)
    if _was_begun(folder):
        raise InputError(f"{folder}: holds a capture already; go on with --resume {folder}, or give another folder")
    writable_folder(folder)
    need = 2 * len(plan.steps) * (plan.dwell.seconds + plan.dwell.settle_s) * (plan.port.rate_hz or 2000.0) * 80
    free = shutil.disk_usage(folder).free
    if free < min(need, 5e9):
        raise InputError(
            f"{folder}: {free / 1e9:.2f} GB free, {need / 1e9:.2f} GB wanted; make room or give another folder"
        )
    (folder / PLAN_NAME).write_bytes(plan_path.read_bytes())
    journal = Journal(folder)
    journal.write(
        "session",
        plan_sha256=sha256_of(folder / PLAN_NAME, 0, (folder / PLAN_NAME).stat().st_size),
        **plan.session.model_dump(),
        gravity_ms2=plan.gravity_ms2,
        gravity_source=plan.gravity_source,
        site=plan.site.model_dump(),
        host=platform.node(),
        system=platform.platform(),
        versions={name: version(name) for name in ("tumblecal", "numpy", "pyserial")}
        | {"python": platform.python_version()},
        clocks=clocks(),
    )
    journal.close()
    return plan


def _was_begun(folder: Path) -> bool:
    """Whether a device was ever met there; a folder where none was is simply begun again."""
    path = folder / JOURNAL_NAME
    if not path.exists():
        return False
    if any(r.kind == Kind.JOURNAL and r.content()["entry"] == "device" for r in read_log(path)):
        return True
    path.unlink()
    (folder / RAW_NAME).unlink(missing_ok=True)
    return False


def resume(folder: Path) -> tuple[Plan, Standing]:
    """The plan and the standing of a capture that was stopped.

    **Raises:** `InputError` when there is none, or its plan was changed.
    """
    standing = replayed(read_journal(folder))
    path = folder / PLAN_NAME
    if not path.is_file():
        raise InputError(f"{path}: is missing; put back the plan this capture began with")
    if sha256_of(path, 0, path.stat().st_size) != standing.session["plan_sha256"]:
        raise InputError(f"{path}: was changed since the capture began; put back the original")
    return read_plan(path), standing


def meet(stream: LiveStream, plan: Plan, said: Callable[[str], None] = lambda text: None) -> Device:
    """Ask the device who it is and wait for its first samples.

    **Raises:** `InputError` in one line for silence, a wrong protocol, a wrong baud rate, nonsense.
    """
    name, url = stream.protocol, plan.port.url
    for query in name.queries:
        stream.recording.send(query)
        time.sleep(0.05)
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
        time.sleep(0.05)
    if not frames:
        raise InputError(_why_no_samples(stream, plan))
    content = {k: v for e in events for k, v in e.content.items()}
    if name.range_from_stream and "range_g" not in content and plan.port.range_g is None:
        raise InputError(
            f"port {url}: the {name.title} does not tell its range when asked; "
            "connect its receive line, or set port.range_g in the plan"
        )
    serial = content.get("serial_number")
    rate = content.get("rate_hz") or plan.port.rate_hz or _rate_of(stream, plan.port.speed)
    said(
        f"{name.title}, serial number {serial or 'not told'}, {rate:g} Hz, range {content.get('range_g') or 'not told'}"
    )
    return Device(serial, None, float(rate), [{"kind": e.kind, **e.content} for e in events])


def _why_no_samples(stream: LiveStream, plan: Plan) -> str:
    port = f"port {plan.port.url} at {stream.recording._baud} baud"
    received = stream.tally.bytes
    if received == 0:
        return (
            f"{port}: silence, not one byte in {_FIRST_DATA_S:g} s: power, cable, or a device that waits for a command"
        )
    if received < 40:
        return f"{port}: only {received} bytes in {_FIRST_DATA_S:g} s: wrong baud rate, or the device is set to a very low rate"
    return f"{port}: {described(stream.recent, plan.port.protocol)}"


def _rate_of(stream: LiveStream, speed: float) -> float:
    """The sample rate by the host's clock, when neither device nor plan tell it: counted over three seconds."""
    start, first = time.monotonic(), stream.tally.counts.frames
    while time.monotonic() - start < 3.0:
        stream.poll()
        time.sleep(0.05)
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


def capture(
    plan: Plan,
    folder: Path,
    standing: Standing,
    *,
    estimate: Estimate | None = None,
    plain: bool = False,
    confirm: Callable[[], bool] = lambda: True,
) -> Standing:
    """The guided run, until all positions are done or the operator stops.

    **Arguments:**

    - `plan`, `folder`, `standing`: from `begin` or `resume`.
    - `estimate`: live estimate of the parameters, or None.
    - `plain`: lines instead of a redrawn screen.
    - `confirm`: asked on resuming whether the instrument is still mounted as before.
    """
    how = protocol(plan.port.protocol)
    journal = Journal(folder)
    recording: Recording | None = None
    try:
        if standing.device:
            still = confirm()
            journal.write("resumed", still_mounted=still, clocks=clocks())
            if not still:
                raise InputError("the instrument was taken off: its angles to the head are new; begin a new run")
        recording = Recording(folder / RAW_NAME, plan.port.url, plan.port.baud or how.bauds[0])
        stream = LiveStream(recording, how, _settings(plan, how), _options(plan, how))
        device = meet(stream, plan, print)
        wanted = plan.port.serial_number
        if wanted is not None and device.serial_number != wanted:
            raise InputError(f"serial number {device.serial_number}: the plan is for {wanted}")
        check_same_device(standing, device)
        journal.write(
            "device",
            serial_number=device.serial_number,
            rate_hz=device.rate_hz,
            protocol=how.name,
            baud=plan.port.baud or how.bauds[0],
            events=device.events,
            clocks=clocks(),
            log_position=recording.position,
        )
        _walk(plan, journal, standing, stream, device, estimate, plain)
        recording.stop()
        recording = None
    finally:
        if recording is not None:
            recording.stop()
        journal.close()
    return standing


def _walk(
    plan: Plan,
    journal: Journal,
    standing: Standing,
    stream: LiveStream,
    device: Device,
    estimate: Estimate | None,
    plain: bool,
) -> None:
    with Screen(plain) as screen, Keyboard() as keyboard:
        guide = Guide(plan, journal, standing, stream, device.rate_hz, estimate, screen.bell)
        try:
            lost = looks = 0
            while guide.phase != Phase.FINISHED:
                guide.take(stream.poll())
                if stream.tally.reopened > lost:
                    lost = stream.tally.reopened
                    _meet_again(stream, device, guide)
                for key in keyboard.pressed():
                    guide.press(key)
                looks += 1
                if looks % _LOOKS_A_DRAWING == 0 or plan.port.speed > 1:
                    screen.show(guide.view())
                time.sleep(_LOOK_S if plan.port.speed <= 1 else 0.05)
        except KeyboardInterrupt:
            guide.interrupt("Ctrl-C")
            journal.write("stopped", why="Ctrl-C", tally=stream.tally.as_dict())
        except InputError as error:
            journal.write("stopped", why=error.faults[0], tally=stream.tally.as_dict())
            raise
        finally:
            guide.close()


def _meet_again(stream: LiveStream, device: Device, guide: Guide) -> None:
    """After an unplug: the same unit with the same settings, or the run stops."""
    if device.serial_number is None or not stream.protocol.queries:
        return
    for query in stream.protocol.queries:
        stream.recording.send(query)
    events: list[Event] = []
    deadline = time.monotonic() + 3.0
    while time.monotonic() < deadline:
        part = stream.poll()
        events += part.events
        guide.take(part)
        if {"serial_number", "configuration"} <= {e.kind for e in events}:
            break
        time.sleep(0.05)
    content = {k: v for e in events for k, v in e.content.items()}
    seen = content.get("serial_number")
    if seen is not None and seen != device.serial_number:
        raise InputError(
            f"serial number {seen} was plugged in, this run began with {device.serial_number}: "
            "connect the first one, then --resume"
        )


def _settings(plan: Plan, how: Protocol) -> Settings | None:
    rate = float(plan.port.rate_hz) if plan.port.rate_hz else None
    if plan.port.range_g is None:
        return Settings(rate_hz=rate) if rate else None
    if how.ranges_g and plan.port.range_g not in how.ranges_g:
        raise InputError(
            f"port.range_g: {plan.port.range_g:g}: the {how.title} has {', '.join(f'{r:g}' for r in how.ranges_g)}"
        )
    return how.with_range(Settings(rate_hz=rate), float(plan.port.range_g))


def _options(plan: Plan, how: Protocol) -> dict:
    given = {"columns": plan.port.columns, "unit": plan.port.unit}
    return {name: value for name, value in given.items() if value and name in how.options}
