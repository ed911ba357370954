"""Time and temperature of new positions: the conditions under which a proposal is evaluated.

The conditions of new readings separate a drift from a dependence on temperature more than their angles do. Every promise is
therefore made for stated conditions.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from tumblecal.chain.where import LEAST_RANGE_DEGC
from tumblecal.data import PositionSet
from tumblecal.ground.soaks import soaks


# The trend of the temperature is that of the last positions, by this share of all.
_TREND_SHARE = 0.25
# A smaller range of temperatures (degC) counts as none; the unit is then warmed by the second number.
_LEAST_RANGE_DEGC, _WARMER_DEGC = 1.0, 5.0
# Pauses before the new positions, as shares of the duration of the measurement.
_PAUSES = (0.5, 1.0)
# More separate temperatures than these are a ramp.
_MOST_SOAKS = 12


class Conditions(NamedTuple):
    """Conditions of the new positions.

    - `after_s`: pause from the last position to the first new one; `time_s`: its time by the clock of the data; `step_s`: from
      one new position to the next. None, None and 0 without times.
    - `temperature_degc`: of the new positions; None without temperatures. `last_temperature_degc`: of the last position.
    - `run`: label of the run that they belong to.
    """

    after_s: float | None
    time_s: float | None
    step_s: float
    temperature_degc: float | None
    last_temperature_degc: float | None
    run: str

    @property
    def at_another_temperature(self) -> bool:
        """Whether the temperature must be changed first."""
        if self.temperature_degc is None or self.last_temperature_degc is None:
            return False
        return abs(self.temperature_degc - self.last_temperature_degc) >= _LEAST_RANGE_DEGC

    @property
    def waited(self) -> bool:
        """Whether the new positions are measured after a pause, not directly after the others."""
        return self.after_s is not None and self.after_s > self.step_s


def continued(data: PositionSet) -> Conditions:
    """The conditions of positions that are measured directly after the data: the temperature follows its last trend."""
    run = (data.run or ("1",))[-1]
    temperature = None if data.temperature_degc is None else np.asarray(data.temperature_degc, float)
    if data.time_s is None:
        last = None if temperature is None else float(temperature[-1])
        return Conditions(None, None, 0.0, last, last, run)
    time, clock = np.asarray(data.time_s, float), np.asarray(data.clock or ("1",) * len(data))
    rows = np.flatnonzero(clock == clock[-1])
    rows = rows[np.argsort(time[rows], kind="stable")]
    step = float(np.median(np.diff(time[rows]))) if len(rows) > 1 else 0.0
    if temperature is None:
        return Conditions(step, float(time[rows[-1]]) + step, step, None, None, run)
    last = float(temperature[rows[-1]])
    late = rows[-max(3, round(_TREND_SHARE * len(rows))) :]
    slope = float(np.polyfit(time[late], temperature[late], 1)[0]) if np.ptp(time[late]) else 0.0
    return Conditions(step, float(time[rows[-1]]) + step, step, last + slope * step, last, run)


def candidates(data: PositionSet, *, in_time: bool, with_temperature: bool) -> Iterator[Conditions]:
    """Conditions under which new positions may be measured, least effort first.

    **Arguments:**

    - `in_time`, `with_temperature`: whether an explanation depends on the time, and on the temperature.
    """
    first = continued(data)
    yield first
    later = [first]
    if in_time and data.time_s is not None and first.time_s is not None and first.after_s is not None:
        pauses = [share * float(np.ptp(data.time_s)) for share in _PAUSES]
        later = [first._replace(after_s=pause, time_s=first.time_s - first.after_s + pause) for pause in pauses]
    others = _temperatures(data, first.last_temperature_degc) if with_temperature else []
    for conditions in later:
        if conditions is not first:
            yield conditions._replace(temperature_degc=first.last_temperature_degc)
        for degc in others:
            yield conditions._replace(temperature_degc=degc)


def _temperatures(data: PositionSet, last_degc: float | None) -> list[float]:
    """The end of the measured temperatures that is farther from the last one (without a range a warmer temperature), and the
    middle of the largest step of soaks."""
    if data.temperature_degc is None or last_degc is None:
        return []
    degc = np.asarray(data.temperature_degc, float)
    far, between = float(max(degc.min(), degc.max(), key=lambda end: abs(end - last_degc))), between_soaks(degc)
    others = [far if abs(far - last_degc) >= _LEAST_RANGE_DEGC else last_degc + _WARMER_DEGC]
    return others if between is None or abs(between - last_degc) < _LEAST_RANGE_DEGC else [*others, between]


def between_soaks(degc: np.ndarray) -> float | None:
    """The middle of the largest step between two neighbouring soaks, degC; None for soaks over a small range, or a ramp."""
    levels = np.array(soaks(degc))
    if not 1 < len(levels) <= _MOST_SOAKS or np.ptp(levels) < LEAST_RANGE_DEGC:
        return None
    widest = int(np.argmax(np.diff(levels)))
    return float(levels[widest : widest + 2].mean())
