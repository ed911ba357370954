"""The temperature of the virtual instrument: chamber, die and thermometer."""

import numpy as np

from tumblecal.capture.emulator.config import Emulation


# A smaller lag is none, s.
_LEAST_LAG_S = 1e-9


class Climate:
    """A chamber with an instrument in it.

    The air follows its set point with a limited rate. The die follows the air plus self-heating, and the thermometer follows
    the die, each with a first-order lag: dT/dt = (input - T) / lag.

    **Arguments:**

    - `config`: chamber and lags.

    `air_degc`, `die_degc`, `thermometer_degc`: true temperature of the air and of the die, and reading of the thermometer.
    """

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
        lags_s = np.maximum([thermal.die_lag_s, thermal.thermometer_lag_s], _LEAST_LAG_S)
        of_die, of_thermometer = (-np.expm1(-seconds / lags_s)).tolist()
        step = self._chamber.ramp_degc_per_min / 60 * seconds
        self.air_degc += float(np.clip(self.set_point_degc - air, -step, step))
        self.die_degc += ((air + self.air_degc) / 2 + thermal.self_heating_degc - die) * of_die
        self.thermometer_degc += ((die + self.die_degc) / 2 - self.thermometer_degc) * of_thermometer
