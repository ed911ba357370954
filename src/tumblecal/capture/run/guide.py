"""The guided run: one loop over the positions that prompts, waits for rest, records and checks.

Every step is in the journal before it is shown, and the state of the run follows from the journal alone.
"""

import time
from collections.abc import Callable, Generator
from contextlib import suppress
from enum import Enum
from typing import TypeAlias

import numpy as np

from tumblecal.capture.chamber.soak import Soak
from tumblecal.capture.journal import sha256_of
from tumblecal.capture.port.live import Arrived, LiveStream
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.run.dwell import Dwell, refusal, warning
from tumblecal.capture.run.identity import COMPARED_S, Identity
from tumblecal.capture.run.position_check import NOT_TURNED, judge
from tumblecal.capture.run.rest import HeadWatch, block_size, stationarity
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.ground.frames import angle_between_deg
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_DRAIN_S = 2.2
# Blocks at the end of a dwell that are judged while it is recorded.
_JUDGED_BLOCKS = 600
_LINE_ALARMS = {
    "port_lost": "the device is disconnected: plug it in again; the run resumes automatically",
    "silence": "no data for a second: check power and cable",
    "other_device": "a different device was plugged in: plug in the device of this run",
}


class Phase(Enum):
    """States of the guide."""

    SOAK = "SOAK"
    TURN = "TURN"
    SETTLING = "SETTLING"
    RECORDING = "RECORDING"
    CLOSING = "CLOSING"
    FINISHED = "FINISHED"


# Waits for new samples, and the number of blocks that they complete.
_Wait: TypeAlias = Generator[None, tuple[Arrived, int], None]


class _Again(Exception):
    """The present position ends here: continue with this one, or the next one for None; `why` an attempt was rejected."""

    def __init__(self, position: int | None = None, why: str = ""):
        self.position, self.why = position, why


