"""The temperature of the virtual instrument: chamber, die and thermometer."""

import numpy as np

from tumblecal.capture.emulator.config import Emulation


class Climate:
    """A chamber with an instrument in it.

    The air follows its set point with a limited rate. The die follows the air plus self-heating, and the thermometer follows
    the die, each with a first-order lag: dT/dt = (input - T) / lag.

    **Arguments:**

    - `config`: chamber and lags.

    `air_degc`, `die_degc`, `thermometer_degc`: true temperature of the air and of the die, and reading of the thermometer.
    """

    air_degc: float
    die_degc: float
    thermometer_degc: float

    def __init__(self, config: Emulation):
        self._chamber, self._thermal = config.chamber, config.temperature
        self.air_degc = self.set_point_degc = config.instrument.temperature_degc
        self.die_degc = self.thermometer_degc = self.air_degc + self._thermal.self_heating_degc

    def set_temperature(self, degc: float) -> None:
        """Request a temperature within the limits of the chamber."""
        self.set_point_degc = float(np.clip(degc, self._chamber.lowest_degc, self._chamber.highest_degc))

    def advance(self, seconds: float) -> None:
        """Let time pass, in steps that are short compared with the lags."""
        thermal, air, die = self._thermal, self.air_degc, self.die_degc
        step = self._chamber.ramp_degc_per_min / 60 * seconds
        self.air_degc += float(np.clip(self.set_point_degc - air, -step, step))
        surrounding = (air + self.air_degc) / 2 + thermal.self_heating_degc
        self.die_degc += (surrounding - die) * _fraction(seconds, thermal.die_lag_s)
        middle = (die + self.die_degc) / 2
        self.thermometer_degc += (middle - self.thermometer_degc) * _fraction(seconds, thermal.thermometer_lag_s)


def _fraction(seconds: float, lag_s: float) -> float:
    return float(-np.expm1(-seconds / lag_s)) if lag_s else 1.0
