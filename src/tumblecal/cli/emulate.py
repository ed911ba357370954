"""`tumblecal emulate`: a virtual instrument behind a pseudo-terminal."""

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.cli.command import warn
from tumblecal.cli.options import EffectFiles, Positive
from tumblecal.ground.counted import counted
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.capture.emulator.config import Emulation
    from tumblecal.capture.emulator.device import TruthFunction


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
    from tumblecal.cli.interrupts import end_by
    from tumblecal.data.overwriting import protect_inputs

    for made in (ledger, port, chamber):
        protect_inputs([config, *effects], out=made)
    if chamber is not None and chamber.absolute() == port.absolute():
        raise InputError(f"emulate: --chamber {chamber} is also --port; give another name")
    wanted = read_emulation(config)
    if wanted.rig is None and mount is not None:
        raise InputError(f"--mount {mount}: {config} states no rig; add rig = and the file with [mounts.{mount}]")
    truth = ideal if wanted.rig is None else exact_truth(wanted, config, effects, mount)
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


def exact_truth(wanted: "Emulation", config: Path, files: tuple[Path, ...], mount: str | None) -> "TruthFunction":
    """Readings at a position by the exact chain of the rig with its true parameters, and effects in their catalogue's units.

    `config`: the file of the virtual instrument. `files`: Python files with user-defined effects. `mount`: the mounting;
    None: the first one of the rig's plan.

    **Raises:** `InputError` for an unknown effect, more values than its coefficients, or a mounting that the plan lacks.
    """
    from dataclasses import replace

    import numpy as np

    from tumblecal.cli.start import start

    start()
    import equinox as eqx

    from tumblecal.chain import Chain
    from tumblecal.effects import catalogue
    from tumblecal.effects.added_terms import base_unit
    from tumblecal.effects.catalogue import entry, first_link, read_rig_with_effects
    from tumblecal.ground.toml_faults import faults_at

    path, entries = (config.parent / str(wanted.rig)).resolve(), catalogue(*files)
    rig = read_rig_with_effects(path, entries)
    if "[head.noise]" in rig.tables_of_head:
        warn(path, ["[head.noise] is not used by `emulate`: the virtual instrument states its noise"])
    plan, count = rig.plan, len(rig.plan)
    mounted = np.array([label == (mount or plan.mounts[0]) for label in plan.mounts])
    if not mounted.any():
        known = ", ".join(dict.fromkeys(plan.mounts))
        raise InputError(f"--mount {mount}: {path} has no positions in this mounting; mountings of its plan: {known}")
    # Effects of the temperature need several soaks.
    degc = tuple(np.resize(np.linspace(0.0, 50.0, 6), count).tolist())
    conditions = replace(plan, time_s=(0.0,) * count, temperature_degc=degc, approach=(1.0,) * count)
    where = replace(rig, plan=conditions).where
    chain = rig.true_chain(where)
    for id, values in wanted.effects.items():
        with faults_at(config, f"effects.{id}"):
            effect = entry(entries, id)
            link, scale = first_link(effect, where), base_unit(effect.unit)[1]
            leaves = Chain((link,)).parameters
            factors = {name: 1.0 if leaf.unit == "s" else scale for leaf in leaves for name in leaf.names}
            if len(factors) < len(values):
                raise InputError(f"{len(values)} values, but it has {counted(len(factors), 'coefficient')}")
            stated = zip(factors.items(), values, strict=False)
            chain = (chain + link).named({name: factor * value for (name, factor), value in stated})
    evaluate = eqx.filter_jit(lambda chain, where: chain(where))

    def truth(alpha_deg: float, beta_deg: float, time_s: float, temperature_degc: float):
        alpha, beta = np.radians([alpha_deg, beta_deg])
        # Each pitch setting of the rig has an error, and each visit of it in a plan of visits: that of the nearest position.
        turned = np.abs(np.sin((plan.alpha - alpha) / 2))
        row = int(np.lexsort((turned, np.round(np.abs(plan.beta - beta), 9), ~mounted))[0])
        here = np.arange(count) == row
        now = replace(
            where,
            alpha=np.where(here, alpha, plan.alpha),
            beta=np.where(here, beta, plan.beta),
            # The time of effects begins at the first position, so the other rows remain at zero.
            time_s=np.where(here, time_s, 0.0),
            temperature_degc=np.full(count, temperature_degc),
        )
        return np.asarray(evaluate(chain, now))[row]

    return truth
