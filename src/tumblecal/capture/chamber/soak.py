"""The soaks of a guided run: requests a temperature and waits until it is stable."""

import time
from collections import deque
from typing import Any

import numpy as np

from tumblecal.capture.capture_plan import RATE_FRACTION, CapturePlan, SoakTable
from tumblecal.capture.chamber.chamber import Chamber
from tumblecal.capture.journal import Journal
from tumblecal.capture.port.live import Arrived
from tumblecal.ground.errors import InputError


OPERATOR = "operator"
# A rate needs this many readings; if they are rare, over a longer time.
_FEWEST = 3
# Seconds of the device's time between two queries of the chamber, and the shortest time by the host's clock.
_QUERY_S, _LEAST_QUERY_S = 5.0, 0.1


class Stability:
    """Follows a temperature during a soak, in minutes of the device's time.

    **Arguments:**

    - `criterion`: of a stable temperature. `target_degc`: the expected temperature.

    `degc`: newest reading, NaN before the first. `rate_degc_per_min`: NaN until enough readings are there.
    `stable_min`: time for which the criterion has been met; `steady_min`: the same without the distance to the target.
    """

    def __init__(self, criterion: SoakTable, target_degc: float):
        self.criterion, self.target_degc = criterion, target_degc
        self._recent = deque[tuple[float, float]]()
        self._steady_since = self._stable_since = np.inf
        self.degc = self.rate_degc_per_min = np.nan
        self.steady_min = self.stable_min = 0.0

    def take(self, now_min: float, degc: float) -> None:
        """Add a reading at a time that increases."""
        window_min = RATE_FRACTION * self.criterion.stable_min
        self.degc, self.rate_degc_per_min = degc, np.nan
        self._recent.append((now_min, degc))
        while len(self._recent) > _FEWEST and now_min - self._recent[1][0] >= window_min:
            self._recent.popleft()
        times, values = np.array(self._recent).T
        if len(times) >= _FEWEST and times[-1] - times[0] >= window_min:
            self.rate_degc_per_min = float(np.polyfit(times - now_min, values, 1)[0])
        steady = abs(self.rate_degc_per_min) < self.criterion.rate_degc_per_min
        self._steady_since = min(self._steady_since, now_min) if steady else np.inf
        self._stable_since = min(self._stable_since, now_min) if steady and self.near else np.inf
        self.steady_min, self.stable_min = max(now_min - self._steady_since, 0), max(now_min - self._stable_since, 0)

    @property
    def near(self) -> bool:
        """Whether the newest reading is within the tolerance."""
        return abs(self.degc - self.target_degc) <= self.criterion.tolerance_degc


