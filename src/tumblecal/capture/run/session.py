"""The guided run on a locked folder: recorder, device, guide, screen and keys together."""

from collections.abc import Callable
from contextlib import ExitStack, suppress

from tumblecal.capture.chamber import Chamber, Soak
from tumblecal.capture.journal import RAW_NAME, RunState
from tumblecal.capture.port.live import LiveStream, Recording
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.protocols import protocol
from tumblecal.capture.run.contact import Contact, await_port
from tumblecal.capture.run.guide import Guide
from tumblecal.capture.run.run_folder import RunFolder, settings_of_run
from tumblecal.capture.run.screen import Estimate, Screen
from tumblecal.capture.run.stop_signals import Stopped, StopSignals
from tumblecal.ground.errors import InputError


_LOOK_S, _FAST_LOOK_S = 0.25, 0.05


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
    plan, journal, port = run.plan, run.journal, run.plan.port
    spoken = protocol(port.protocol)
    if journal.state.device:
        still = confirm()
        journal.write("resumed", still_mounted=still, clocks=clocks())
        if not still:
            raise InputError("the instrument was removed, so its angles to the head are new; begin a new run")
    if port.range_g is not None:
        spoken.check_range(port.range_g, f"port.range_g: {port.range_g:g}")
    stream = guide = None
    with StopSignals() as signals, ExitStack() as ends:
        try:
            await_port(port.url, wait_s, signals.pause)
            recording = Recording(run.folder / RAW_NAME, port.url, port.baud or spoken.bauds[0])
            ends.callback(recording.stop)
            stream = LiveStream(recording, spoken, settings_of_run(journal.state, plan, spoken))
            contact = Contact(run, stream, trust=trust)
            contact.meet(signals.pause)
            if plan.over_temperature:
                print(f"a temperature is stable if, {plan.soak.words}")
                chamber = chamber or (Chamber(plan.chamber) if plan.chamber.url else None)
            soak = Soak(plan, journal, contact.rate_hz, chamber)
            ends.callback(lambda: soak.close(finished=run.complete))
            screen = ends.enter_context(Screen(plain, estimate))
            guide = Guide(run, contact, soak, screen.pressed, screen.bell)
            for _ in guide.run():
                journal.check()
                screen.show(guide)
                signals.pause(_FAST_LOOK_S if port.speed > 1 else _LOOK_S)
        except (InputError, Stopped) as end:
            with suppress(InputError):
                if guide is not None:
                    guide.interrupt(str(end))
                journal.write("stopped", why=str(end), tally=stream.tally.as_dict() if stream else {})
            raise
    return journal.state
