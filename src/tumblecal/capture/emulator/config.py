"""What a virtual instrument is: a TOML file."""

from pathlib import Path

from pydantic import Field

from tumblecal.capture.toml import Strict, read_toml


class Instrument(Strict):
    """The device: protocol, serial number, range, rate."""

    protocol: str = "stim300"
    serial_number: str = "N25581846020020"
    range_g: float = 10.0
    rate_hz: float = Field(default=125.0, gt=0, le=20000)
    temperature_degc: float = 25.0
    start_up_s: float = Field(default=0.7, ge=0)


class Noise(Strict):
    """Noise of each axis: white density, a Gauss-Markov part, a random walk."""

    white_g_per_rthz: float = Field(default=41e-6, ge=0)
    markov_sd_g: float = Field(default=0.0, ge=0)
    markov_time_s: float = Field(default=100.0, gt=0)
    walk_g_per_rts: float = Field(default=0.0, ge=0)
    gyro_sd_dps: float = Field(default=0.01, ge=0)
    seed: int = 0


class Site(Strict):
    """Where it stands, for local gravity."""

    latitude_deg: float | None = Field(default=None, ge=-90, le=90)
    height_m: float = 0.0
    gravity_ms2: float | None = Field(default=None, gt=9.7, lt=9.9)


class Head(Strict):
    """The dividing head and the hand that turns it."""

    alpha_deg: float = 0.0
    beta_deg: float = 0.0
    turn_s: float = Field(default=2.0, gt=0)
    reaction_s: float = Field(default=1.0, ge=0)
    knock_g: float = Field(default=0.02, ge=0)


class Faults(Strict):
    """Faults on request; rates are events a second of device time, times are seconds of device time."""

    bit_flips_per_s: float = Field(default=0.0, ge=0)
    lost_bytes_per_s: float = Field(default=0.0, ge=0)
    garbage_per_s: float = Field(default=0.0, ge=0)
    missing_frames_per_s: float = Field(default=0.0, ge=0)
    stalls_per_s: float = Field(default=0.0, ge=0)
    overloads_per_s: float = Field(default=0.0, ge=0)
    unplug_at_s: list[float] = Field(default_factory=list)
    unplug_for_s: float = Field(default=1.0, gt=0)
    restart_at_s: list[float] = Field(default_factory=list)
    stall_longest_s: float = Field(default=0.4, gt=0)


class Mistake(Strict):
    """The hand turns to another position first, at the n-th prompt (counted from 1)."""

    at: int = Field(ge=1)
    alpha_offset_deg: float = 0.0
    beta_offset_deg: float = 0.0


class Emulation(Strict):
    """A virtual instrument on a dividing head; `rig` is a rig file whose truth it has, None an ideal one.

    `effects`: coefficients of effects of the catalogue by id, in the catalogue's units (only with a rig).
    """

    instrument: Instrument = Instrument()
    rig: str | None = None
    effects: dict[str, list[float]] = Field(default_factory=dict)
    noise: Noise = Noise()
    site: Site = Site()
    head: Head = Head()
    faults: Faults = Faults()
    mistake: list[Mistake] = Field(default_factory=list)


def read_emulation(path: Path) -> Emulation:
    """Read and check a virtual instrument.

    **Raises:** `InputError` listing all faults at once.
    """
    return read_toml(path, Emulation)
