"""The guided run on a folder that is held: recorder, device, guide, screen and keys together."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.estimate_worker import Estimate
from tumblecal.capture.guide import Guide, Phase
from tumblecal.capture.guide_view import view_of
from tumblecal.capture.journal import RAW_NAME, Journal, Standing
from tumblecal.capture.keyboard import Keyboard
from tumblecal.capture.live import LiveStream
from tumblecal.capture.meeting import Device, Pause, await_port, check_same_device, meet, meet_again
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.recorder import clocks
from tumblecal.capture.recording import Recording
from tumblecal.capture.run_folder import RunFolder
from tumblecal.capture.samples import Settings
from tumblecal.capture.stop_signals import Stopped, StopSignals
from tumblecal.capture.terminal_screen import Screen
from tumblecal.ground.errors import InputError


_LOOK_S, _FAST_LOOK_S = 0.25, 0.05
_LOOKS_A_DRAWING = 2


def capture(
    run: RunFolder,
    *,
    estimate: Estimate | None = None,
    plain: bool = False,
    wait_s: float = 0.0,
    confirm: Callable[[], bool] = lambda: True,
) -> Standing:
    """The guided run, until all positions are done or the operator stops.

    **Arguments:**

    - `run`: from `begin` or `resume`; its standing is kept up to date.
    - `estimate`: live estimate of the parameters, or None.
    - `plain`: lines instead of a redrawn screen.
    - `wait_s`: how long to wait for a port that is not there yet.
    - `confirm`: asked on resuming whether the instrument is still mounted as before.

    **Raises:** `InputError` in one line for whatever ends the run; `Stopped` after Ctrl-C, SIGTERM or SIGHUP. Both
    leave an entry "stopped" in the journal, and everything accepted before.
    """
    plan, journal = run.plan, run.journal
    spoken = protocol(plan.port.protocol)
    if run.standing.device:
        still = confirm()
        journal.write("resumed", still_mounted=still, clocks=clocks())
        if not still:
            raise InputError("the instrument was taken off: its angles to the head are new; begin a new run")
    with StopSignals() as signals:
        with _end_told(journal, None):
            await_port(plan.port.url, wait_s, signals.pause)
            recording = Recording(run.folder / RAW_NAME, plan.port.url, plan.port.baud or spoken.bauds[0])
        try:
            stream = LiveStream(
                recording, spoken, _settings(plan, spoken), spoken.asked(plan.port.columns, plan.port.unit)
            )
            with _end_told(journal, stream):
                device = _met(run, stream, signals.pause)
            _walk(run, stream, device, estimate, plain, signals.pause)
        finally:
            recording.stop()
    return run.standing


@contextmanager
def _end_told(journal: Journal, stream: LiveStream | None, guide: Guide | None = None) -> Iterator[None]:
    """What ends the run is written into the journal, as far as there is still a disk to write on."""
    try:
        yield
    except (InputError, Stopped) as end:
        with suppress(InputError):
            if guide is not None:
                guide.interrupt(str(end))
            journal.write("stopped", why=str(end), tally=stream.tally.as_dict() if stream else {})
        raise


def _met(run: RunFolder, stream: LiveStream, pause: Pause) -> Device:
    """The device, written into the journal.

    **Raises:** `InputError` when it is not the one that is wanted.
    """
    device = meet(stream, run.plan, print, pause)
    wanted = run.plan.port.serial_number
    if wanted is not None and device.serial_number != wanted:
        raise InputError(f"serial number {device.serial_number}: the plan is for {wanted}")
    check_same_device(run.standing, device)
    run.journal.write(
        "device",
        serial_number=device.serial_number,
        rate_hz=device.rate_hz,
        protocol=stream.protocol.name,
        baud=stream.recording.baud,
        events=device.events,
        clocks=clocks(),
        log_position=stream.recording.position,
    )
    return device


def _walk(
    run: RunFolder, stream: LiveStream, device: Device, estimate: Estimate | None, plain: bool, pause: Pause
) -> None:
    fast = run.plan.port.speed > 1
    with Screen(plain) as screen, Keyboard() as keyboard:
        guide = Guide(run, stream, device.rate_hz, estimate, screen.bell)
        try:
            with _end_told(run.journal, stream, guide):
                lost = looks = 0
                while guide.phase != Phase.FINISHED:
                    run.journal.check()
                    guide.take(stream.poll())
                    if stream.tally.reopened > lost:
                        lost = stream.tally.reopened
                        meet_again(stream, device, guide.take, pause)
                    for key in keyboard.pressed():
                        guide.press(key)
                    looks += 1
                    if looks % _LOOKS_A_DRAWING == 0 or fast:
                        screen.show(view_of(guide))
                    pause(_FAST_LOOK_S if fast else _LOOK_S)
        finally:
            guide.worker.close()


def _settings(plan: CapturePlan, spoken: Protocol) -> Settings | None:
    rate = float(plan.port.rate_hz) if plan.port.rate_hz else None
    if plan.port.range_g is None:
        return Settings(rate_hz=rate) if rate else None
    spoken.check_range(plan.port.range_g, f"port.range_g: {plan.port.range_g:g}")
    return spoken.with_range(Settings(rate_hz=rate), float(plan.port.range_g))
