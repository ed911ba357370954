"""The guided run: prompts, waits for rest, records, checks, and writes every step into the journal first."""

import time
from collections.abc import Callable
from enum import Enum

import numpy as np

from tumblecal.capture.journal import replayed, sha256_of
from tumblecal.capture.port.live import Arrived, LiveStream
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.run.dwell import Dwell, refusal, warning
from tumblecal.capture.run.estimate_worker import Estimate, EstimateWorker
from tumblecal.capture.run.identity import Identity
from tumblecal.capture.run.instrument_doubt import COMPARED_S, InstrumentDoubt
from tumblecal.capture.run.prompted import Prompted
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.capture.run.soaking import Soaking
from tumblecal.capture.run.stationarity import HeadWatch, block_size, stationarity
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_DRAIN_S = 2.2
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


class Guide:
    """Guides the operator through the plan.

    **Arguments:**

    - `run`: the plan, the journal for the steps, and the finished positions.
    - `stream`: the live samples.
    - `rate_hz`: the device's sample rate.
    - `estimate`: called after each accepted position; None for no live estimate.
    - `bell`: sounds the bell.
    - `identity`: checks whether the instrument is the one with which the run began; None for no check.
    - `trust`: the operator states that it is.
    - `soaking`: requests the temperatures of the plan; None: from the operator.
    """

    stream: LiveStream
    rate_hz: float
    watch: HeadWatch
    prompted: Prompted
    rejected: str
    settled: int
    worker: EstimateWorker
    phase: Phase
    position: int
    doubt: InstrumentDoubt
    soaking: Soaking

    def __init__(
        self,
        run: RunFolder,
        stream: LiveStream,
        rate_hz: float,
        estimate: Estimate | None = None,
        bell: Callable[[], None] = lambda: None,
        identity: Identity | None = None,
        trust: bool = False,
        soaking: Soaking | None = None,
    ):
        plan, journal = run.plan, run.journal
        self.plan, self.state, self.stream = plan, run.state, stream
        self._journal, self.rate_hz, self._bell = journal, rate_hz, bell
        self._to_local_g = STANDARD_GRAVITY_MS2 / plan.site.gravity.value_ms2
        self._block_size = block_size(rate_hz)
        self.soaking = soaking or Soaking(plan, journal, self._block_size)
        self.watch = HeadWatch(self._block_size, self._to_local_g, plan.limits.still_mg * 1e-3)
        self.prompted = Prompted(plan, self.watch, journal, bell)
        self._line_alarm = self.rejected = ""
        self.settled = 0
        self.drift_g = np.full(3, np.nan)
        self.dwell: Dwell | None = None
        self._after: list[Arrived] = []
        self._newest: Arrived | None = None
        self._close_at = 0.0
        self.worker = EstimateWorker(estimate, lambda text: journal.write("warned", position=self.position, text=text))
        self.phase = Phase.TURN
        self.position = -1
        self.doubt = InstrumentDoubt(identity, run.state, journal, trust=trust)
        self._next()
        if self.doubt.begin(self.position):
            self._prompt_again()

    @property
    def alarm(self) -> str:
        """The present fault: of the line until it is repaired, then of the temperature and the position; empty for none."""
        return self._line_alarm or self.soaking.alarm or self.prompted.alarm

    def press(self, key: str) -> None:
        """Act on a key."""
        match key:
            case "\n" | "\r" if self.phase == Phase.TURN:
                self.prompted.accept_as_is()
            case "\n" | "\r" if self.phase == Phase.SOAK:
                self.soaking.accept_as_is()
            case "r" if self.phase in (Phase.SETTLING, Phase.RECORDING):
                self._reject("operator")
            case "b" | "s" if self.doubt.comparing is not None:
                self.prompted.alarm = (
                    "the finished position comes first; or stop (q) and resume with --trust-instrument"
                )
            case "b" if self.prompted.previous is not None and self.prompted.previous in self.state.accepted:
                if self.plan.soaks[self.prompted.previous] == self.plan.soaks[self.position]:
                    self._withdraw(self.prompted.previous)
                else:
                    self.prompted.alarm = "the previous position belongs to a soak that is over; it is not repeated"
            case "s":
                self._skip()
            case "q":
                self.interrupt("operator")
                self.phase = Phase.FINISHED

    def take(self, part: Arrived) -> None:
        """Continue with new samples."""
        for notice in part.notices:
            self._noticed(notice)
        if self.doubt.hear(part.events, self.position):
            self._prompt_again()
        if self.phase == Phase.CLOSING:
            self._closing(part)
        self.soaking.take(part)
        fresh = self.watch.take(part)
        if len(part.samples):
            self._newest = part
        match self.phase:
            case Phase.SOAK if not self.soaking.waiting:
                self._bell()
                self._prompt(self.position)
            case Phase.TURN if fresh and self.prompted.arrived():
                self.settled, self.phase = 0, Phase.SETTLING
            case Phase.SETTLING if fresh:
                self._settling(fresh)
            case Phase.RECORDING:
                self._recording(part, fresh > 0)

    def interrupt(self, why: str) -> None:
        """Reject an unfinished attempt; the other attempts do not change."""
        if self.dwell is not None and self.phase in (Phase.RECORDING, Phase.CLOSING):
            self._journal.write("rejected", position=self.position, attempt=self.dwell.number, reason=why)
        self.dwell = None

    def _next(self) -> None:
        """Prompt for the next position that is not done, or finish."""
        following = self.state.open_after(self.position, self.plan.soaks)
        self.dwell = None
        if following is None:
            self.phase = Phase.FINISHED
            self._journal.write("finished", tally=self.stream.tally.as_dict())
            self._bell()
            return
        self._prompt(following)

    def _prompt(self, position: int) -> None:
        # A turn during a soak counts.
        self.watch.moved &= self.phase == Phase.SOAK
        self.position, self.phase = position, Phase.SOAK if self.soaking.begin(position) else Phase.TURN
        self.prompted.begin(position)
        self.rejected, self.settled = "", 0
        if self.phase == Phase.SOAK:
            return
        step, at = self.plan.steps[position], self.stream.recording.position
        angles = {"alpha_deg": step.alpha_deg, "beta_deg": step.beta_deg}
        self._journal.write("prompted", position=position, name=step.name, **angles, log_position=at)

    def _settling(self, fresh: int) -> None:
        if not self.watch.still:
            self.phase, self.watch.moved = Phase.TURN, True
            return
        self.settled += fresh * self._block_size
        if self.settled < self.plan.dwell.settle_s * self.rate_hz:
            return
        if self.soaking.left:
            self._prompt(self.position)
            return
        number = self.state.attempts.get(self.position, 0) + 1
        self.state.attempts[self.position] = number
        comparing = self.doubt.comparing is not None
        seconds = min(self.plan.dwell.seconds, COMPARED_S) if comparing else self.plan.dwell.seconds
        needed = round(seconds * self.rate_hz)
        self.dwell = Dwell(number, needed, self._block_size, self._to_local_g, self._newest)
        self._journal.write(
            "recording", position=self.position, attempt=number, log_position=self.stream.recording.position
        )
        self.phase = Phase.RECORDING

    def _recording(self, part: Arrived, fresh: bool) -> None:
        dwell = self.dwell
        assert dwell is not None
        dwell.take(part)
        if fresh and dwell.blocks:
            self._warn(dwell)
        if self.phase == Phase.RECORDING and dwell.good >= dwell.needed:
            self.phase, self._after = Phase.CLOSING, []
            wait = self.stream.protocol.counter is not None and dwell.paused_lately(_DRAIN_S)
            self._close_at = time.monotonic() + (_DRAIN_S if wait else 0.0)

    def _warn(self, dwell: Dwell) -> None:
        """Show faults during the recording at once."""
        moved = np.abs(dwell.blocks[-1].mean - dwell.blocks[0].mean).max()
        if moved > max(5 * self.plan.limits.still_mg * 1e-3, 0.01) and not self.prompted.forced:
            self._reject("the head moved while recording")
            return
        seen = stationarity(dwell.blocks[-600:])
        self.drift_g = seen.drift_g
        text = warning(dwell, seen, self.plan.limits)
        if text and text.split(":")[0] != self.prompted.alarm.split(":")[0]:
            self._warned(text, attempt=dwell.number)
        self.prompted.alarm = text

    def _warned(self, text: str, **content: object) -> None:
        self._journal.write("warned", position=self.position, text=text, **content)
        self._bell()

    def _closing(self, part: Arrived) -> None:
        """Wait shortly for data that resolve gaps near the end, then accept or reject."""
        self._after.append(part)
        if time.monotonic() < self._close_at or self.doubt.asking:
            return
        dwell = self.dwell
        assert dwell is not None
        losses = dwell.losses(self.stream.protocol, self.rate_hz, self._after)
        if other_rate := losses.rates.words(self.rate_hz * self.plan.port.speed):
            self._warned(other_rate)
        why = refusal(dwell, losses, self.plan.limits)
        if why:
            self._reject(why)
        elif self.doubt.comparing is not None:
            self._compared(dwell)
        else:
            self._accept(dwell, dwell.summary(losses))

    def _accept(self, dwell: Dwell, summary: dict) -> None:
        start, stop = dwell.log_range
        self.stream.recording.sync()
        entry = self._journal.write(
            "accepted",
            position=self.position,
            attempt=dwell.number,
            log_before=dwell.log_before,
            log_start=start,
            log_stop=stop,
            sha256=sha256_of(self.stream.recording.log, start, stop),
            summary=summary | self.soaking.requested,
            clocks=clocks(),
            serial_number=self.doubt.serial_number,
            tally=self.stream.tally.as_dict(),
        )
        self.state.accepted |= replayed([entry]).accepted
        self.state.skipped.discard(self.position)
        self.prompted.previous, self.rejected = self.position, ""
        self._bell()
        # The parameters differ between temperatures.
        soaks, here = self.plan.soaks, self.plan.soaks[self.position]
        self.worker.ask({k: done for k, done in self.state.accepted.items() if soaks[k] == here})
        self._next()

    def _reject(self, why: str) -> None:
        number = self.dwell.number if self.dwell else 0
        self._journal.write("rejected", position=self.position, attempt=number, reason=why)
        self._bell()
        self.dwell = None
        self._prompt(self.position)
        self.rejected = f"attempt {number} was rejected: {why}" if number and why != "operator" else ""
        self.watch.moved = True
        self.prompted.alarm = f"again: {why}" if why != "operator" else ""

    def _prompt_again(self) -> None:
        """Prompt for the finished position of a comparison, or for the next one if it is no longer needed."""
        self.interrupt("identity not confirmed" if self.doubt.comparing else "the instrument stated its serial number")
        self.dwell, self.prompted.previous = None, None
        if self.doubt.comparing is not None:
            self._prompt(self.doubt.comparing.position)
        else:
            self._next()
        self._bell()

    def _compared(self, dwell: Dwell) -> None:
        self.doubt.compared(str(self.plan.steps[self.position].name), dwell)
        self.prompted.previous, self.rejected = self.position, ""
        self._bell()
        self._next()

    def _withdraw(self, position: int) -> None:
        self.interrupt("repeat of the previous position")
        self._journal.write("withdrawn", position=position)
        self.state.accepted.pop(position, None)
        self.prompted.previous = None
        self._prompt(position)

    def _skip(self) -> None:
        self.interrupt("skipped")
        if self.phase == Phase.SOAK:
            self.soaking.postpone(self.state.postponed)
            self._next()
            return
        self._journal.write("skipped", position=self.position)
        self.state.skipped.add(self.position)
        self._next()

    def _noticed(self, notice: dict) -> None:
        match notice["event"]:
            case "port_lost" | "silence" | "other_device" as what:
                self._line_alarm = _LINE_ALARMS[what]
                self._bell()
            case "reopened" | "data_again":
                self._line_alarm = ""
                self.watch.forget_unfinished()
                self.doubt.interrupted(notice, self.plan.port.speed)
            case "suspended":
                if self.dwell is not None:
                    self._reject("the computer slept: this position restarts")
            case "clock_jump":
                self._warned(f"the computer's clock jumped by {notice['seconds']:.1f} s; the stamps are not affected")
