"""The dividing head, turned by hand: on request it moves for a while, shakes and comes to rest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


_SHAKE_DECAY_S = 0.3


@dataclass(frozen=True)
class Motion:
    """A turn from one position to another, in device time."""

    start_s: float
    stop_s: float
    before_deg: tuple[float, float]
    after_deg: tuple[float, float]


class DividingHead:
    """Position over device time.

    **Arguments:**

    - `alpha_deg`, `beta_deg`: initial position, deg.
    - `turn_s`: duration of a turn, s.
    - `knock_g`: shaking during a turn and just after, g.
    """

    def __init__(self, alpha_deg: float = 0.0, beta_deg: float = 0.0, turn_s: float = 2.0, knock_g: float = 0.02):
        here = (alpha_deg, beta_deg)
        self._turn_s, self._knock_g = turn_s, knock_g
        self._motion = Motion(-1e9, -1e9, here, here)
        self._knocks: list[float] = []

    def turn(self, alpha_deg: float, beta_deg: float, now_s: float) -> None:
        """Begin to turn to a position."""
        here = self.angles(now_s)
        self._motion = Motion(now_s, now_s + self._turn_s, here, (alpha_deg, beta_deg))

    def knock(self, now_s: float) -> None:
        """Bump against the table."""
        self._knocks.append(now_s)

    def angles(self, now_s: float) -> tuple[float, float]:
        """Spindle and pitch angle, deg."""
        m = self._motion
        part = float(np.clip((now_s - m.start_s) / (m.stop_s - m.start_s), 0, 1)) if m.stop_s > m.start_s else 1.0
        smooth = part * part * (3 - 2 * part)
        alpha, beta = (b + (a - b) * smooth for b, a in zip(m.before_deg, m.after_deg, strict=True))
        return alpha, beta

    def rates(self, now_s: float) -> NDArray[np.float64]:
        """Angular rate in the sensor's axes, deg/s, shape (3,): the spindle turns about x, the pitch axis follows."""
        m = self._motion
        if not m.start_s <= now_s < m.stop_s:
            return np.zeros(3)
        part = (now_s - m.start_s) / (m.stop_s - m.start_s)
        speed = 6 * part * (1 - part) / (m.stop_s - m.start_s)
        alpha, beta = ((a - b) * speed for b, a in zip(m.before_deg, m.after_deg, strict=True))
        turned = np.radians(self.angles(now_s)[0])
        return np.array([alpha, beta * np.cos(turned), -beta * np.sin(turned)])

    def shaking(self, times_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
        """The specific force of the shaking, g, shape (n, 3)."""
        size = np.where((times_s >= self._motion.start_s) & (times_s < self._motion.stop_s), self._knock_g, 0.0)
        for stop in (self._motion.stop_s, *self._knocks):
            since = times_s - stop
            size = size + np.where(since >= 0, self._knock_g * np.exp(-np.clip(since, 0, 50) / _SHAKE_DECAY_S), 0.0)
        self._knocks = [k for k in self._knocks if times_s[-1] - k < 10]
        return (
            random.normal(size=(len(times_s), 3)) * size[:, None] if size.max() > 1e-9 else np.zeros((len(times_s), 3))
        )
