"""The description of a virtual instrument: a TOML file."""

from functools import partial
from pathlib import Path

import numpy as np
from pydantic import Field

from tumblecal.capture.capture_plan import Celsius, NotNegative, Positive, Site, check_kind
from tumblecal.capture.protocols import protocol
from tumblecal.ground.strict_toml import Number, Seed, Strict, checked, read_toml
from tumblecal.ground.toml_faults import faults_at
from tumblecal.noise import Flicker, GaussMarkov, Noise, RandomWalk, White


class Instrument(Strict):
    """The device: protocol, serial number, range, rate; whether it answers commands.

    `temperature_degc`: at the beginning. `temperatures`: whether a STIM300 sends them; by default with a table chamber or
    temperature.
    """

    protocol: str = "stim300"
    serial_number: str = "N25581846020020"
    range_g: Number = 10.0
    rate_hz: Number = Field(default=125.0, gt=0, le=20000)
    temperature_degc: Number = 25.0
    temperatures: bool | None = None
    start_up_s: NotNegative = 0.7
    answers: bool = True


class InstrumentNoise(Strict):
    """Noise of each axis, by its parts."""

    white_g_per_rthz: NotNegative = 41e-6
    flicker_g: NotNegative = 0.0
    markov_sd_g: NotNegative = 0.0
    markov_time_s: Positive = 100.0
    walk_g_per_rts: NotNegative = 0.0
    gyro_sd_dps: NotNegative = 0.01
    seed: Seed = 0

    @property
    def model(self) -> Noise:
        """The accelerometers' noise."""
        kinds = (
            (White, self.white_g_per_rthz),
            (Flicker, self.flicker_g),
            (partial(GaussMarkov, time_s=float(self.markov_time_s)), self.markov_sd_g),
            (RandomWalk, self.walk_g_per_rts),
        )
        return Noise(tuple(kind(np.full(3, float(size))) for kind, size in kinds if size))


class VirtualChamberTable(Strict):
    """The chamber around the instrument: rate and limits of its air."""

    ramp_degc_per_min: Positive = 2.0
    lowest_degc: Celsius = -70.0
    highest_degc: Celsius = 180.0


class ThermalTable(Strict):
    """Temperature of the die and of the thermometer in the instrument; effects of the temperature follow the die.

    Lags are of the die behind the air and of the thermometer behind the die.
    """

    die_lag_s: NotNegative = 0.0
    thermometer_lag_s: NotNegative = 0.0
    self_heating_degc: Number = 0.0
    thermometer_noise_degc: NotNegative = 0.0


class Head(Strict):
    """The dividing head and the hand that turns it."""

    alpha_deg: Number = 0.0
    beta_deg: Number = 0.0
    turn_s: Positive = 2.0
    reaction_s: NotNegative = 1.0
    knock_g: NotNegative = 0.02


class Faults(Strict):
    """Faults on request; rates are events a second of device time, times are seconds of device time."""

    missing_frames_per_s: NotNegative = 0.0
    stalls_per_s: NotNegative = 0.0
    overloads_per_s: NotNegative = 0.0
    unplug_at_s: list[Number] = Field(default_factory=list)
    unplug_for_s: Positive = 1.0


class Mistake(Strict):
    """The hand turns to another position first, at the n-th prompt (counted from 1)."""

    at: int = Field(ge=1)
    alpha_offset_deg: Number = 0.0
    beta_offset_deg: Number = 0.0


class Emulation(Strict):
    """A virtual instrument on a dividing head; `rig`: a rig file with its true parameters; None for an ideal one.

    `effects`: coefficients of effects of the catalogue by id, in its units, time constants in s (only with a rig).
    """

    instrument: Instrument = Instrument()
    rig: str | None = None
    effects: dict[str, list[Number]] = Field(default_factory=dict)
    noise: InstrumentNoise = InstrumentNoise()
    site: Site = Site()
    head: Head = Head()
    chamber: VirtualChamberTable = VirtualChamberTable()
    temperature: ThermalTable = ThermalTable()
    faults: Faults = Faults()
    mistake: list[Mistake] = Field(default_factory=list)

    @property
    def sends_temperatures(self) -> bool:
        """Whether the samples have temperatures, if that is a setting of the protocol."""
        stated = self.instrument.temperatures
        return bool({"chamber", "temperature"} & self.model_fields_set) if stated is None else stated


def read_emulation(path: Path) -> Emulation:
    """Read and check a virtual instrument.

    **Raises:** `InputError` with all faults; for the plan of a capture, with this fault only; for a range that the device does
    not have.
    """
    content = read_toml(path)
    check_kind(path, content, "emulate")
    emulation = checked(path, content, Emulation)
    with faults_at(path, "instrument"):
        protocol(emulation.instrument.protocol).check_range(emulation.instrument.range_g, "range_g")
    return emulation
