"""The guided run on a locked folder: recorder, device, guide, screen and keys together."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.chamber.chamber import Chamber, TextChamber
from tumblecal.capture.chamber.soak import Soak
from tumblecal.capture.journal import RAW_NAME, RunState
from tumblecal.capture.port.live import LiveStream
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols import protocol
from tumblecal.capture.protocols.stim300_datagrams import settings_of
from tumblecal.capture.run.contact import Device, Pause, await_port, meet
from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.capture.run.identity import Identity
from tumblecal.capture.run.rest import block_size
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.capture.run.screen import Keyboard, Parameter, Screen
from tumblecal.capture.run.stop_signals import Stopped, StopSignals
from tumblecal.ground.errors import InputError


_LOOK_S, _FAST_LOOK_S = 0.25, 0.05
_LOOKS_A_DRAWING = 2

# (number in the plan, mean_g, sd_g) of the accepted positions -> the parameters.
Measured = tuple[int, NDArray[np.float64], NDArray[np.float64]]
Estimate = Callable[[list[Measured]], list[Parameter]]


def capture(
    run: RunFolder,
    *,
    estimate: Estimate | None = None,
    plain: bool = False,
    wait_s: float = 0.0,
    confirm: Callable[[], bool] = lambda: True,
    trust: bool = False,
    chamber: Chamber | None = None,
) -> RunState:
    """The guided run, until all positions are done or the operator stops.

    **Arguments:**

    - `run`: from `begin` or `resume`.
    - `estimate`: live estimate of the parameters, or None.
    - `plain`: lines instead of a redrawn screen.
    - `wait_s`: time to wait for a port that does not exist yet, s.
    - `confirm`: called on resuming: whether the instrument is still mounted as before.
    - `trust`: the operator states that it is the same instrument, also if it does not state its serial number.
    - `chamber`: sets the temperatures of a plan over temperature; None for that of the plan. It is closed at the end.

    **Raises:** `InputError` in one line for any fault that ends the run; `Stopped` after Ctrl-C, SIGTERM or SIGHUP. After
    both, the journal has an entry "stopped" and all accepted positions.
    """
    plan, journal = run.plan, run.journal
    device_protocol = protocol(plan.port.protocol)
    if journal.state.device:
        still = confirm()
        journal.write("resumed", still_mounted=still, clocks=clocks())
        if not still:
            raise InputError("the instrument was removed, so its angles to the head are new; begin a new run")
    if plan.port.range_g is not None:
        device_protocol.check_range(plan.port.range_g, f"port.range_g: {plan.port.range_g:g}")
    settings = device_protocol.settings(plan.port.range_g, plan.port.rate_hz)
    stated = journal.state.configuration or {}
    if device_protocol.range_from_stream and "range_g" in stated:
        settings = settings_of(stated)
    with StopSignals() as signals:
        with _end_recorded(run):
            await_port(plan.port.url, wait_s, signals.pause)
            recording = Recording(run.folder / RAW_NAME, plan.port.url, plan.port.baud or device_protocol.bauds[0])
        try:
            options = device_protocol.decoder_options(plan.port.columns, plan.port.unit)
            stream = LiveStream(recording, device_protocol, settings, options)
            with _end_recorded(run, stream):
                identity = Identity(journal, recording.send, device_protocol.queries, trust=trust)
                device = _met(run, stream, identity, signals.pause, trust)
                soak = _soak(run, device, chamber)
                try:
                    with Screen(plain) as screen, Keyboard() as keyboard:
                        guide = Guide(run, stream, device.rate_hz, identity, soak, screen.bell)
                        _walk(run, guide, screen, keyboard, estimate, signals.pause)
                finally:
                    soak.close(finished=run.complete)
        finally:
            recording.stop()
    return journal.state


@contextmanager
def _end_recorded(run: RunFolder, stream: LiveStream | None = None) -> Iterator[None]:
    """Write the end of the run into the journal, if the disk can be written."""
    try:
        yield
    except (InputError, Stopped) as end:
        with suppress(InputError):
            run.journal.write("stopped", why=str(end), tally=stream.tally.as_dict() if stream else {})
        raise


def _met(run: RunFolder, stream: LiveStream, identity: Identity, pause: Pause, trust: bool) -> Device:
    """Query the device and write it into the journal.

    **Raises:** `InputError` if it is not the one of the plan or of the run.
    """
    device, wanted = meet(stream, run.plan, run.journal.state, pause), run.plan.port.serial_number
    if wanted is not None and device.serial_number is None and not trust:
        raise InputError(
            f"the instrument does not state its serial number, and the plan is for {wanted}: connect its receive line, or give "
            "--trust-instrument if you know that it is this one"
        )
    if wanted is not None and device.serial_number not in (None, wanted):
        raise InputError(f"serial number {device.serial_number}: the plan is for {wanted}")
    identity.check(device.events)
    run.journal.write(
        "device",
        serial_number=device.serial_number,
        rate_hz=device.rate_hz,
        protocol=stream.protocol.name,
        baud=stream.recording.baud,
        events=[{"kind": event.kind, **event.content} for event in device.events],
        clocks=clocks(),
        log_position=stream.recording.position,
    )
    return device


def _soak(run: RunFolder, device: Device, chamber: Chamber | None) -> Soak:
    """The soaks of the plan, with its chamber; their criterion and a costly order are printed."""
    plan = run.plan
    if plan.over_temperature:
        print(f"a temperature is stable if, {plan.soak.words}")
        if text := plan.order_warning:
            print(f"warning: {text}")
            run.journal.write("warned", text=text)
        if chamber is None and plan.chamber.url:
            chamber = TextChamber(plan.chamber)
    return Soak(plan, run.journal, block_size(device.rate_hz), chamber)


def _walk(
    run: RunFolder, guide: Guide, screen: Screen, keyboard: Keyboard, estimate: Estimate | None, pause: Pause
) -> None:
    """Feed the guide until it has finished; estimate the parameters after each accepted position."""
    fast, looks, accepted = run.plan.port.speed > 1, 0, dict(run.journal.state.accepted)
    # In its own thread: an estimate may take seconds, or fail, without stopping a capture.
    thread, pending = ThreadPoolExecutor(1), list[Future[list[Parameter]]]()
    try:
        while guide.phase != Phase.FINISHED:
            run.journal.check()
            guide.take(guide.stream.poll())
            for key in keyboard.pressed():
                guide.press(key)
            if estimate is not None and accepted != run.journal.state.accepted:
                accepted = dict(run.journal.state.accepted)
                pending.append(thread.submit(estimate, _measured(run)))
            if pending and pending[-1].done():
                if error := pending[-1].exception():
                    run.journal.write("warned", position=guide.position, text=f"live estimate: {error}")
                else:
                    screen.parameters = pending[-1].result()
                pending.clear()
            looks += 1
            if looks % _LOOKS_A_DRAWING == 0 or fast:
                screen.show(guide)
            pause(_FAST_LOOK_S if fast else _LOOK_S)
    except (InputError, Stopped) as end:
        with suppress(InputError):
            guide.interrupt(str(end))
        raise
    finally:
        # Without waiting: the thread ends with the program.
        thread.shutdown(wait=False, cancel_futures=True)


def _measured(run: RunFolder) -> list[Measured]:
    """The accepted positions of the last soak: the parameters differ between temperatures."""
    soaks, last, measured = run.plan.soaks, run.journal.state.last_accepted, list[Measured]()
    for k, attempt in sorted(run.journal.state.accepted.items()):
        if last is not None and soaks[k] == soaks[last.position]:
            summary = attempt.summary
            sd = np.maximum(np.array(summary["sd_g"]) / np.sqrt(max(summary["n"], 1)), 1e-7)
            measured.append((k, np.array(summary["mean_g"]), sd))
    return measured
