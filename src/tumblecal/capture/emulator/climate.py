"""The temperature of the virtual instrument: chamber, die and thermometer, and the errors of the sensor that follow it."""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.emulator.config import Emulation, Ramp
from tumblecal.ground.axes import AXES


class VirtualChamber:
    """A chamber with an instrument in it; a `Chamber` of a capture.

    The air follows its set point with a limited rate. The die follows the air plus self-heating, and the thermometer follows
    the die, each with a first-order lag: dT/dt = (input - T) / lag.

    **Arguments:**

    - `config`: chamber, its profile, and lags.

    `air_degc`, `die_degc`, `thermometer_degc`: true temperature of the air and of the die, and reading of the thermometer.
    """

    name = "virtual chamber"
    air_degc: float
    die_degc: float
    thermometer_degc: float

    def __init__(self, config: Emulation):
        self._chamber, self._thermal = config.chamber, config.temperature
        start = config.instrument.temperature_degc
        self.air_degc = start
        self.die_degc = self.thermometer_degc = start + self._thermal.self_heating_degc
        self.set_point_degc, self._rate = start, self._chamber.ramp_degc_per_min
        self._profile: list[Ramp] = list(config.chamber.profile)
        self._hold_s = 0.0

    def set_temperature(self, degc: float) -> None:
        """Request a temperature within the limits of the chamber; a profile ends."""
        self._profile = []
        self.set_point_degc = float(np.clip(degc, self._chamber.lowest_degc, self._chamber.highest_degc))
        self._rate = self._chamber.ramp_degc_per_min

    def temperature(self) -> float:
        """The temperature of the air, degC."""
        return self.air_degc

    def close(self) -> None:
        """Nothing."""

    def advance(self, seconds: float) -> None:
        """Let time pass, in steps that are short compared with the lags."""
        before = self.air_degc
        self._move_air(seconds)
        middle = (before + self.air_degc) / 2
        thermal = self._thermal
        die = self.die_degc
        self.die_degc += (middle + thermal.self_heating_degc - die) * _fraction(seconds, thermal.die_lag_s)
        middle = (die + self.die_degc) / 2
        self.thermometer_degc += (middle - self.thermometer_degc) * _fraction(seconds, thermal.thermometer_lag_s)

    def _move_air(self, seconds: float) -> None:
        if self._profile and self.air_degc == self.set_point_degc:
            self._hold_s -= seconds
            if self._hold_s <= 0:
                ramp = self._profile.pop(0)
                self.set_point_degc, self._hold_s = ramp.to_degc, 60 * ramp.hold_min
                self._rate = ramp.degc_per_min or self._chamber.ramp_degc_per_min
        step = self._rate / 60 * seconds
        self.air_degc += float(np.clip(self.set_point_degc - self.air_degc, -step, step))


def _fraction(seconds: float, lag_s: float) -> float:
    return float(-np.expm1(-seconds / lag_s)) if lag_s else 1.0


class ThermalErrors:
    """Errors of the readings that follow the temperature of the die: A' = (1 + s(T)) A + b(T) + loop.

    s and b are polynomials of T minus the reference without a constant. The loop is a play operator: its state follows the
    temperature at a distance of at most half the `hysteresis_degc`, so that the reading is +`hysteresis_mg` on a rising branch
    and -`hysteresis_mg` on a falling one, after a change of direction by `hysteresis_degc`.

    **Arguments:**

    - `config`: coefficients.
    - `start_degc`: temperature at the beginning.
    """

    def __init__(self, config: Emulation, start_degc: float):
        self._thermal = config.temperature
        bias, scale = self._thermal.bias_mg, self._thermal.scale_mg_per_g
        order = max(len(row) for given in (bias, scale) for row in (given.x, given.y, given.z))
        self._bias, self._scale = (
            1e-3 * np.array([[*getattr(given, axis), *[0.0] * order][:order] for axis in AXES])
            for given in (bias, scale)
        )
        self._loop_g = 1e-3 * np.array(self._thermal.hysteresis_mg, float)
        self._play = start_degc

    def applied(self, reading: NDArray[np.float64], die_degc: float) -> NDArray[np.float64]:
        """A reading of the sensor at the reference temperature, g, shape (3,), at a temperature of the die."""
        above = die_degc - self._thermal.reference_degc
        powers = above ** np.arange(1, self._bias.shape[1] + 1)
        half = self._thermal.hysteresis_degc / 2
        self._play = float(np.clip(self._play, die_degc - half, die_degc + half))
        loop = self._loop_g * (die_degc - self._play) / half
        return reading * (1 + self._scale @ powers) + self._bias @ powers + loop
