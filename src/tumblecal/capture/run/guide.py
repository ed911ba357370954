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
from tumblecal.capture.run.dwell import Dwell
from tumblecal.capture.run.identity import Identity
from tumblecal.capture.run.position_check import NOT_TURNED, Verdict, judge
from tumblecal.capture.run.rest import Blocks, HeadWatch
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.ground.frames import angle_between_deg
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_DRAIN_S = 2.2
# Blocks at the end of a dwell that are judged while it is recorded.
_JUDGED_BLOCKS = 600
# A dwell whose mean moves by more is rejected: this many limits for rest, and at least so much.
_MOVED_LIMITS, _MOVED_G = 5, 0.01
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
    """The present step ends: continue with this position, or the next one for None; `why` an attempt was rejected."""

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

    `phase`, `position`: the present step. `dwell`: the attempt in progress; None for none. `settled_s`: time at rest so far.
    `must_move`: whether a turn must be observed. `rejected`: why the last attempt at this position was rejected; empty if none
    was.
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
        self.plan, self.state, self._journal = run.plan, run.journal.state, run.journal
        self.stream, self.rate_hz, self.identity, self.soak, self._bell = stream, rate_hz, identity, soak, bell
        self._to_local_g = STANDARD_GRAVITY_MS2 / self.plan.site.gravity.value_ms2
        self._still_g = self.plan.limits.still_mg * 1e-3
        self.watch = HeadWatch(rate_hz, self._to_local_g)
        self.phase, self.position, self.settled_s = Phase.TURN, 0, 0.0
        self.dwell: Dwell | None = None
        self._previous: int | None = None
        self._forced = self.must_move = False
        self._line_alarm = self._position_alarm = self.rejected = ""
        self._newest = list[Arrived]()
        self._steps = self._walk()
        with suppress(StopIteration):
            next(self._steps)

    @property
    def alarm(self) -> str:
        """The present fault: of the line until it is repaired, then of the temperature and the position; empty for none."""
        return self._line_alarm or self.soak.fault or self.soak.alarm or self._position_alarm

    @property
    def still(self) -> bool:
        """Whether the head is at rest."""
        return self.watch.blocks.still(self._still_g)

    def take(self, part: Arrived) -> None:
        """Continue with new samples."""
        for notice in part.notices:
            self._noticed(notice)
        if self.identity.hear(part.events, self.position):
            self._bell()
            self._restart("identity not confirmed")
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
            case "\n" | "\r" if self.identity.doubted:
                self.identity.trusted()
            case "\n" | "\r" if self.phase == Phase.TURN:
                self._accept_as_is()
            case "\n" | "\r" if self.phase == Phase.SOAK:
                self.soak.accept_as_is()
            case "r" if self.phase in (Phase.SETTLING, Phase.RECORDING):
                self._reject("operator")
                self._leave(self.position)
            case "b" if before is not None and before in self.state.accepted:
                if self.plan.soaks[before] != self.plan.soaks[self.position]:
                    self._position_alarm = "the previous position belongs to a soak that is over; it is not repeated"
                    return
                self.interrupt("repeat of the previous position")
                self._journal.write("withdrawn", position=before)
                self._previous = None
                self._leave(before)
            case "s":
                self.interrupt("skipped")
                if self.phase == Phase.SOAK:
                    self.soak.postpone()
                else:
                    self._journal.write("skipped", position=self.position)
                self._leave(None)
            case "q":
                self.interrupt("operator")
                self.phase = Phase.FINISHED

    def interrupt(self, why: str) -> None:
        """Reject an unfinished attempt; the other attempts do not change."""
        if self.dwell is not None:
            self._reject(why)

    def _reject(self, why: str) -> None:
        number = self.dwell.number if self.dwell else 0
        self._journal.write("rejected", position=self.position, attempt=number, reason=why)
        self.dwell = None

    def _restart(self, why: str) -> None:
        """Repeat an unfinished attempt."""
        if self.dwell is not None:
            self._reject(why)
            self._leave(self.position, why)

    def _leave(self, position: int | None, why: str = "") -> None:
        """End the present step from outside of the loop."""
        with suppress(StopIteration):
            self._steps.throw(_Again(position, why))

    def _noticed(self, notice: dict) -> None:
        match notice["event"]:
            case "port_lost" | "silence" | "other_device" as what:
                self._line_alarm = _LINE_ALARMS[what]
                self._bell()
            case "reopened" | "data_again":
                self._line_alarm = ""
                self.watch.blocks.forget_unfinished()
                self.identity.interrupted(notice, self.plan.port.speed)
            case "suspended":
                self._restart("the computer slept: this position restarts")

    def _warn(self, text: str, **content: object) -> None:
        self._journal.write("warned", position=self.position, text=text, **content)
        self._bell()

    def _walk(self) -> _Wait:
        """The run: each `yield` waits for new samples, and may raise `_Again`."""
        position, again = self.state.open_after(-1, self.plan.soaks), _Again()
        while position is not None:
            # After a rejection the head may remain where it is.
            self.watch.moved = again.position == self.position
            self.position, self._position_alarm = position, again.why and f"again: {again.why}"
            self.rejected = again.why and f"attempt {self.state.attempts.get(position)} was rejected: {again.why}"
            try:
                yield from self._measure(position)
                again, self._previous = _Again(), position
            except _Again as end:
                again = end
            self.dwell = None
            self._bell()
            following = self.state.open_after(position, self.plan.soaks)
            position = following if again.position is None else again.position
        self.phase, self.rejected = Phase.FINISHED, ""
        self._journal.write("finished", tally=self.stream.tally.as_dict())

    def _measure(self, position: int) -> _Wait:
        """One position, until an attempt at it is accepted."""
        plan, step, before = self.plan, self.plan.steps[position], self._previous
        # If gravity has the same direction as before, a turn of the head must be observed (or confirmed by Enter), unless
        # only the temperature changes.
        self._forced = self.must_move = False
        if before not in (None, position):
            angles, soaks = [(plan.steps[k].alpha_deg, plan.steps[k].beta_deg) for k in (before, position)], plan.soaks
            turn_deg = angle_between_deg(plan.expected(before), plan.expected(position))
            warmer = angles[0] == angles[1] and soaks[before] != soaks[position]
            self.must_move = turn_deg <= plan.tolerance_deg and not warmer
        ready = False
        while not ready:
            self.soak.begin(position)
            if self.soak.waiting:
                self.phase = Phase.SOAK
                while self.soak.waiting:
                    yield
                self._bell()
            self._journal.write(
                "prompted",
                position=position,
                name=step.name,
                alpha_deg=step.alpha_deg,
                beta_deg=step.beta_deg,
                log_position=self.stream.recording.position,
            )
            yield from self._settle(position)
            ready = not self.soak.left
        yield from self._record(position)

    def _settle(self, position: int) -> _Wait:
        """Wait until the head is at the position and has been at rest for long enough."""
        self.phase, self.settled_s = Phase.TURN, 0.0
        while self.phase == Phase.TURN or self.settled_s < self.plan.dwell.settle_s or self.identity.doubted:
            _, fresh = yield
            if fresh and not self.still:
                self.phase, self.watch.moved, self._position_alarm = Phase.TURN, True, ""
            elif fresh and self.phase == Phase.SETTLING:
                self.settled_s += fresh * self.watch.blocks.size / self.rate_hz
            elif fresh and self._arrived(position):
                self.phase, self.settled_s, self._position_alarm = Phase.SETTLING, 0.0, ""

    def _verdict(self, position: int) -> Verdict:
        return judge(self.plan, position, self.watch.blocks.mean_g[-1], self._previous)

    def _arrived(self, position: int) -> bool:
        """Whether the head, at rest, is at the position; a mistake is reported once."""
        if self.must_move and not (self.watch.moved or self._forced):
            return False
        verdict = self._verdict(position)
        not_begun = verdict.fault == NOT_TURNED and not self.watch.moved
        if verdict.fault and not (self._forced or not_begun or verdict.text == self._position_alarm):
            self._mistaken(verdict)
        return self._forced or not verdict.fault

    def _accept_as_is(self) -> None:
        """The operator accepts the position; the first time, a head that was not turned is reported."""
        verdict = self._verdict(self.position) if len(self.watch.blocks.mean_g) else Verdict("", "", 0.0)
        if verdict.fault == NOT_TURNED and not self._position_alarm:
            self._mistaken(verdict)
        else:
            self._forced = True
            self._journal.write("forced", position=self.position, text=verdict.text)

    def _mistaken(self, verdict: Verdict) -> None:
        self._position_alarm = verdict.text
        self._journal.write(verdict.fault, position=self.position, text=verdict.text, off_deg=verdict.off_deg)
        self._bell()

    def _record(self, position: int) -> _Wait:
        """One dwell, which is accepted or rejected."""
        number, recording = self.state.attempts.get(position, 0) + 1, self.stream.recording
        needed = max(1, round(self.plan.dwell.seconds * self.rate_hz))
        self._journal.write("recording", position=position, attempt=number, log_position=recording.position)
        dwell = Dwell(number, needed, Blocks(self.rate_hz), self._to_local_g, self._newest)
        self.dwell, self.phase = dwell, Phase.RECORDING
        while dwell.good < needed:
            part, fresh = yield
            dwell.take(part)
            if fresh and len(dwell.blocks.mean_g):
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
        if why := dwell.refusal(losses, self.plan.limits):
            self._reject(why)
            raise _Again(position, why)
        # First the bytes, then the entry.
        recording.sync()
        start, stop = int(dwell.parts[0].log_start[0]), int(dwell.parts[-1].log_stop[-1])
        self._journal.write(
            "accepted",
            position=position,
            attempt=number,
            log_before=int([*dwell.before, *dwell.parts][0].log_start[0]),
            log_start=start,
            log_stop=stop,
            sha256=sha256_of(recording.log, start, stop),
            summary=dwell.summary(losses) | self.soak.requested,
            clocks=clocks(),
            serial_number=self.identity.serial_number,
            tally=self.stream.tally.as_dict(),
        )

    def _look_at(self, dwell: Dwell) -> None:
        """Show faults during the recording at once."""
        moved_g = np.abs(dwell.blocks.mean_g[-1] - dwell.blocks.mean_g[0]).max()
        if moved_g > max(_MOVED_LIMITS * self._still_g, _MOVED_G) and not self._forced:
            why = "the head moved while recording"
            self._reject(why)
            raise _Again(self.position, why)
        text = dwell.warning(dwell.blocks.stationarity(_JUDGED_BLOCKS), self.plan.limits)
        if text and text.split(":")[0] != self._position_alarm.split(":")[0]:
            self._warn(text, attempt=dwell.number)
        self._position_alarm = text
