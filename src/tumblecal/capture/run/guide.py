"""The guided run: one loop over the positions that prompts, waits for rest, records and checks.

Every step is in the journal before it is shown, and the state of the run follows from the journal alone.
"""

from collections.abc import Callable, Generator, Iterator
from enum import Enum

import numpy as np

from tumblecal.capture.chamber import Soak
from tumblecal.capture.journal import sha256_of
from tumblecal.capture.port.live import Arrived
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.run.contact import Contact
from tumblecal.capture.run.dwell import NOT_TURNED, Blocks, Dwell, Verdict, judge
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.ground.frames import angle_between_deg


# A dwell whose mean moves by more is rejected: this many limits for rest, and at least so much.
_MOVED_LIMITS, _MOVED_G, _TURNING_DPS = 5, 0.01, 2.0
_LINE_ALARMS = {
    "port_lost": "the device is disconnected: plug it in again; the run resumes automatically",
    "silence": "no data for a second: check power and cable",
    "other_device": "a different device was plugged in: plug in the device of this run",
    "reopened": "",
    "data_again": "",
}


class Phase(Enum):
    """States of the guide, with the style in which they are shown."""

    SOAK = "bold magenta"
    TURN = "bold yellow"
    SETTLING = "bold cyan"
    RECORDING = "bold green"
    FINISHED = "bold white"


class _Leave(Exception):
    """The present step ends: continue with a position, or the next one for None; `why` an attempt was rejected."""

    def __init__(self, position: int | None = None, why: str = ""):
        self.position, self.why = position, why


