"""The dividing head, turned by hand: on request it moves for a while, shakes and comes to rest."""

import numpy as np
from numpy.typing import NDArray


_SHAKING_S, _STEP_S = 0.5, 1e-3


class DividingHead:
    """Position over device time.

    **Arguments:**

    - `alpha_deg`, `beta_deg`: initial position, deg.
    - `turn_s`: duration of a turn, s.
    - `knock_g`: shaking during a turn and just after, g.
    """

    def __init__(self, alpha_deg: float = 0.0, beta_deg: float = 0.0, turn_s: float = 2.0, knock_g: float = 0.02):
        self._turn_s, self._knock_g = turn_s, knock_g
        self._start_s = -np.inf
        self._before = self._after = np.array([alpha_deg, beta_deg])
        # Beginning and end of each shaking.
        self._shaken = list[tuple[float, float]]()

    def turn(self, alpha_deg: float, beta_deg: float, now_s: float) -> None:
        """Begin to turn to a position."""
        self._before, self._after = np.array(self.angles(now_s)), np.array([alpha_deg, beta_deg])
        self._start_s = now_s
        self._shaken.append((now_s, now_s + self._turn_s + _SHAKING_S))

    def knock(self, now_s: float) -> None:
        """Bump against the table."""
        self._shaken.append((now_s, now_s + _SHAKING_S))

    def angles(self, now_s: float) -> tuple[float, float]:
        """Spindle and pitch angle, deg."""
        part = np.clip((now_s - self._start_s) / self._turn_s, 0, 1)
        alpha, beta = self._before + (self._after - self._before) * part * part * (3 - 2 * part)
        return float(alpha), float(beta)

    def rates(self, now_s: float) -> NDArray[np.float64]:
        """Angular rate in the sensor's axes, deg/s, shape (3,): the spindle turns about x, the pitch axis follows."""
        ahead, behind = np.array(self.angles(now_s + _STEP_S)), np.array(self.angles(now_s - _STEP_S))
        alpha, beta = (ahead - behind) / (2 * _STEP_S)
        turned = np.radians(self.angles(now_s)[0])
        return np.array([alpha, beta * np.cos(turned), -beta * np.sin(turned)])

    def shaking(self, times_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
        """The specific force of the shaking, g, shape (n, 3)."""
        self._shaken = [(start_s, stop_s) for start_s, stop_s in self._shaken if stop_s > times_s[0]]
        shaken = np.zeros(len(times_s), bool)
        for start_s, stop_s in self._shaken:
            shaken |= (times_s >= start_s) & (times_s < stop_s)
        return random.normal(size=(len(times_s), 3)) * (self._knock_g * shaken)[:, None]
