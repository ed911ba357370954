"""The soaks of a guided run: requests a temperature and waits until it is stable."""

import time
from typing import Any

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.chamber.chamber import OPERATOR, Chamber, ChamberThread, OperatorChamber
from tumblecal.capture.chamber.stability import Stability
from tumblecal.capture.journal import Journal
from tumblecal.capture.port.live import Arrived
from tumblecal.ground.errors import InputError


# Seconds of the device's time between two queries of the chamber, and the shortest time by the host's clock.
_QUERY_S, _LEAST_QUERY_S = 5.0, 0.1
# A number outside of this is no temperature in degC.
_PLAUSIBLE_DEGC = (-100.0, 250.0)


class Soaking:
    """Requests the temperature of a position and waits until it is stable.

    **Arguments:**

    - `plan`: positions, criterion. `journal`: for the requests and their results.
    - `chamber`: None for the operator.

    The times of the criterion are those of the device. `stability`: of the requested temperature; None before the first
    request. `waiting`: whether it is not stable yet; `left`: whether it left the tolerance since it was.
    """

    stability: Stability | None

    def __init__(self, plan: CapturePlan, journal: Journal, block: int, chamber: Chamber | None = None):
        self._plan, self._journal, self._block = plan, journal, block
        interval = max(_QUERY_S / plan.port.speed, _LEAST_QUERY_S)
        self._chamber = ChamberThread(chamber or OperatorChamber(), interval) if plan.over_temperature else None
        self._alarm = self._line_alarm = ""
        self.stability = None
        self.waiting = self.left = False
        self._soak: int | None = None
        self._wanted_degc = self._began_s = 0.0
        self._sensor: bool | None = None
        self._sum, self._count = 0.0, 0

    @property
    def alarm(self) -> str:
        """The present fault of the temperature or of the chamber; empty for none."""
        return self._line_alarm or self._alarm

    def begin(self, position: int) -> bool:
        """Request the temperature of a position, unless it is there; whether it must be waited for."""
        wanted, soak = self._plan.steps[position].temperature_degc, self._plan.soaks[position]
        if wanted is None or self._chamber is None:
            return False
        if soak == self._soak and not self.left:
            return self.waiting
        self._soak, self._wanted_degc = soak, wanted
        self.waiting, self.left, self._alarm, self._line_alarm = True, False, "", ""
        self.stability = Stability(self._plan.soak, wanted + self._plan.soak.offset_degc)
        self._began_s = time.monotonic()
        self._chamber.request(wanted)
        self._write("soak", position=position, chamber=self._chamber.name, criterion=self._plan.soak.model_dump())
        return True

    def take(self, part: Arrived) -> None:
        """Continue with new samples.

        **Raises:** `InputError` if the temperature is not stable in time, or the chamber fails while it is waited for.
        """
        if self._chamber is None or self.stability is None:
            return
        speed = self._plan.port.speed
        try:
            if answered := self._chamber.look():
                self._line_alarm = ""
        except InputError as error:
            # During a dwell the temperature is still measured; the next soak needs the chamber.
            if self.waiting:
                raise
            if not self._line_alarm:
                self._write("warned", text=str(error))
            self._line_alarm, answered = str(error), False
        now_s = time.monotonic()
        degc = part.samples.temperature[np.isfinite(part.samples.temperature)]
        self._sum, self._count = self._sum + float(degc.sum()), self._count + len(degc)
        if self._count >= self._block:
            self._sensor = True
            self._follow(float(part.host_s[-1]), self._sum / self._count)
            self._sum, self._count = 0.0, 0
        elif self._sensor is None and not len(degc) and answered and self._chamber.reading_degc is not None:
            self._follow(now_s, self._chamber.reading_degc)
        elif self.waiting and self._sensor is None and self._chamber.reading_degc is None and not self._alarm:
            self._alarm = "neither instrument nor chamber state a temperature; press Enter when it is stable"
        waited_min = (now_s - self._began_s) * speed / 60
        if self.waiting and waited_min > self._plan.soak.timeout_min:
            raise InputError(self._failure(waited_min))

    def accept_as_is(self) -> None:
        """End the wait: the operator accepts the present temperature."""
        if self.waiting and self.stability is not None:
            if np.isfinite(self.stability.last_degc):
                self.stability.target_degc = self.stability.last_degc
            self._settled(accepted_by=OPERATOR)

    def postpone(self, soaks: set[int]) -> None:
        """Add the present soak to the postponed ones."""
        if self._soak is not None:
            self._write("soak_postponed")
            soaks.add(self._soak)
            self._soak, self.waiting = None, False

    @property
    def requested(self) -> dict[str, Any]:
        """The requested temperature and that of the chamber, for the summary of a dwell."""
        if self._chamber is None:
            return {}
        return {"requested_degc": self._wanted_degc, "chamber_degc": self._chamber.reading_degc}

    @property
    def wanted_degc(self) -> float:
        """The requested temperature."""
        return self._wanted_degc

    @property
    def note(self) -> str:
        """The state of the wait in words."""
        if self.stability is None or self._chamber is None:
            return ""
        stable, needed = self.stability.stable_min, self._plan.soak.stable_min
        asked = "set the chamber" if self._chamber.name == OPERATOR else f"chamber {self._chamber.name} is set"
        return f"{asked} to {self._wanted_degc:g} degC: {self._now}; stable for {stable:.1f} of {needed:g} min"

    @property
    def _now(self) -> str:
        """The present temperatures in words."""
        assert self.stability is not None and self._chamber is not None
        last, rate, chamber = self.stability.last_degc, self.stability.rate_degc_per_min, self._chamber.reading_degc
        words = [f"sensor {last:.2f} degC"] if self._sensor else ["no temperature from the instrument"]
        words += [] if np.isnan(rate) else [f"{rate:+.3f} degC/min"]
        return ", ".join(words + ([] if chamber is None else [f"chamber {chamber:.2f} degC"]))

    def close(self, *, finished: bool) -> None:
        """Release the chamber; when the run has finished, set its last temperature."""
        if self._chamber is not None:
            self._chamber.close(self._plan.chamber.finish_degc if finished else None)

    def _follow(self, now_s: float, degc: float) -> None:
        assert self.stability is not None
        self.stability.take(now_s * self._plan.port.speed / 60, degc)
        if not self.waiting:
            if not self.left and not self.stability.near:
                self.left = True
                limit = f"{self.stability.target_degc:g} +- {self._plan.soak.tolerance_degc:g} degC"
                self._alarm = f"the temperature {degc:.2f} degC left {limit}: the next dwell waits for it"
                self._write("temperature_left", degc=degc, text=self._alarm)
        elif self.stability.stable:
            self._settled()
        elif self.stability.steady_min >= self._plan.soak.stable_min:
            self._alarm = f"{self._steady()}; Enter accepts this temperature"
        elif self.stability.near:
            self._alarm = ""

    def _settled(self, **content: object) -> None:
        assert self.stability is not None and self._chamber is not None
        seen, self.waiting, self._alarm = self.stability, False, ""
        found = {"degc": seen.last_degc, "rate_degc_per_min": seen.rate_degc_per_min, "stable_min": seen.stable_min}
        known = {name: value for name, value in found.items() if np.isfinite(value)}
        waited = (time.monotonic() - self._began_s) * self._plan.port.speed / 60
        self._write("soaked", **known, chamber_degc=self._chamber.reading_degc, waited_min=waited, **content)

    def _steady(self) -> str:
        """Why a steady temperature is not the requested one."""
        assert self.stability is not None
        seen, target = self.stability, self.stability.target_degc
        last, far = seen.last_degc, seen.last_degc - target
        side = "above" if far > 0 else "below"
        found = f"the temperature is steady at {last:.1f} degC, {abs(far):.1f} degC {side} {target:g}"
        if not _PLAUSIBLE_DEGC[0] <= last <= _PLAUSIBLE_DEGC[1]:
            return f"{found}: is this a number of counts? The sensor's temperature must be in degC"
        if abs((last - 32) / 1.8 - target) <= self._plan.soak.tolerance_degc:
            return f"{found}: is it in Fahrenheit? The sensor's temperature must be in degC"
        if not seen.changed:
            return f"{found}, and has not changed at all: is the chamber set, or is the thermometer stuck?"
        offset = far + self._plan.soak.offset_degc
        return f"{found}: check the set point, or state self-heating as soak.offset_degc = {offset:.1f}"

    def _failure(self, waited_min: float) -> str:
        assert self.stability is not None
        seen, criterion = self.stability, self._plan.soak
        limit = f"{self._wanted_degc:g} degC: not stable after {waited_min:.0f} min ({self._now})"
        if np.isnan(seen.last_degc):
            why = "neither instrument nor chamber state a temperature, so Enter must be pressed when it is stable"
        elif seen.steady_min >= criterion.stable_min and not seen.near:
            why = self._steady()
        elif not seen.near:
            why = f"the chamber does not reach {seen.target_degc:g} +- {criterion.tolerance_degc:g} degC"
        else:
            why = f"changes by less than {criterion.rate_degc_per_min:g} degC/min are needed for {criterion.stable_min:g} min"
        return f"soak at {limit}: {why}; the positions done are stored. Correct it, then --resume"

    def _write(self, entry: str, **content: object) -> None:
        self._journal.write(entry, soak=self._soak, requested_degc=self._wanted_degc, **content)
