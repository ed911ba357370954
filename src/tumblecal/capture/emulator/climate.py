"""The temperature of the virtual instrument: chamber, die and thermometer, and the errors of the sensor that follow it."""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.emulator.config import AxisPolynomials, Emulation
from tumblecal.ground.axes import AXES


class Climate:
    """A chamber with an instrument in it.

    The air follows its set point with a limited rate. The die follows the air plus self-heating, and the thermometer follows
    the die, each with a first-order lag: dT/dt = (input - T) / lag. The readings follow the die: A' = (1 + s(T)) A + b(T) + h,
    with polynomials s and b of T minus the reference without a constant. h is a play operator: its state follows the
    temperature at a distance of at most half the `hysteresis_degc`, so that the reading is +`hysteresis_mg` on a rising branch
    and -`hysteresis_mg` on a falling one, after a change of direction by `hysteresis_degc`.

    **Arguments:**

    - `config`: chamber, lags and coefficients.

    `air_degc`, `die_degc`, `thermometer_degc`: true temperature of the air and of the die, and reading of the thermometer.
    """

    air_degc: float
    die_degc: float
    thermometer_degc: float

    def __init__(self, config: Emulation):
        self._chamber, self._thermal = config.chamber, config.temperature
        self.air_degc = self.set_point_degc = config.instrument.temperature_degc
        self.die_degc = self.thermometer_degc = self._play = self.air_degc + self._thermal.self_heating_degc
        self._bias, self._scale = _coefficients(self._thermal.bias_mg), _coefficients(self._thermal.scale_mg_per_g)

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

    def applied(self, reading: NDArray[np.float64]) -> NDArray[np.float64]:
        """A reading of the sensor at the reference temperature, g, shape (3,), at the present temperature of the die."""
        powers = (self.die_degc - self._thermal.reference_degc) ** np.arange(1, self._bias.shape[1] + 1)
        half = self._thermal.hysteresis_degc / 2
        self._play = float(np.clip(self._play, self.die_degc - half, self.die_degc + half))
        loop = 1e-3 * np.array(self._thermal.hysteresis_mg) * (self.die_degc - self._play) / half
        return reading * (1 + self._scale @ powers) + self._bias @ powers + loop


def _fraction(seconds: float, lag_s: float) -> float:
    return float(-np.expm1(-seconds / lag_s)) if lag_s else 1.0


def _coefficients(given: AxisPolynomials) -> NDArray[np.float64]:
    """Coefficients of the powers from 1 to 9 for each axis, g, shape (3, 9)."""
    return 1e-3 * np.array([np.pad(row, (0, 9 - len(row))) for row in (getattr(given, axis) for axis in AXES)])