class Guide:
    """Guides the operator through the plan.

    **Arguments:**

    - `run`: the plan, and the journal for the steps.
    - `contact`: with the instrument, which was met; gives the samples.
    - `soak`: requests the temperatures of the plan.
    - `keys`: the keys pressed since its last call. `bell`: sounds the bell.

    `phase`, `position`: the present step. `dwell`: the attempt in progress; None for none. `blocks`: the last two;
    `moved`: whether the head moved since the step began. `settled_s`: time at rest so far.
    `must_move`: whether a turn must be observed. `rejected`: why the last attempt at this position was rejected, or empty.
    """

    def __init__(self, run: RunFolder, contact: Contact, soak: Soak, keys: Callable[[], str], bell: Callable[[], None]):
        self.plan, self.state, self._journal = run.plan, run.journal.state, run.journal
        self.contact, self.stream, self.soak, self._keys, self._bell = contact, contact.stream, soak, keys, bell
        self._to_local_g, self._still_g = self.plan.site.to_local_g, self.plan.limits.still_mg * 1e-3
        self.blocks, self.moved, self._newest = Blocks(contact.rate_hz, 2), False, list[Arrived]()
        self.phase, self.position, self.settled_s = Phase.TURN, 0, 0.0
        self.dwell: Dwell | None = None
        self._previous: int | None = None
        self._forced = self.must_move = False
        self._line_alarm = self._position_alarm = self.rejected = ""

    @property
    def alarm(self) -> str:
        """The present fault: of the line until it is repaired, then of the temperature and the position; empty for none."""
        return self._line_alarm or self.soak.fault or self.soak.alarm or self._position_alarm

    @property
    def still(self) -> bool:
        """Whether the head is at rest."""
        return self.blocks.still(self._still_g)

    def run(self) -> Iterator[None]:
        """The run, until all positions are done or the operator stops: each item is a wait for new samples.

        **Raises:** `InputError` in one line for a fault that ends the run.
        """
        position, leave = self.state.open_after(-1, self.plan.soaks), _Leave()
        while position is not None:
            # After a rejection the head may remain where it is.
            self.moved = leave.position == self.position
            self.position, self._position_alarm = position, ""
            self.rejected = leave.why and f"attempt {self.state.attempts.get(position)} was rejected: {leave.why}"
            try:
                yield from self._measure(position)
                leave, self._previous = _Leave(), position
            except _Leave as end:
                leave = end
            if self.phase == Phase.FINISHED:
                return
            self.dwell = None
            self._bell()
            following = self.state.open_after(position, self.plan.soaks)
            position = following if leave.position is None else leave.position
        self.phase, self.rejected = Phase.FINISHED, ""
        self._journal.write("finished", tally=self.stream.tally.as_dict())

    def interrupt(self, why: str) -> None:
        """Reject an unfinished attempt; the other attempts do not change."""
        if self.dwell is not None:
            self._journal.write("rejected", position=self.position, attempt=self.dwell.number, reason=why)
            self.dwell = None

    def _wait(self) -> Generator[None, None, tuple[Arrived, int]]:
        """Wait for new samples, and act on the keys; returns the samples, and the number of blocks that they complete.

        **Raises:** `_Leave` if the present step ends.
        """
        yield
        part, restart = self.stream.poll(), ""
        for notice in part.notices:
            what = notice["event"]
            self._line_alarm = _LINE_ALARMS.get(what, self._line_alarm)
            if _LINE_ALARMS.get(what):
                self._bell()
            elif what in _LINE_ALARMS:
                self.blocks.forget_unfinished()
                self.contact.interrupted(notice)
            elif what == "suspended":
                restart = "the computer slept: this position restarts"
        if self.contact.hear(part.events, self.position):
            self._bell()
            restart = "identity not confirmed"
        self.soak.take(part)
        samples, rate = part.samples, part.samples.rate
        fresh = self.blocks.add(samples.force[samples.status == 0] * self._to_local_g)
        # The angular rate shows a turn without effect on gravity (about the vertical).
        if len(rate) >= 8 and (np.abs([piece.mean(0) for piece in np.array_split(rate, 8)]) > _TURNING_DPS).any():
            self.blocks.forget()
            self.moved = True
        if len(samples):
            self._newest = [part]
        if restart:
            self._repeat(restart)
        for key in self._keys():
            self._press(key)
        return part, fresh

    def _press(self, key: str) -> None:
        """Act on a key."""
        before = self._previous
        match "\n" if key == "\r" else key:
            case "\n" if self.contact.doubted:
                self.contact.trusted()
            case "\n" if self.phase == Phase.SOAK:
                self.soak.accept_as_is()
            case "\n" if self.phase == Phase.TURN and len(self.blocks.mean_g):
                # The first time, a head that was not turned is reported.
                verdict = self._verdict()
                if verdict.fault == NOT_TURNED and not self._position_alarm:
                    self._report(verdict.fault, verdict.text, off_deg=verdict.off_deg)
                else:
                    self._forced = True
                    self._journal.write("forced", position=self.position, text=verdict.text)
            case "r":
                self._repeat("operator")
            case "b" if before in self.state.accepted and self.plan.soaks[before] == self.plan.soaks[self.position]:
                self.interrupt("repeat of the previous position")
                self._journal.write("withdrawn", position=before)
                self._previous = None
                raise _Leave(before)
            case "s":
                self.interrupt("skipped")
                if self.phase == Phase.SOAK:
                    self.soak.postpone()
                else:
                    self._journal.write("skipped", position=self.position)
                raise _Leave()
            case "q":
                self.interrupt("operator")
                self.phase = Phase.FINISHED
                raise _Leave()

    def _repeat(self, why: str) -> None:
        """Reject an unfinished attempt and repeat its position."""
        if self.dwell is not None:
            self.interrupt(why)
            raise _Leave(self.position, why)

    def _report(self, entry: str, text: str, **content: object) -> None:
        """Write a fault at this position into the journal, show it, and ring."""
        self._journal.write(entry, position=self.position, text=text, **content)
        self._position_alarm = text
        self._bell()

    def _measure(self, position: int) -> Iterator[None]:
        """One position, until an attempt at it is accepted."""
        plan, step, before = self.plan, self.plan.steps[position], self._previous
        # If gravity has the same direction as before, a turn of the head must be observed (or confirmed by Enter), unless
        # only the temperature changes.
        self._forced = self.must_move = False
        if before not in (None, position):
            angles = {(plan.steps[k].alpha_deg, plan.steps[k].beta_deg) for k in (before, position)}
            turned = len(angles) > 1 or plan.soaks[before] == plan.soaks[position]
            turn_deg = angle_between_deg(plan.expected(before), plan.expected(position))
            self.must_move = turned and turn_deg <= plan.tolerance_deg
        while True:
            self.soak.begin(position)
            if self.soak.waiting:
                self.phase = Phase.SOAK
                while self.soak.waiting:
                    yield from self._wait()
                self._bell()
            self._journal.write(
                "prompted",
                position=position,
                name=step.name,
                alpha_deg=step.alpha_deg,
                beta_deg=step.beta_deg,
                log_position=self.stream.recording.position,
            )
            yield from self._settle()
            if not self.soak.left:
                break
        yield from self._record(position)

    def _settle(self) -> Iterator[None]:
        """Wait until the head is at the position and has been at rest for long enough."""
        self.phase, self.settled_s = Phase.TURN, 0.0
        while self.phase == Phase.TURN or self.settled_s < self.plan.dwell.settle_s or self.contact.doubted:
            _, fresh = yield from self._wait()
            if fresh and not self.still:
                self.phase, self.moved, self._position_alarm = Phase.TURN, True, ""
            elif fresh and self.phase == Phase.SETTLING:
                self.settled_s += fresh * self.blocks.size / self.contact.rate_hz
            elif fresh and self._arrived():
                self.phase, self.settled_s, self._position_alarm = Phase.SETTLING, 0.0, ""

    def _verdict(self) -> Verdict:
        return judge(self.plan, self.position, self.blocks.mean_g[-1], self._previous)

    def _arrived(self) -> bool:
        """Whether the head, at rest, is at the position; a mistake is reported once."""
        if self._forced or (self.must_move and not self.moved):
            return self._forced
        verdict = self._verdict()
        begun = verdict.fault != NOT_TURNED or self.moved
        if verdict.fault and begun and verdict.text != self._position_alarm:
            self._report(verdict.fault, verdict.text, off_deg=verdict.off_deg)
        return not verdict.fault

    def _record(self, position: int) -> Iterator[None]:
        """One dwell, which is accepted or rejected."""
        number, recording = self.state.attempts.get(position, 0) + 1, self.stream.recording
        needed = max(1, round(self.plan.dwell.seconds * self.contact.rate_hz))
        self._journal.write("recording", position=position, attempt=number, log_position=recording.position)
        dwell = Dwell(number, needed, self.contact.rate_hz, self._to_local_g, self._newest)
        self.dwell, self.phase = dwell, Phase.RECORDING
        while dwell.good < needed:
            part, fresh = yield from self._wait()
            dwell.take(part)
            if fresh and len(dwell.blocks.mean_g):
                self._look_at(dwell)
        # A late frame may follow, and nothing is accepted while the instrument may be a different one.
        after = list[Arrived]()
        while not after or self.contact.asking:
            after.append((yield from self._wait())[0])
        losses = dwell.losses(self.stream.protocol, after)
        if other_rate := losses.rate_words(self.contact.rate_hz * self.plan.port.speed):
            self._report("warned", other_rate)
        if why := dwell.refusal(losses, self.plan.limits):
            self._repeat(why)
        # First the bytes, then the entry.
        recording.sync()
        start, stop = int(dwell.parts[0].log_start[0]), int(dwell.parts[-1].log_stop[-1])
        self._journal.write(
            "accepted",
            position=position,
            attempt=number,
            log_before=int((dwell.before or dwell.parts)[0].log_start[0]),
            log_start=start,
            log_stop=stop,
            sha256=sha256_of(recording.log, start, stop),
            summary=dwell.summary(losses) | self.soak.requested,
            clocks=clocks(),
            serial_number=self.contact.serial_number,
            tally=self.stream.tally.as_dict(),
        )

    def _look_at(self, dwell: Dwell) -> None:
        """Show faults during the recording at once."""
        moved_g = np.abs(dwell.blocks.mean_g[-1] - dwell.blocks.mean_g[0]).max()
        if moved_g > max(_MOVED_LIMITS * self._still_g, _MOVED_G) and not self._forced:
            self._repeat("the head moved while recording")
        text = dwell.warning(self.plan.limits)
        if text and text.split(":")[0] != self._position_alarm.split(":")[0]:
            self._report("warned", text, attempt=dwell.number)
        self._position_alarm = text
