"""The guided run on a locked folder: recorder, device, guide, screen and keys together."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from tumblecal.capture.chamber.chamber import Chamber, TextChamber
from tumblecal.capture.chamber.soak import Soak
from tumblecal.capture.journal import RAW_NAME, RunState
from tumblecal.capture.port.live import LiveStream
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols import protocol
from tumblecal.capture.protocols.stim300_datagrams import settings_of
from tumblecal.capture.run.contact import Pause, await_port, meet
from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.capture.run.identity import Identity
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.capture.run.screen import Estimate, Screen
from tumblecal.capture.run.stop_signals import Stopped, StopSignals
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
    trust: bool = False,
    chamber: Chamber | None = None,
) -> RunState:
    """The guided run, until all positions are done or the operator stops.

    **Arguments:**

    - `run`: from `begin` or `resume`.
    - `estimate`: live estimate of the parameters for the screen; None for none.
    - `plain`: lines instead of a redrawn screen.
    - `wait_s`: time to wait for a port that does not exist yet, s.
    - `confirm`: called on resuming: whether the instrument is still mounted as before.
    - `trust`: the operator states that it is the same instrument, also if it does not state its serial number.
    - `chamber`: sets the temperatures of a plan over temperature; None for that of the plan. It is closed at the end.

    **Raises:** `InputError` in one line for any fault that ends the run; `Stopped` after Ctrl-C, SIGTERM or SIGHUP. After
    both, the journal has an entry "stopped" and all accepted positions.
    """
    plan, journal, state = run.plan, run.journal, run.journal.state
    spoken = protocol(plan.port.protocol)
    if state.device:
        still = confirm()
        journal.write("resumed", still_mounted=still, clocks=clocks())
        if not still:
            raise InputError("the instrument was removed, so its angles to the head are new; begin a new run")
    if plan.port.range_g is not None:
        spoken.check_range(plan.port.range_g, f"port.range_g: {plan.port.range_g:g}")
    settings, stated = spoken.settings(plan.port.range_g, plan.port.rate_hz), state.configuration or {}
    if spoken.range_from_stream and "range_g" in stated:
        settings = settings_of(stated)
    with StopSignals() as signals:
        with _end_recorded(run):
            await_port(plan.port.url, wait_s, signals.pause)
            recording = Recording(run.folder / RAW_NAME, plan.port.url, plan.port.baud or spoken.bauds[0])
        try:
            options = spoken.decoder_options(*state.text_columns(plan.port.columns, plan.port.unit))
            stream = LiveStream(recording, spoken, settings, options)
            with _end_recorded(run, stream):
                identity = Identity(journal, recording.send, spoken.queries, trust=trust)
                rate_hz = _met(run, stream, identity, signals.pause, trust)
                if plan.over_temperature:
                    print(f"a temperature is stable if, {plan.soak.words}")
                    chamber = chamber or (TextChamber(plan.chamber) if plan.chamber.url else None)
                soak = Soak(plan, journal, rate_hz, chamber)
                try:
                    with Screen(plain, estimate) as screen:
                        guide = Guide(run, stream, rate_hz, identity, soak, screen.bell)
                        _walk(run, guide, screen, signals.pause)
                finally:
                    soak.close(finished=run.complete)
        finally:
            recording.stop()
    return state


@contextmanager
def _end_recorded(run: RunFolder, stream: LiveStream | None = None) -> Iterator[None]:
    """Write the end of the run into the journal, if the disk can be written."""
    try:
        yield
    except (InputError, Stopped) as end:
        with suppress(InputError):
            run.journal.write("stopped", why=str(end), tally=stream.tally.as_dict() if stream else {})
        raise


def _met(run: RunFolder, stream: LiveStream, identity: Identity, pause: Pause, trust: bool) -> float:
    """Query the device and write it into the journal; its sample rate.

    **Raises:** `InputError` if it is not the one of the plan or of the run.
    """
    state, wanted = run.journal.state, run.plan.port.serial_number
    device = meet(stream, run.plan, state, pause)
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
    identity.begin(device.tries, state.open_after(-1, run.plan.soaks) or 0)
    return device.rate_hz


def _walk(run: RunFolder, guide: Guide, screen: Screen, pause: Pause) -> None:
    """Feed the guide until it has finished."""
    fast, looks = run.plan.port.speed > 1, 0
    try:
        while guide.phase != Phase.FINISHED:
            run.journal.check()
            guide.take(guide.stream.poll())
            for key in screen.pressed():
                guide.press(key)
            looks += 1
            if looks % _LOOKS_A_DRAWING == 0 or fast:
                screen.show(guide)
            pause(_FAST_LOOK_S if fast else _LOOK_S)
    except (InputError, Stopped) as end:
        with suppress(InputError):
            guide.interrupt(str(end))
        raise