class Soak:
    """Requests the temperature of a position and waits until it is stable.

    **Arguments:**

    - `plan`: positions, criterion. `journal`: for the requests and their results. `rate_hz`: sample rate.
    - `chamber`: None for the operator.

    `wanted_degc`: the requested temperature, and its `stability`: None before the first request. `waiting`: whether it is not
    stable yet; `left`: whether it left the tolerance since it was. `alarm`, `fault`: the present faults of the temperature and
    of the chamber; empty for none.
    """

    stability: Stability | None

    def __init__(self, plan: CapturePlan, journal: Journal, rate_hz: float, chamber: Chamber | None = None):
        self._plan, self._journal, self._chamber = plan, journal, chamber
        self._soak, self._chamber_degc = None, None
        self._ask_at_s = self._began_s = 0.0
        # Temperatures of about a second are averaged.
        self._count, self._values, self._sensor = round(rate_hz), np.zeros(0), False
        self.wanted_degc, self.stability, self.alarm, self.fault = np.nan, None, "", ""
        self.waiting = self.left = False

    def begin(self, position: int) -> None:
        """Request the temperature of a position, unless it is there or already waited for.

        **Raises:** `InputError` if the chamber does not accept it.
        """
        wanted, soak = self._plan.steps[position].temperature_degc, self._plan.soaks[position]
        if wanted is None or (soak == self._soak and not self.left):
            return
        self._soak, self.wanted_degc, self._began_s = soak, wanted, time.monotonic()
        self.waiting, self.left, self.alarm = True, False, ""
        self.stability = Stability(self._plan.soak, wanted + self._plan.soak.offset_degc)
        name = OPERATOR if self._chamber is None else self._chamber.name
        self._write("soak", position=position, chamber=name, criterion=self._plan.soak.model_dump())
        if self._chamber is not None:
            self._chamber.set_temperature(wanted)

    def take(self, part: Arrived) -> None:
        """Continue with new samples.

        **Raises:** `InputError` if the temperature is not stable in time, or the chamber fails while it is waited for.
        """
        if self.stability is None:
            return
        answered, degc = self._ask(), part.samples.temperature
        self._values = np.append(self._values, degc[np.isfinite(degc)])
        if len(self._values) >= self._count:
            self._sensor = True
            self._follow(float(part.host_s[-1]), float(self._values.mean()))
            self._values = self._values[:0]
        elif answered is not None and not self._sensor:
            self._follow(time.monotonic(), answered)
        elif self.waiting and not self._sensor and self._chamber_degc is None:
            self.alarm = "neither instrument nor chamber state a temperature; press Enter when it is stable"
        if self.waiting and self._waited_min > self._plan.soak.timeout_min:
            raise InputError(
                f"soak at {self.wanted_degc:g} degC: not stable after {self._waited_min:.0f} min, {self.note}"
                f"{self.alarm and f': {self.alarm}'}. The positions done are stored; correct it, then --resume"
            )

    def _ask(self) -> float | None:
        """Ask the chamber for its temperature when it is due; a new one."""
        if self._chamber is None or time.monotonic() < self._ask_at_s:
            return None
        try:
            self._chamber_degc, self.fault = self._chamber.temperature(), ""
        except InputError as error:
            # During a dwell the temperature is still measured; the next soak needs the chamber.
            if self.waiting:
                raise
            if not self.fault:
                self._write("warned", text=str(error))
            self._chamber_degc, self.fault = None, str(error)
        self._ask_at_s = time.monotonic() + max(_QUERY_S / self._plan.port.speed, _LEAST_QUERY_S)
        return self._chamber_degc

    def accept_as_is(self) -> None:
        """End the wait: the operator accepts the present temperature."""
        if self.waiting and self.stability is not None:
            if np.isfinite(self.stability.degc):
                self.stability.target_degc = self.stability.degc
            self._settled(accepted_by=OPERATOR)

    def postpone(self) -> None:
        """Postpone the present soak to the end."""
        self._write("soak_postponed")
        self._soak, self.waiting = None, False

    @property
    def requested(self) -> dict[str, Any]:
        """The requested temperature and that of the chamber, for the summary of a dwell."""
        known = {"requested_degc": self.wanted_degc, "chamber_degc": self._chamber_degc}
        return {} if self.stability is None else known

    @property
    def note(self) -> str:
        """The state of the wait in words."""
        if (seen := self.stability) is None:
            return ""
        words = ["set the chamber" if self._chamber is None else f"chamber {self._chamber.name} is set"]
        words[0] += f" to {self.wanted_degc:g} degC: "
        words[0] += f"sensor {seen.degc:.2f} degC" if self._sensor else "no temperature from the instrument"
        words += [] if np.isnan(seen.rate_degc_per_min) else [f"{seen.rate_degc_per_min:+.3f} degC/min"]
        words += [] if self._chamber_degc is None else [f"chamber {self._chamber_degc:.2f} degC"]
        return ", ".join([*words, f"stable for {seen.stable_min:.1f} of {seen.criterion.stable_min:g} min"])

    def close(self, *, finished: bool) -> None:
        """Release the chamber; when the run has finished, set its last temperature first.

        **Raises:** `InputError` if this temperature cannot be set.
        """
        if self._chamber is not None:
            try:
                if finished and self._plan.chamber.finish_degc is not None:
                    self._chamber.set_temperature(self._plan.chamber.finish_degc)
            finally:
                self._chamber.close()

    def _follow(self, now_s: float, degc: float) -> None:
        """Judge a new temperature."""
        seen, criterion = self.stability, self._plan.soak
        assert seen is not None
        seen.take(now_s * self._plan.port.speed / 60, degc)
        target, far = f"{seen.target_degc:g}", degc - seen.target_degc
        if self.waiting and seen.stable_min >= criterion.stable_min:
            self._settled()
        elif self.waiting:
            self.alarm = ""
            if seen.steady_min >= criterion.stable_min and not seen.near:
                self.alarm = (
                    f"the temperature is steady at {degc:.1f} degC, {abs(far):.1f} degC {'above' if far > 0 else 'below'} "
                    f"{target}: check the set point and the thermometer (stuck, Fahrenheit, counts?), or state self-heating "
                    f"as soak.offset_degc = {far + criterion.offset_degc:.1f}; Enter accepts this temperature"
                )
        elif not self.left and not seen.near:
            self.left = True
            limit = f"{target} +- {criterion.tolerance_degc:g} degC"
            self.alarm = f"the temperature {degc:.2f} degC left {limit}: the next dwell waits for it"
            self._write("temperature_left", degc=degc, text=self.alarm)

    def _settled(self, **content: object) -> None:
        """The temperature is stable, or accepted."""
        assert self.stability is not None
        seen, self.waiting, self.alarm = self.stability, False, ""
        found = {"degc": seen.degc, "rate_degc_per_min": seen.rate_degc_per_min, "stable_min": seen.stable_min}
        known = {name: value for name, value in found.items() if np.isfinite(value)}
        self._write("soaked", **known, chamber_degc=self._chamber_degc, waited_min=self._waited_min, **content)

    @property
    def _waited_min(self) -> float:
        """Time since the request, min of the device."""
        return (time.monotonic() - self._began_s) * self._plan.port.speed / 60

    def _write(self, entry: str, **content: object) -> None:
        self._journal.write(entry, soak=self._soak, requested_degc=self.wanted_degc, **content)