class Guide:
    """Guides the operator through the plan; fed by `take` and `press`.

    **Arguments:**

    - `run`: the plan, and the journal for the steps.
    - `stream`: the live samples. `rate_hz`: the device's sample rate.
    - `identity`: checks whether the instrument is the one with which the run began.
    - `soak`: requests the temperatures of the plan.
    - `bell`: sounds the bell.

    `phase`, `position`: the present step. `dwell`: the attempt in progress; None for none. `settled`: samples at rest so far.
    `drift_g`: of the dwell, per axis. `rejected`: why the last attempt at this position was rejected; empty if none was.
    """

    def __init__(
        self,
        run: RunFolder,
        stream: LiveStream,
        rate_hz: float,
        identity: Identity,
        soak: Soak,
        bell: Callable[[], None] = lambda: None,
    ):
        self.plan, self.stream, self.rate_hz, self.identity, self.soak = run.plan, stream, rate_hz, identity, soak
        self._journal, self._bell = run.journal, bell
        self._to_local_g = STANDARD_GRAVITY_MS2 / self.plan.site.gravity.value_ms2
        self._still_g, self._size = self.plan.limits.still_mg * 1e-3, block_size(rate_hz)
        self.watch = HeadWatch(self._size, self._to_local_g, self._still_g)
        self.state = run.journal.state
        self.phase, self.position, self.settled = Phase.TURN, -1, 0
        self.dwell: Dwell | None = None
        self.drift_g = np.full(3, np.nan)
        self._previous: int | None = None
        self._forced = self.must_move = False
        self._line_alarm = self._position_alarm = self.rejected = ""
        self._newest = list[Arrived]()
        identity.begin(self._following() or 0)
        self._steps = self._walk()
        with suppress(StopIteration):
            next(self._steps)

    @property
    def alarm(self) -> str:
        """The present fault: of the line until it is repaired, then of the temperature and the position; empty for none."""
        return self._line_alarm or self.soak.alarm or self._position_alarm

    def take(self, part: Arrived) -> None:
        """Continue with new samples."""
        for notice in part.notices:
            self._noticed(notice)
        comparing = self.identity.comparing is not None
        if self.identity.hear(part.events, self.position):
            self.interrupt("the instrument stated its serial number" if comparing else "identity not confirmed")
            self._previous = None
            self._bell()
            self._turn_to()
        self.soak.take(part)
        fresh = self.watch.take(part)
        if len(part.samples):
            self._newest = [part]
        with suppress(StopIteration):
            self._steps.send((part, fresh))

    def press(self, key: str) -> None:
        """Act on a key."""
        before = self._previous
        match key:
            case _ if self.phase == Phase.FINISHED:
                return
            case "\n" | "\r" if self.phase == Phase.TURN:
                self._accept_as_is()
            case "\n" | "\r" if self.phase == Phase.SOAK:
                self.soak.accept_as_is()
            case "r" if self.phase in (Phase.SETTLING, Phase.RECORDING):
                self._reject("operator")
                self._turn_to(self.position)
            case "b" | "s" if self.identity.comparing is not None:
                self._position_alarm = (
                    "the finished position comes first; or stop (q) and resume with --trust-instrument"
                )
            case "b" if before is not None and before in self.state.accepted:
                if self.plan.soaks[before] != self.plan.soaks[self.position]:
                    self._position_alarm = "the previous position belongs to a soak that is over; it is not repeated"
                    return
                self.interrupt("repeat of the previous position")
                self._journal.write("withdrawn", position=before)
                self._previous = None
                self._turn_to(before)
            case "s":
                self.interrupt("skipped")
                if self.phase == Phase.SOAK:
                    self.soak.postpone()
                else:
                    self._journal.write("skipped", position=self.position)
                self._turn_to()
            case "q":
                self.interrupt("operator")
                self._steps.close()
                self.phase = Phase.FINISHED

    def interrupt(self, why: str) -> None:
        """Reject an unfinished attempt; the other attempts do not change."""
        if self.dwell is not None:
            self._reject(why)

    def _reject(self, why: str) -> None:
        number = self.dwell.number if self.dwell else 0
        self._journal.write("rejected", position=self.position, attempt=number, reason=why)
        self.dwell = None

    def _turn_to(self, position: int | None = None, why: str = "") -> None:
        """Leave the present step from outside of the loop."""
        with suppress(StopIteration):
            self._steps.throw(_Again(position, why))

    def _noticed(self, notice: dict) -> None:
        match notice["event"]:
            case "port_lost" | "silence" | "other_device" as what:
                self._line_alarm = _LINE_ALARMS[what]
                self._bell()
            case "reopened" | "data_again":
                self._line_alarm = ""
                self.watch.forget_unfinished()
                self.identity.interrupted(notice, self.plan.port.speed)
            case "suspended" if self.dwell is not None:
                why = "the computer slept: this position restarts"
                self._reject(why)
                self._turn_to(self.position, why)
            case "clock_jump":
                self._warn(f"the computer's clock jumped by {notice['seconds']:.1f} s; the stamps are not affected")

    def _warn(self, text: str, **content: object) -> None:
        self._journal.write("warned", position=self.position, text=text, **content)
        self._bell()

    def _following(self) -> int | None:
        """The finished position that must be compared, or the next one that is not done; None if all are done."""
        if (again := self.identity.comparing) is not None:
            return again.position
        return self.state.open_after(self.position, self.plan.soaks)

    def _walk(self) -> _Wait:
        """The run: each `yield` waits for new samples, and may raise `_Again`."""
        position, why, moved = self._following(), "", False
        while position is not None:
            number = self.state.attempts.get(position, 0)
            self.position, self.rejected = position, why and f"attempt {number} was rejected: {why}"
            self.watch.moved = moved
            self._position_alarm = why and f"again: {why}"
            try:
                yield from self._measure(position)
                self._previous, position, why, moved = position, self._following(), "", False
            except _Again as again:
                moved = again.position == self.position
                position, why = self._following() if again.position is None else again.position, again.why
            self._bell()
        self.phase = Phase.FINISHED
        self._journal.write("finished", tally=self.stream.tally.as_dict())
        self._bell()

    def _measure(self, position: int) -> _Wait:
        """One position, until an attempt at it is accepted."""
        step, expected = self.plan.steps[position], self.plan.expected(position)
        self._forced, number, ready = False, self.state.attempts.get(position, 0) + 1, False
        # If gravity has the same direction as before, a turn of the head must be observed (or confirmed by Enter), unless
        # only the temperature changes.
        self.must_move = False
        if self._previous not in (None, position):
            before = self.plan.steps[self._previous]
            warmer = (before.alpha_deg, before.beta_deg) == (step.alpha_deg, step.beta_deg)
            turned = angle_between_deg(self.plan.expected(self._previous), expected)
            self.must_move = turned <= self.plan.tolerance_deg and not (
                warmer and self.plan.soaks[self._previous] != self.plan.soaks[position]
            )
        while not ready:
            self.soak.begin(position)
            if self.soak.waiting:
                self.phase = Phase.SOAK
                while self.soak.waiting:
                    yield
                self._bell()
            self.phase = Phase.TURN
            angles = {"alpha_deg": step.alpha_deg, "beta_deg": step.beta_deg}
            at = self.stream.recording.position
            self._journal.write("prompted", position=position, name=step.name, **angles, log_position=at)
            yield from self._settle(position)
            ready = not self.soak.left
        comparing = self.identity.comparing is not None
        seconds = min(self.plan.dwell.seconds, COMPARED_S) if comparing else self.plan.dwell.seconds
        needed = round(seconds * self.rate_hz)
        at = self.stream.recording.position
        self._journal.write("recording", position=position, attempt=number, log_position=at)
        dwell = Dwell(number, needed, self._size, self._to_local_g, self._newest)
        self.dwell, self.phase = dwell, Phase.RECORDING
        self.drift_g = np.full(3, np.nan)
        while dwell.good < needed:
            part, fresh = yield
            dwell.take(part)
            if fresh and len(dwell.blocks):
                self._look_at(dwell)
        # Wait shortly for data that resolve gaps near the end.
        self.phase, after = Phase.CLOSING, list[Arrived]()
        wait = self.stream.protocol.counter is not None and dwell.paused_lately(_DRAIN_S)
        close_at = time.monotonic() + (_DRAIN_S if wait else 0.0)
        while not after or time.monotonic() < close_at or self.identity.asking:
            part, _ = yield
            after.append(part)
        losses = dwell.losses(self.stream.protocol, self.rate_hz, after)
        if other_rate := losses.rates.words(self.rate_hz * self.plan.port.speed):
            self._warn(other_rate)
        if why := refusal(dwell, losses, self.plan.limits):
            self._reject(why)
            raise _Again(position, why)
        if comparing:
            self.identity.compared(str(step.name), dwell)
        else:
            self._accept(dwell, dwell.summary(losses) | self.soak.requested)
        self.dwell = None

    def _settle(self, position: int) -> _Wait:
        """Wait until the head is at the position and has been at rest for long enough."""
        self.settled = 0
        while self.phase == Phase.TURN or self.settled < self.plan.dwell.settle_s * self.rate_hz:
            _, fresh = yield
            if not fresh:
                continue
            if not self.watch.still:
                self.phase, self.watch.moved, self._position_alarm = Phase.TURN, True, ""
            elif self.phase == Phase.SETTLING:
                self.settled += fresh * self._size
            elif self._arrived(position):
                self.phase, self.settled = Phase.SETTLING, 0

    def _arrived(self, position: int) -> bool:
        """Whether the head, at rest, is at the position; a mistake is reported once."""
        moved = self.watch.moved or self._forced
        verdict = judge(self.plan, position, self.watch.blocks[-1, 0], self._previous)
        if self.must_move and not moved:
            return False
        if not verdict.fault or self._forced:
            self._position_alarm = ""
            return True
        if (moved or verdict.fault != NOT_TURNED) and verdict.text != self._position_alarm:
            self._mistaken(verdict.fault, verdict.text, verdict.off_deg)
        return False

    def _accept_as_is(self) -> None:
        """The operator accepts the position; the first time, a head that was not turned is reported."""
        seen, text = self.watch.blocks, ""
        if len(seen):
            verdict = judge(self.plan, self.position, seen[-1, 0], self._previous)
            if verdict.fault == NOT_TURNED and not self._position_alarm:
                self._mistaken(*verdict)
                return
            text = verdict.text
        self._forced = True
        self._journal.write("forced", position=self.position, text=text)

    def _mistaken(self, fault: str, text: str, off_deg: float) -> None:
        self._position_alarm = text
        self._journal.write(fault, position=self.position, text=text, off_deg=off_deg)
        self._bell()

    def _look_at(self, dwell: Dwell) -> None:
        """Show faults during the recording at once."""
        moved_g = np.abs(dwell.blocks[-1, 0] - dwell.blocks[0, 0]).max()
        if moved_g > max(5 * self._still_g, 0.01) and not self._forced:
            why = "the head moved while recording"
            self._reject(why)
            raise _Again(self.position, why)
        found = stationarity(dwell.blocks[-_JUDGED_BLOCKS:], self._size)
        self.drift_g = found.drift_g
        text = warning(dwell, found, self.plan.limits)
        if text and text.split(":")[0] != self._position_alarm.split(":")[0]:
            self._warn(text, attempt=dwell.number)
        self._position_alarm = text

    def _accept(self, dwell: Dwell, summary: dict) -> None:
        """Store an attempt: first its bytes, then its entry."""
        recording, (start, stop) = self.stream.recording, dwell.log_range
        recording.sync()
        self._journal.write(
            "accepted",
            position=self.position,
            attempt=dwell.number,
            log_before=int([*dwell.before, *dwell.parts][0].log_start[0]),
            log_start=start,
            log_stop=stop,
            sha256=sha256_of(recording.log, start, stop),
            summary=summary,
            clocks=clocks(),
            serial_number=self.identity.serial_number,
            tally=self.stream.tally.as_dict(),
        )
