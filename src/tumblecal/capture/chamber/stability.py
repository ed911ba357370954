"""Test whether a temperature is stable: near its target and changing slowly, for long enough."""

from collections import deque

import numpy as np

from tumblecal.capture.chamber.chamber_tables import RATE_FRACTION, SoakTable


# A rate needs this many readings; if they are rare, over a longer time.
_FEWEST = 3


class Stability:
    """Follows a temperature during a soak.

    **Arguments:**

    - `criterion`: of a stable temperature. `target_degc`: the expected temperature.

    `last_degc`: newest reading, NaN before the first. `rate_degc_per_min`: NaN until enough readings are there.
    `stable_min`: time for which the criterion has been met; `steady_min`: the same without the distance to the target.
    `changed`: whether any reading differed from the first one.
    """

    last_degc: float
    rate_degc_per_min: float
    changed: bool

    def __init__(self, criterion: SoakTable, target_degc: float):
        self.criterion, self.target_degc = criterion, target_degc
        self._window_min = RATE_FRACTION * criterion.stable_min
        self._recent: deque[tuple[float, float]] = deque()
        self._first: float | None = None
        self._steady_since = self._stable_since = self._now = np.inf
        self.last_degc = self.rate_degc_per_min = np.nan
        self.changed = False

    def take(self, now_min: float, degc: float) -> None:
        """Add a reading at a time that increases, min."""
        self._first = degc if self._first is None else self._first
        self.changed |= degc != self._first
        self._now, self.last_degc = now_min, degc
        self._recent.append((now_min, degc))
        while len(self._recent) > _FEWEST and now_min - self._recent[1][0] >= self._window_min:
            self._recent.popleft()
        self.rate_degc_per_min = self._rate()
        steady = abs(self.rate_degc_per_min) < self.criterion.rate_degc_per_min
        self._steady_since = min(self._steady_since, now_min) if steady else np.inf
        self._stable_since = min(self._stable_since, now_min) if steady and self.near else np.inf

    @property
    def near(self) -> bool:
        """Whether the newest reading is within the tolerance."""
        return abs(self.last_degc - self.target_degc) <= self.criterion.tolerance_degc

    @property
    def steady_min(self) -> float:
        """Time for which the rate has been small, min."""
        return max(self._now - self._steady_since, 0.0) if np.isfinite(self._steady_since) else 0.0

    @property
    def stable_min(self) -> float:
        """Time for which the criterion has been met, min."""
        return max(self._now - self._stable_since, 0.0) if np.isfinite(self._stable_since) else 0.0

    @property
    def stable(self) -> bool:
        """Whether the criterion has been met for long enough."""
        return self.stable_min >= self.criterion.stable_min

    def _rate(self) -> float:
        """Slope of the straight line through the recent readings, degC/min."""
        times, values = np.array(self._recent).T
        if len(times) < _FEWEST or times[-1] - times[0] < self._window_min:
            return np.nan
        times = times - times.mean()
        return float(times @ (values - values.mean()) / (times @ times))
