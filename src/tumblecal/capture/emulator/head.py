"""The dividing head, turned by hand: on request it moves for a while, shakes and comes to rest."""

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.emulator.config import Head


_SHAKING_S = 0.5


class DividingHead:
    """Position over device time, s.

    **Arguments:**

    - `config`: initial angles, duration of a turn, and the shaking during a turn and just after.
    """

    def __init__(self, config: Head):
        self._turn_s, self._knock_g = config.turn_s, config.knock_g
        self._before = self._after = np.array([config.alpha_deg, config.beta_deg])
        self._start_s, self._shaken_until_s = -np.inf, 0.0

    def turn(self, alpha_deg: float, beta_deg: float, now_s: float) -> None:
        """Begin to turn to a position."""
        self._before, self._after, self._start_s = self.angles(now_s), np.array([alpha_deg, beta_deg]), now_s
        self._shaken_until_s = now_s + self._turn_s + _SHAKING_S

    def knock(self, now_s: float) -> None:
        """Bump against the table."""
        self._shaken_until_s = max(self._shaken_until_s, now_s + _SHAKING_S)

    def angles(self, now_s: float) -> NDArray[np.float64]:
        """Spindle and pitch angle, deg, shape (2,)."""
        part = self._turned(now_s)
        return self._before + (self._after - self._before) * part * part * (3 - 2 * part)

    def rates(self, now_s: float) -> NDArray[np.float64]:
        """Angular rate in the sensor's axes, deg/s, shape (3,): the spindle turns about x, the pitch axis follows."""
        part, turned = self._turned(now_s), np.radians(self.angles(now_s)[0])
        alpha, beta = (self._after - self._before) * 6 * part * (1 - part) / self._turn_s
        return np.array([alpha, beta * np.cos(turned), -beta * np.sin(turned)])

    def shaking(self, times_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
        """The specific force of the shaking, g, shape (n, 3)."""
        return random.normal(size=(len(times_s), 3)) * (self._knock_g * (times_s < self._shaken_until_s))[:, None]

    def _turned(self, now_s: float) -> float:
        """The part of the duration of the turn that has passed, 0 to 1."""
        return float(np.clip((now_s - self._start_s) / self._turn_s, 0, 1))
