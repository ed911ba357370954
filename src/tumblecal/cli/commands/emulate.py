"""`tumblecal emulate`: a virtual instrument behind a pseudo-terminal."""

import contextlib
import math
from pathlib import Path

from tumblecal.cli.options import EffectFiles, Positive
from tumblecal.ground.errors import InputError


def emulate(
    config: Path,
    /,
    *,
    port: Path = Path("virtual-imu"),
    speed: Positive = 1.0,
    follow: Path | None = None,
    seconds: Positive | None = None,
    ledger: Path | None = None,
    chamber: Path | None = None,
    mount: str | None = None,
    effects: EffectFiles = (),
) -> None:
    """Emulate an instrument on a dividing head: open a virtual serial port and send the bytes of such a device.

    Commands: ALPHA BETA turns the head; chamber DEGC sets the temperature chamber; knock disturbs the head; restart; quit.
    With --follow the head turns to the angles that a capture requests, and the chamber goes to its temperatures.

    Parameters
    ----------
    config
        Instrument file (TOML), such as configs/capture_emulator.toml.
    port
        Name of the virtual port, to be given to tumblecal capture. Example: --port virtual-imu.
    speed
        Device seconds per second; port.speed of the plan must have the same value. Example: --speed 20.
    follow
        Folder of a capture whose requests turn the head; it need not exist yet. Default: typed commands. Example:
        --follow run1.
    seconds
        Duration in device seconds. Default: until it is stopped. Example: --seconds 600.
    ledger
        Record (JSON) of the samples that were made, damaged and lost. Default: none. Example: --ledger ledger.json.
    chamber
        Name of the port of the virtual chamber, to be given to tumblecal capture. Default: none. Example: --chamber
        virtual-chamber.
    mount
        Mounting of the triad, a label of the rig file. Default: the first one of its plan. Example: --mount B.
    """
    from tumblecal.capture.emulator.config import read_emulation
    from tumblecal.capture.emulator.device import VirtualDevice, ideal
    from tumblecal.capture.emulator.instrument import VirtualInstrument
    from tumblecal.capture.emulator.operator import Follower, Typist
    from tumblecal.capture.run.stop_signals import StopSignals
    from tumblecal.cli.endings import end_by
    from tumblecal.data.overwriting import protect_inputs

    for made in (ledger, port, chamber):
        protect_inputs([config, *effects], out=made)
    if chamber is not None and chamber.absolute() == port.absolute():
        raise InputError(f"emulate: --chamber {chamber} is also --port; give another name")
    wanted = read_emulation(config)
    if wanted.rig is None and mount is not None:
        raise InputError(f"--mount {mount}: {config} states no rig; add rig = and the file with [mounts.{mount}]")
    truth = ideal
    if wanted.rig is not None:
        from tumblecal.cli.start import start

        start()
        from tumblecal.effects import catalogue
        from tumblecal.simulation.instrument_truth import instrument_truth

        truth = instrument_truth(wanted, config, catalogue(*effects), mount)
    operator = Follower(follow, wanted) if follow is not None else Typist()
    with StopSignals() as signals:
        device = VirtualDevice(wanted, truth)
        instrument = VirtualInstrument(
            device, port, speed, lambda device: signals.received is None and operator(device), ledger, chamber
        )
        with contextlib.suppress(OSError):  # the terminal may be gone
            print(f"{device.protocol.title} at {port}, {device.rate_hz:g} Hz; Ctrl-C ends", flush=True)
        instrument.run(math.inf if seconds is None else seconds)
    with contextlib.suppress(OSError):
        print(f"sent {device.ledger.intact} complete samples of {device.ledger.generated}", flush=True)
        if device.ledger.warning():
            print(f"the emulator {device.ledger.warning()}", flush=True)
    if signals.received is not None:
        end_by(signals.received)
