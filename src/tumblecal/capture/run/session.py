"""The guided run on a locked folder: recorder, device, guide, screen and keys together."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np

from tumblecal.capture.chamber.chamber import Chamber, chamber_of
from tumblecal.capture.chamber.soak_order import order_warning
from tumblecal.capture.decoding.samples import Settings
from tumblecal.capture.journal import RAW_NAME, Journal, RunState
from tumblecal.capture.port.live import LiveStream
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.protocols.stim300_datagrams import settings_of
from tumblecal.capture.run.estimate_worker import Estimate
from tumblecal.capture.run.guide import Guide, Phase
from tumblecal.capture.run.identity import Identity
from tumblecal.capture.run.meeting import Device, Pause, await_port, check_same_device, meet
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.capture.run.soaking import Soaking
from tumblecal.capture.run.stationarity import block_size
from tumblecal.capture.run.stop_signals import Stopped, StopSignals
from tumblecal.capture.run.terminal_screen import Keyboard, Screen, View
from tumblecal.ground.errors import InputError


KEYS = "Enter: accept as it is   r: repeat this position   b: repeat the previous one   s: skip   q: interrupt"


def view_of(guide: Guide) -> View:
    """The present content of the screen."""
    guide.worker.look()
    plan, dwell, accepted = guide.plan, guide.dwell, guide.state.accepted
    steps, position = plan.steps, max(guide.position, 0)
    speed, last = plan.port.speed, guide.watch.last
    each = (plan.dwell.seconds + plan.dwell.settle_s) / speed
    remaining_positions = len(steps) - len(accepted)
    done = dwell.good if dwell else 0
    needed = dwell.needed if dwell else 0
    remaining = max(needed - done, 0) / guide.rate_hz / speed
    soaks_left = len({plan.soaks[k] for k in range(len(steps)) if k not in accepted}) if plan.over_temperature else 0
    soaking = 60 * plan.soak.stable_min * max(soaks_left - (guide.phase != Phase.SOAK), 0) / speed
    if guide.phase == Phase.SOAK and guide.soaking.stability is not None:
        done, needed = (round(60 * part) for part in (guide.soaking.stability.stable_min, plan.soak.stable_min))
    blank = np.full(3, np.nan)
    return View(
        phase=guide.phase.value if guide.phase != Phase.CLOSING else "RECORDING",
        soak_degc=guide.soaking.wanted_degc,
        alpha_deg=steps[position].alpha_deg,
        beta_deg=steps[position].beta_deg,
        place=f"{_place(guide, position)}, {len(accepted)} of {len(steps)} done",
        alarm=guide.alarm,
        note=_note(guide),
        rejected=guide.rejected,
        doubt=guide.doubt.text,
        done=done,
        needed=needed,
        left_s=remaining,
        run_left_s=remaining + soaking + each * max(remaining_positions - (dwell is not None), 0),
        mean_g=dwell.mean if dwell else (last.mean if last else blank),
        sd_g=dwell.sd if dwell else (last.sd if last else blank),
        expected_g=plan.expected(position),
        drift_g=guide.drift_g if dwell and len(dwell.blocks) > 3 else blank,
        counters=guide.stream.tally.line(),
        estimate=guide.worker.rows,
        keys=KEYS,
    )


def _place(guide: Guide, position: int) -> str:
    """The position, or the soak that comes before it."""
    soaks = guide.plan.soaks
    return (
        f"soak {soaks[position] + 1} of {soaks[-1] + 1}"
        if guide.phase == Phase.SOAK
        else f"position {guide.plan.steps[position].name}"
    )


def _note(guide: Guide) -> str:
    match guide.phase:
        case Phase.SOAK:
            return guide.soaking.note
        case Phase.TURN:
            if not guide.watch.still and guide.watch.moved:
                return "moving"
            seen = " (gravity looks the same as before: turn it, or press Enter)" if guide.prompted.must_move else ""
            return f"turn the head there and take your hands away{seen}"
        case Phase.SETTLING:
            remaining = guide.plan.dwell.settle_s - guide.settled / guide.rate_hz
            return f"hands off: {max(remaining, 0) / guide.plan.port.speed:.0f} s until recording"
        case Phase.CLOSING:
            return "done; checking for lost samples"
        case Phase.FINISHED:
            return "all positions are done"
    return "recording"


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

    - `run`: from `begin` or `resume`; its state is updated.
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
    if run.state.device:
        still = confirm()
        journal.write("resumed", still_mounted=still, clocks=clocks())
        if not still:
            raise InputError("the instrument was removed, so its angles to the head are new; begin a new run")
    with StopSignals() as signals:
        with _end_recorded(journal, None):
            await_port(plan.port.url, wait_s, signals.pause)
            recording = Recording(run.folder / RAW_NAME, plan.port.url, plan.port.baud or device_protocol.bauds[0])
        try:
            stream = LiveStream(
                recording,
                device_protocol,
                _settings(run, device_protocol),
                device_protocol.decoder_options(plan.port.columns, plan.port.unit),
            )
            with _end_recorded(journal, stream):
                device = _met(run, stream, signals.pause, trust)
                chamber = _chamber(run, chamber)
            _walk(run, stream, device, chamber, estimate, plain, signals.pause, trust)
        finally:
            recording.stop()
    return run.state


@contextmanager
def _end_recorded(journal: Journal, stream: LiveStream | None, guide: Guide | None = None) -> Iterator[None]:
    """Write the end of the run into the journal, if the disk can be written."""
    try:
        yield
    except (InputError, Stopped) as end:
        with suppress(InputError):
            if guide is not None:
                guide.interrupt(str(end))
            journal.write("stopped", why=str(end), tally=stream.tally.as_dict() if stream else {})
        raise


def _met(run: RunFolder, stream: LiveStream, pause: Pause, trust: bool) -> Device:
    """Query the device and write it into the journal.

    **Raises:** `InputError` if it is not the one of the plan.
    """
    device = meet(stream, run.plan, print, pause, run.state)
    wanted = run.plan.port.serial_number
    if wanted is not None and device.serial_number is None and not trust:
        raise InputError(
            f"the instrument does not state its serial number, and the plan is for {wanted}: connect its receive line, or give "
            "--trust-instrument if you know that it is this one"
        )
    if wanted is not None and device.serial_number not in (None, wanted):
        raise InputError(f"serial number {device.serial_number}: the plan is for {wanted}")
    check_same_device(run.state, device)
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
    run: RunFolder,
    stream: LiveStream,
    device: Device,
    chamber: Chamber | None,
    estimate: Estimate | None,
    plain: bool,
    pause: Pause,
    trust: bool,
) -> None:
    fast = run.plan.port.speed > 1
    soaking = Soaking(run.plan, run.journal, block_size(device.rate_hz), chamber)
    try:
        with Screen(plain) as screen, Keyboard() as keyboard:
            identity = _identity(run, stream, device)
            guide = Guide(run, stream, device.rate_hz, estimate, screen.bell, identity, trust, soaking)
            try:
                with _end_recorded(run.journal, stream, guide):
                    looks = 0
                    while guide.phase != Phase.FINISHED:
                        run.journal.check()
                        guide.take(stream.poll())
                        for key in keyboard.pressed():
                            guide.press(key)
                        looks += 1
                        if looks % _LOOKS_A_DRAWING == 0 or fast:
                            screen.show(view_of(guide))
                        pause(_FAST_LOOK_S if fast else _LOOK_S)
            finally:
                guide.worker.close()
    finally:
        soaking.close(finished=run.complete)


def _chamber(run: RunFolder, given: Chamber | None) -> Chamber | None:
    """The chamber of a plan over temperature; None for other plans. The criterion and a costly order are printed."""
    plan = run.plan
    if not plan.over_temperature:
        return given
    print(f"a temperature is stable if, {plan.soak.words}")
    temperatures = [step.temperature_degc for step in plan.steps]
    if warning := order_warning(temperatures, plan.soak.stable_min):
        print(f"warning: {warning}")
        run.journal.write("warned", text=warning)
    return given or chamber_of(plan.chamber)


def _identity(run: RunFolder, stream: LiveStream, device: Device) -> Identity:
    """The instrument with which the run began; the present one for a new run."""
    configuration = run.state.configuration or next((e for e in device.events if e["kind"] == "configuration"), {})
    began = run.state.serial_number or device.serial_number
    confirmed = device.serial_number is not None
    queries = stream.protocol.queries
    return Identity(stream.recording.send, queries, began, configuration.get("raw"), confirmed=confirmed)


def _settings(run: RunFolder, device_protocol: Protocol) -> Settings | None:
    plan, stated = run.plan, run.state.configuration
    if device_protocol.range_from_stream and stated is not None and "range_g" in stated:
        return settings_of(stated)
    if plan.port.range_g is not None:
        device_protocol.check_range(plan.port.range_g, f"port.range_g: {plan.port.range_g:g}")
    return device_protocol.settings(plan.port.range_g, plan.port.rate_hz)
