"""The soaks of a guided run: a temperature is requested, of the operator or of a chamber, and waited for until it is stable.

A chamber is on a serial line (or a socket), with commands in text, such as those of SCPI.
"""

import math
import re
import time
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from tumblecal.capture.capture_plan import OPERATOR, RATE_FRACTION, CapturePlan, ChamberTable, SoakTable
from tumblecal.capture.decoding.samples import Entry
from tumblecal.capture.journal import Journal
from tumblecal.capture.port.live import Arrived
from tumblecal.capture.port.transport import Port
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


_TRIES, _POLL_S, _SET_WITHIN_DEGC = 3, 0.01, 0.11
_TERMINATORS = {"LF": "\n", "CR": "\r", "CRLF": "\r\n"}
# Answers outside are no temperature of a chamber, degC.
_LOWEST_DEGC, _HIGHEST_DEGC = -200.0, 400.0
_DEGC = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:(?:deg|°)?\s*C)?", re.IGNORECASE)
# A rate needs this many readings; if they are rare, over a longer time.
_FEWEST = 3
# Seconds of the device's time from an answer of the chamber to the next query.
_QUERY_S = 5.0


class Chamber:
    """A chamber with commands in text; its port is opened again after a fault.

    The public methods are called in a thread, one at a time, so they may wait. They raise `InputError` in one line if the
    chamber does not answer or accept a temperature.

    **Arguments:**

    - `table`: port and commands. The `name`, in the journal and in messages, is that of the port.
    """

    def __init__(self, table: ChamberTable):
        self.name, self._table = table.url, table
        self._port: Port | None = None

    def set_temperature(self, degc: float) -> None:
        """Request a temperature; the set point is read back if the table has a command for it."""
        table, command = self._table, self._table.set.format(float(degc))
        self._exchange(command)
        read = self._exchange(table.set_query, table.set_query_field) if table.set_query else degc
        if abs(read - degc) > _SET_WITHIN_DEGC:
            raise InputError(
                f"chamber {self.name}: the set point is {read:g} degC after {command!r}: correct its limits, or chamber.set "
                "of the plan"
            )

    def temperature(self) -> float | None:
        """The temperature of the chamber, degC; None, for a chamber of the user's, without a thermometer."""
        return self._exchange(self._table.query, self._table.query_field)

    def close(self) -> None:
        """Release the port; the temperature remains set."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _exchange(self, command: str, field: int = 0) -> float:
        """Send a command, and return the number at a field (from 1) of a line of the answer; NaN for a command without one."""
        try:
            if self._port is None:
                self._port = Port(self.name, self._table.baud)
                for first in self._table.start:
                    self._answer(self._port, first, 0)
            return self._answer(self._port, command, field)
        except (InputError, OSError) as error:
            self.close()
            words = f"the line is interrupted ({error}); check cable and power" if isinstance(error, OSError) else error
            raise InputError(f"chamber {self.name}: {words}") from error

    def _answer(self, port: Port, query: str, field: int) -> float:
        """The number in the answer to a query, which is repeated twice if there is none; NaN without a field."""
        seen = ""
        for _ in range(_TRIES):
            # Answers to earlier commands are discarded.
            port.read()
            port.write((query + _TERMINATORS[self._table.terminator]).encode())
            answer, late, late_s = b"", not field, time.monotonic() + self._table.timeout_s
            if late:
                return math.nan
            while not late:
                time.sleep(_POLL_S)
                answer += port.read()
                late = time.monotonic() >= late_s
                lines = re.split(r"[\r\n]+", answer.decode(errors="replace"))
                # The last line is unfinished, unless no more comes.
                for line in filter(None, map(str.strip, lines if late else lines[:-1])):
                    fields = re.split(r"[,;]|\s+(?=[-+.\d])", line)
                    number = _DEGC.fullmatch(fields[field - 1].strip()) if len(fields) >= field else None
                    if number and _LOWEST_DEGC <= float(number[1]) <= _HIGHEST_DEGC:
                        return float(number[1])
                    seen = line
        raise InputError(
            f"{query!r}, asked {_TRIES} times, {shown(seen) if seen else 'nothing'} came: no temperature in degC at field "
            f"{field}; check cable, baud rate ({self._table.baud}), terminator and query, and set the controller to degC"
        )


class Stability:
    """Follows a temperature during a soak, in minutes of the device's time.

    **Arguments:**

    - `criterion`: of a stable temperature. `target_degc`: the expected temperature.

    `known`: newest temperature `degc`, its rate `rate_degc_per_min` if there are enough readings, and `stable_min`; empty
    before the first reading. `near`: whether the newest one is within the tolerance. `stable_min`: time for which the
    criterion has been met; `steady_min`: the same without the distance to the target.
    """

    def __init__(self, criterion: SoakTable, target_degc: float):
        self.criterion, self.target_degc = criterion, target_degc
        self._recent, self._since_min = np.zeros((0, 2)), np.full(2, np.inf)
        self.known, self.near = dict[str, float](), False
        self.steady_min = self.stable_min = 0.0

    def take(self, now_min: float, degc: float) -> None:
        """Add a reading at a time that increases."""
        since_min, rate = now_min - RATE_FRACTION * self.criterion.stable_min, np.inf
        recent = np.vstack([self._recent, [now_min, degc]])
        # The shortest stretch of at least this time and three readings.
        first = np.searchsorted(recent[:, 0], since_min, "right") - 1
        self._recent = recent[max(min(first, len(recent) - _FEWEST), 0) :]
        times, values = self._recent.T
        self.known = {"degc": degc}
        if first >= 0 and len(times) >= _FEWEST:
            self.known["rate_degc_per_min"] = rate = float(np.polyfit(times - now_min, values, 1)[0])
        self.near = abs(degc - self.target_degc) <= self.criterion.tolerance_degc
        holds = [abs(rate) < self.criterion.rate_degc_per_min, self.near]
        self._since_min = np.where(holds, np.minimum(self._since_min, now_min), np.inf)
        self.steady_min, near_min = np.maximum(now_min - self._since_min, 0).tolist()
        self.known["stable_min"] = self.stable_min = min(self.steady_min, near_min)


class Soak:
    """Requests the temperature of a position and waits until it is stable.

    **Arguments:**

    - `plan`: positions, criterion. `journal`: for the requests and their results. `rate_hz`: sample rate.
    - `chamber`: None for the operator. It is asked in a thread, so that screen and keys do not wait for it.

    `requested`: requested temperature and that of the chamber, for the summary of a dwell; empty before the first request.
    `stability`: of that temperature. `waiting`: whether it is not stable yet; `left`: whether it left the tolerance since it
    was. `alarm`, `fault`: the present faults of the temperature and of the chamber; empty for none.
    """

    def __init__(self, plan: CapturePlan, journal: Journal, rate_hz: float, chamber: Chamber | None = None):
        self._plan, self._criterion, self._journal, self._chamber = plan, plan.soak, journal, chamber
        self._name = chamber.name if chamber else OPERATOR
        self._thread, self._ask_at_s = ThreadPoolExecutor(1), 0.0
        self._answer: Future[float | None] | None = None
        self._soak, self._began_min = None, 0.0
        # Temperatures of about a second are averaged.
        self._count, self._values, self._sensor = round(rate_hz), np.zeros(0), False
        self.stability, self.requested = Stability(plan.soak, np.nan), Entry()
        self.alarm, self.fault, self.waiting, self.left = "", "", False, False

    @property
    def _now_min(self) -> float:
        return time.monotonic() * self._plan.port.speed / 60

    def begin(self, position: int) -> None:
        """Request the temperature of a position, unless it is there or already waited for."""
        wanted, soak = self._plan.steps[position].temperature_degc, self._plan.soaks[position]
        if wanted is not None and (soak != self._soak or self.left):
            self._soak, self._began_min, self.waiting, self.left, self.alarm = soak, self._now_min, True, False, ""
            self.stability = Stability(self._criterion, wanted + self._criterion.offset_degc)
            self.requested = {"requested_degc": wanted, "chamber_degc": None}
            self._write("soak", position=position, chamber=self._name, criterion=self._criterion.model_dump())
            if self._chamber is not None:
                self._answer = self._thread.submit(self._chamber.set_temperature, wanted)

    def take(self, part: Arrived) -> None:
        """Continue with new samples.

        **Raises:** `InputError` if the temperature is not stable in time, or the chamber fails or does not accept the
        temperature while it is waited for.
        """
        if not self.requested:
            return
        if self._chamber is not None:
            self._ask(self._chamber)
        self._values = np.append(self._values, part.samples.temperature)
        if len(self._values) >= self._count:
            known, self._values = self._values[np.isfinite(self._values)], np.zeros(0)
            self._sensor |= len(known) > 0
            degc = float(known.mean()) if len(known) else None if self._sensor else self.requested["chamber_degc"]
            if degc is not None:
                self._follow(degc)
        waited_min = self._now_min - self._began_min
        if self.waiting and waited_min > self._criterion.timeout_min:
            raise InputError(
                f"soak at {self.requested['requested_degc']:g} degC: not stable after {waited_min:.0f} min, {self.note}"
                f"{self.alarm and f': {self.alarm}'}. The positions done are stored; correct it, then --resume"
            )

    def accept_as_is(self) -> None:
        """End the wait: the operator accepts the present temperature."""
        self.stability.target_degc = self.stability.known.get("degc", self.stability.target_degc)
        self._settled(accepted_by=OPERATOR)

    def postpone(self) -> None:
        """Postpone the present soak to the end."""
        self._write("soak_postponed")
        self._soak, self.waiting = None, False

    @property
    def note(self) -> str:
        """The state of the wait in words."""
        known, chamber_degc = self.stability.known, self.requested["chamber_degc"]
        words = "neither instrument nor chamber state a temperature; press Enter when it is stable"
        if known:
            rate = f", {known['rate_degc_per_min']:+.3f} degC/min" if "rate_degc_per_min" in known else ""
            of_chamber = "" if chamber_degc is None or not self._sensor else f", chamber {chamber_degc:.2f} degC"
            source = "sensor" if self._sensor else "chamber"
            words = f"{source} {known['degc']:.2f} degC{rate}{of_chamber}, stable for {known['stable_min']:.1f} min"
        return f"chamber to {self.requested['requested_degc']:g} degC (by {self._name}): {words}"

    def close(self, *, finished: bool) -> None:
        """Release the chamber; when the run has finished, set its last temperature first.

        **Raises:** `InputError` if this temperature cannot be set.
        """
        self._thread.shutdown()
        if self._chamber is not None:
            try:
                if finished and self._plan.chamber.finish_degc is not None:
                    self._chamber.set_temperature(self._plan.chamber.finish_degc)
            finally:
                self._chamber.close()

    def _ask(self, chamber: Chamber) -> None:
        """Ask the chamber for its temperature when this is due, and read the answer when it is there."""
        if self._answer is None and time.monotonic() >= self._ask_at_s:
            self._answer = self._thread.submit(chamber.temperature)
        if self._answer is None or not self._answer.done():
            return
        answer, self._answer = self._answer, None
        self._ask_at_s = time.monotonic() + _QUERY_S / self._plan.port.speed
        before, self.fault, self.requested["chamber_degc"] = self.fault, "", None
        try:
            self.requested["chamber_degc"] = answer.result()
        except InputError as error:
            # During a dwell the temperature is still measured; the next soak needs the chamber.
            if self.waiting:
                raise
            self.fault = str(error)
            if not before:
                self._write("warned", text=self.fault)

    def _follow(self, degc: float) -> None:
        """Judge a new temperature."""
        seen, criterion = self.stability, self._criterion
        seen.take(self._now_min, degc)
        far = degc - seen.target_degc
        if self.waiting and seen.stable_min >= criterion.stable_min:
            self._settled()
        elif self.waiting:
            self.alarm = ""
            if seen.steady_min >= criterion.stable_min and not seen.near:
                self.alarm = (
                    f"the temperature is steady at {degc:.1f} degC, {far:+.1f} degC from {seen.target_degc:g}: check the set "
                    "point and the thermometer (stuck, Fahrenheit, counts?), or state self-heating as "
                    f"soak.offset_degc = {far + criterion.offset_degc:.1f}; Enter accepts this temperature"
                )
        elif not self.left and not seen.near:
            self.left = True
            self.alarm = (
                f"the temperature {degc:.2f} degC left {seen.target_degc:g} +- {criterion.tolerance_degc:g} degC: "
                "the next dwell waits for it"
            )
            self._write("temperature_left", degc=degc, text=self.alarm)

    def _settled(self, **content: object) -> None:
        """The temperature is stable, or accepted."""
        self.waiting, self.alarm = False, ""
        self._write("soaked", **self.stability.known, waited_min=self._now_min - self._began_min, **content)

    def _write(self, entry: str, **content: object) -> None:
        self._journal.write(entry, soak=self._soak, **self.requested, **content)
