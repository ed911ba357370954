"""Time and temperature of new positions: the conditions under which a proposal is evaluated.

The conditions of new readings separate a drift from a dependence on temperature more than their angles do. Every promise is
therefore made for stated conditions.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from tumblecal.chain.where import LEAST_RANGE_DEGC
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnosis
from tumblecal.effects.temperature import reached_from
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
    run, rows = (data.run or ("1",))[-1], np.arange(len(data))
    after = time = None
    step = slope = 0.0
    if data.time_s is not None:
        clock = np.asarray(data.labels("clock"))
        rows = rows[clock == clock[-1]]
        rows = rows[np.argsort(data.time_s[rows], kind="stable")]
        after = step = float(np.median(np.diff(data.time_s[rows]))) if len(rows) > 1 else 0.0
        time = float(data.time_s[rows[-1]]) + step
        late = rows[-max(3, round(_TREND_SHARE * len(rows))) :]
        if data.temperature_degc is not None and np.ptp(data.time_s[late]):
            slope = float(np.polyfit(data.time_s[late], data.temperature_degc[late], 1)[0])
    last = None if data.temperature_degc is None else float(data.temperature_degc[rows[-1]])
    return Conditions(after, time, step, None if last is None else last + slope * step, last, run)


def candidates(data: PositionSet, *, in_time: bool, with_temperature: bool) -> Iterator[Conditions]:
    """Conditions under which new positions may be measured, least effort first.

    The temperatures are the end of the measured ones that is farther from the last one (without a range a warmer temperature),
    and the middle of the largest step of soaks.

    **Arguments:**

    - `in_time`, `with_temperature`: whether an explanation depends on the time, and on the temperature.
    """
    first, later, others = continued(data), list[Conditions](), list[float]()
    yield first
    if in_time and data.time_s is not None and first.time_s is not None and first.after_s is not None:
        for pause in np.multiply(_PAUSES, np.ptp(data.time_s)).tolist():
            time = first.time_s - first.after_s + pause
            later.append(first._replace(after_s=pause, time_s=time, temperature_degc=first.last_temperature_degc))
    if with_temperature and data.temperature_degc is not None and first.last_temperature_degc is not None:
        degc, last = data.temperature_degc, first.last_temperature_degc
        far = float(max(degc.min(), degc.max(), key=lambda end: abs(end - last)))
        others.append(far if abs(far - last) >= _LEAST_RANGE_DEGC else last + _WARMER_DEGC)
        if (between := between_soaks(degc)) is not None and abs(between - last) >= _LEAST_RANGE_DEGC:
            others.append(between)
    for conditions in later or [first]:
        if later:
            yield conditions
        for degc in others:
            yield conditions._replace(temperature_degc=degc)


def between_soaks(degc: np.ndarray) -> float | None:
    """The middle of the largest step between two neighbouring soaks, degC; None for soaks over a small range, or a ramp."""
    levels = np.array(soaks(degc))
    if not 1 < len(levels) <= _MOST_SOAKS or np.ptp(levels) < LEAST_RANGE_DEGC:
        return None
    widest = int(np.argmax(np.diff(levels)))
    return float(levels[widest : widest + 2].mean())


def temperature_notes(diagnosis: Diagnosis) -> Iterator[str]:
    """Instructions that test the causes of temperature among the explanations; none without such a cause."""
    where, degc = diagnosis.problem.where, diagnosis.data.temperature_degc
    ids = {label.partition(":")[0] for labels in (diagnosis.best.labels, *diagnosis.best.stated) for label in labels}
    entries = [diagnosis.entries[id] for id in sorted(ids) if id in diagnosis.entries]
    thermal = [entry for entry in entries if "temperature_degc" in entry.needs]
    if degc is None or not thermal or where.soaks < 2:
        return
    between = between_soaks(degc)
    if between is not None and any(entry.over_temperature for entry in thermal):
        yield f"A further soak at {between:.1f} degC, between those measured, tests the order of the dependence on temperature."
    if where.time_s is None:
        return
    one_way = not np.any(np.asarray(reached_from(where)))
    if one_way or any(entry.id.startswith("bias_hysteresis") for entry in thermal):
        yield (
            "Measure the same temperatures again in the reverse order: a hysteresis changes its sign with the direction, a "
            f"drift does not{'; these data reach them in one direction only' if one_way else ''}."
        )
    if any(entry.id.startswith(("temperature_rate", "temperature_lag")) for entry in thermal):
        yield (
            "Repeat the change of temperature at half of its rate: an error by the rate or by the lag of the thermometer is "
            "then half as large, a hysteresis is unchanged."
        )
