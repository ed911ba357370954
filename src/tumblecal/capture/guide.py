"""The guided run: prompts, waits for stillness, records, judges, and writes every step into the journal first."""

import time
from collections.abc import Callable
from enum import Enum

import numpy as np

from tumblecal.capture.dwell import Dwell
from tumblecal.capture.estimate_worker import Estimate, EstimateWorker
from tumblecal.capture.expectation import Fault, judge
from tumblecal.capture.head_watch import HeadWatch
from tumblecal.capture.journal import Journal, Standing, replayed, sha256_of
from tumblecal.capture.live import Arrived, LiveStream
from tumblecal.capture.nominal import angle_between_deg
from tumblecal.capture.plan import Plan
from tumblecal.capture.screen import View
from tumblecal.capture.stationarity import stationarity
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


KEYS = "Enter: take it as it is   r: this position again   b: redo the one before   s: skip   q: stop for now"
_DRAIN_S = 2.2
_LONG_ENOUGH_S = 20.0


class Phase(Enum):
    """What the guide waits for."""

    TURN = "TURN"
    SETTLING = "SETTLING"
    RECORDING = "RECORDING"
    CLOSING = "CLOSING"
    FINISHED = "FINISHED"


class Guide:
    """Walks through the plan.

    **Arguments:**

    - `plan`, `journal`, `standing`: what is wanted, where steps are written, what is done already.
    - `stream`: the live samples.
    - `rate_hz`: the device's sample rate.
    - `estimate`: called after each accepted position; None for no live estimate.
    - `bell`: rings.
    """

    def __init__(
        self,
        plan: Plan,
        journal: Journal,
        standing: Standing,
        stream: LiveStream,
        rate_hz: float,
        estimate: Estimate | None = None,
        bell: Callable[[], None] = lambda: None,
    ):
        self.plan, self.standing, self.stream = plan, standing, stream
        self._journal, self._rate_hz, self._bell = journal, rate_hz, bell
        self._steps = plan.steps
        self._to_local_g = STANDARD_GRAVITY_MS2 / plan.gravity_ms2
        self._block_size = max(4, round(rate_hz))
        self._watch = HeadWatch(self._block_size, self._to_local_g, plan.limits.still_mg * 1e-3)
        self._previous: int | None = None
        self._forced = self._must_move = False
        self._alarm = ""
        self._settled = 0
        self._drift = np.full(3, np.nan)
        self._dwell: Dwell | None = None
        self._after: list[Arrived] = []
        self._close_at = 0.0
        self._worker = EstimateWorker(estimate, lambda text: journal.write("warned", position=self.position, text=text))
        self.phase = Phase.TURN
        self.position = -1
        self._next()

    # --- what the operator and the stream say ---

    def press(self, key: str) -> None:
        """Obey a key."""
        match key:
            case "\n" | "\r" if self.phase == Phase.TURN:
                self._take_as_is()
            case "r" if self.phase in (Phase.SETTLING, Phase.RECORDING):
                self._reject("operator")
            case "b" if self._previous is not None and self._previous in self.standing.accepted:
                self._withdraw(self._previous)
            case "s":
                self._skip()
            case "q":
                self._interrupt("operator")
                self.phase = Phase.FINISHED

    def take(self, part: Arrived) -> None:
        """Go on with new samples."""
        for notice in part.notices:
            self._noticed(notice)
        if self.phase == Phase.CLOSING:
            self._closing(part)
        fresh = self._watch.take(part)
        match self.phase:
            case Phase.TURN if fresh:
                self._turning()
            case Phase.SETTLING if fresh:
                self._settling(fresh)
            case Phase.RECORDING:
                self._recording(part, fresh > 0)

    def interrupt(self, why: str) -> None:
        """End cleanly: an unfinished attempt is rejected, everything else stays."""
        self._interrupt(why)

    # --- phases ---

    def _next(self) -> None:
        """Prompt for the next position that is not done; skipped ones come last."""
        open_ones = [k for k in range(len(self._steps)) if k not in self.standing.accepted]
        first = [k for k in open_ones if k not in self.standing.skipped] or open_ones
        later = [k for k in first if k > self.position] or first
        self._dwell = None
        if not later:
            self.phase = Phase.FINISHED
            self._journal.write("finished", tally=self.stream.tally.as_dict())
            self._bell()
            return
        self._prompt(later[0])

    def _prompt(self, position: int) -> None:
        self.position, self.phase = position, Phase.TURN
        self._watch.moved = self._forced = False
        self._alarm, self._settled = "", 0
        # Where gravity looks the same as before the head must be seen to turn (or Enter says so).
        before = self.plan.expected(self._previous) if self._previous is not None else None
        self._must_move = (
            before is not None
            and self._previous != position
            and angle_between_deg(before, self.plan.expected(position)) <= self.plan.tolerance_deg
        )
        step = self._steps[position]
        self._journal.write(
            "prompted",
            position=position,
            name=step.name,
            alpha_deg=step.alpha_deg,
            beta_deg=step.beta_deg,
            log_position=self.stream.recording.position,
        )

    def _turning(self) -> None:
        if not self._watch.still:
            self._watch.moved = True
            self._alarm = ""
            return
        verdict = judge(self.plan, self.position, self._watch.blocks[-1].mean, self._previous)
        if self._must_move and not self._watch.moved and not self._forced:
            return
        if verdict.fault is None or self._forced:
            self._alarm, self._settled, self.phase = "", 0, Phase.SETTLING
            return
        if verdict.fault == Fault.NOT_TURNED and not self._watch.moved:
            return
        if verdict.text != self._alarm:
            self._alarm = verdict.text
            entry = "not_turned" if verdict.fault == Fault.NOT_TURNED else "wrong_position"
            self._journal.write(entry, position=self.position, text=verdict.text, off_deg=verdict.off_deg)
            self._bell()

    def _take_as_is(self) -> None:
        verdict = (
            judge(self.plan, self.position, self._watch.blocks[-1].mean, self._previous) if self._watch.blocks else None
        )
        if verdict is not None and verdict.fault == Fault.NOT_TURNED and not self._alarm:
            self._alarm = verdict.text
            self._journal.write("not_turned", position=self.position, text=verdict.text, off_deg=verdict.off_deg)
            self._bell()
            return
        self._forced = True
        self._journal.write("forced", position=self.position, text=verdict.text if verdict else "")

    def _settling(self, fresh: int) -> None:
        if not self._watch.still:
            self.phase, self._watch.moved = Phase.TURN, True
            return
        self._settled += fresh * self._block_size
        if self._settled < self.plan.dwell.settle_s * self._rate_hz:
            return
        number = self.standing.attempts.get(self.position, 0) + 1
        self.standing.attempts[self.position] = number
        needed = round(self.plan.dwell.seconds * self._rate_hz)
        self._dwell = Dwell(number, needed, self._block_size, self._to_local_g)
        self._journal.write(
            "recording", position=self.position, attempt=number, log_position=self.stream.recording.position
        )
        self.phase = Phase.RECORDING

    def _recording(self, part: Arrived, fresh: bool) -> None:
        dwell = self._dwell
        assert dwell is not None
        dwell.take(part)
        if fresh and dwell.blocks:
            self._warn(dwell)
        if self.phase == Phase.RECORDING and dwell.good >= dwell.needed:
            self.phase, self._after = Phase.CLOSING, []
            wait = self.stream.protocol.counter is not None and dwell.paused_lately(_DRAIN_S)
            self._close_at = time.monotonic() + (_DRAIN_S if wait else 0.0)

    def _warn(self, dwell: Dwell) -> None:
        """Tell at once what goes wrong while recording."""
        moved = np.abs(dwell.blocks[-1].mean - dwell.blocks[0].mean).max()
        if moved > max(5 * self.plan.limits.still_mg * 1e-3, 0.01) and not self._forced:
            self._reject("the head moved while recording")
            return
        found = stationarity(dwell.blocks[-600:])
        self._drift = found.drift_g
        words = []
        if found.knocks:
            words.append(f"knock: {len(found.knocks)} block(s) stand out")
        if found.creep and not found.knocks:
            words.append(
                f"creeping: {found.tilt_arcsec:.0f} arcsec or {np.abs(found.drift_g).max() * 1e6:.0f} ug so far"
            )
        limits = self.plan.limits
        if dwell.flagged > max(limits.flagged_fraction * dwell.needed, 1):
            words.append(f"{dwell.flagged} samples flagged by the device (overload, error)")
        if limits.noise_mg is not None and dwell.sd.max() > 3e-3 * limits.noise_mg:
            words.append(f"noise {dwell.sd.max() * 1e3:.2f} mg, expected {limits.noise_mg:g} mg")
        text = "; ".join(words)
        if text and text.split(":")[0] != self._alarm.split(":")[0]:
            self._journal.write("warned", position=self.position, attempt=dwell.number, text=text)
            self._bell()
        self._alarm = text

    def _closing(self, part: Arrived) -> None:
        """Wait a little for what resolves gaps near the end, then accept or reject."""
        self._after.append(part)
        if time.monotonic() < self._close_at:
            return
        dwell = self._dwell
        assert dwell is not None
        losses = dwell.losses(self.stream.protocol, self._rate_hz, self._after)
        summary = dwell.summary(losses)
        self._check_rate(losses.rate_hz, dwell.needed)
        limits = self.plan.limits
        if losses.lost > limits.lost_fraction * dwell.needed:
            self._reject(f"{losses.lost} of {dwell.needed + losses.lost} samples lost")
            return
        if dwell.flagged > limits.flagged_fraction * dwell.needed:
            self._reject(f"{dwell.flagged} samples flagged by the device")
            return
        self._accept(dwell, summary)

    def _check_rate(self, measured_hz: float, samples: int) -> None:
        """A line too slow for the configured rate makes a device skip samples without a word."""
        wanted = self._rate_hz * self.plan.port.speed
        if samples / wanted > _LONG_ENOUGH_S and abs(measured_hz / wanted - 1) > 0.01:
            text = f"the device sends {measured_hz:.2f} samples/s, {wanted:g} are configured: baud rate too low?"
            self._journal.write("warned", position=self.position, text=text)
            self._bell()

    def _accept(self, dwell: Dwell, summary: dict) -> None:
        start, stop = dwell.log_range
        entry = self._journal.write(
            "accepted",
            position=self.position,
            attempt=dwell.number,
            log_start=start,
            log_stop=stop,
            sha256=sha256_of(self.stream.recording.log, start, stop),
            summary=summary,
            tally=self.stream.tally.as_dict(),
        )
        self.standing.accepted |= replayed([entry]).accepted
        self.standing.skipped.discard(self.position)
        self._previous = self.position
        self._bell()
        self._update_estimate()
        self._next()

    def _update_estimate(self) -> None:
        done = sorted(self.standing.accepted.items())
        rows = []
        for position, attempt in done:
            step, s = self._steps[position], attempt.summary
            sd = np.maximum(np.array(s["sd_g"]) / np.sqrt(max(s["n"], 1)), 1e-7)
            rows.append((step.alpha_deg, step.beta_deg, np.array(s["mean_g"]), sd))
        self._worker.ask(rows)

    def close(self) -> None:
        """Give up an estimate that is still being worked out."""
        self._worker.close()

    def _reject(self, why: str) -> None:
        number = self._dwell.number if self._dwell else 0
        self._journal.write("rejected", position=self.position, attempt=number, reason=why)
        self._bell()
        self._dwell = None
        self._prompt(self.position)
        self._watch.moved = True
        self._alarm = f"again: {why}" if why != "operator" else ""

    def _withdraw(self, position: int) -> None:
        self._interrupt("redo of the position before")
        self._journal.write("withdrawn", position=position)
        self.standing.accepted.pop(position, None)
        self._previous = None
        self._prompt(position)

    def _skip(self) -> None:
        self._interrupt("skipped")
        self._journal.write("skipped", position=self.position)
        self.standing.skipped.add(self.position)
        self._next()

    def _interrupt(self, why: str) -> None:
        if self._dwell is not None and self.phase in (Phase.RECORDING, Phase.CLOSING):
            self._journal.write("rejected", position=self.position, attempt=self._dwell.number, reason=why)
        self._dwell = None

    def _noticed(self, notice: dict) -> None:
        texts = {
            "port_lost": "the device is gone: plug it in again; the run goes on by itself",
            "silence": "no data for a second: power? cable?",
            "other_device": "another device was plugged in: plug in the one this run began with",
            "suspended": "the computer slept: this position begins again",
        }
        match notice["event"]:
            case "port_lost" | "silence" | "other_device":
                self._alarm = texts[notice["event"]]
                self._bell()
            case "reopened" | "data_again":
                self._alarm = ""
                self._watch.forget_unfinished()
            case "suspended":
                if self._dwell is not None:
                    self._reject(texts["suspended"])
            case "clock_jump":
                text = f"the computer's clock jumped by {notice['seconds']:.1f} s; the stamps are not touched by that"
                self._journal.write("warned", position=self.position, text=text)

    # --- what is shown ---

    def view(self) -> View:
        """The screen's content now."""
        self._worker.look()
        step = self._steps[max(self.position, 0)]
        dwell = self._dwell
        speed = self.plan.port.speed
        each = (self.plan.dwell.seconds + self.plan.dwell.settle_s) / speed
        left = len(self._steps) - len(self.standing.accepted)
        done = dwell.good if dwell else 0
        needed = dwell.needed if dwell else 0
        remaining = max(needed - done, 0) / self._rate_hz / speed
        blank = np.full(3, np.nan)
        last = self._watch.last
        return View(
            phase=self.phase.value if self.phase != Phase.CLOSING else "RECORDING",
            alpha_deg=step.alpha_deg,
            beta_deg=step.beta_deg,
            place=f"position {step.name}, {len(self.standing.accepted)} of {len(self._steps)} done",
            alarm=self._alarm,
            note=self._note(),
            done=done,
            needed=needed,
            left_s=remaining,
            run_left_s=remaining + each * max(left - (dwell is not None), 0),
            mean_g=dwell.mean if dwell else (last.mean if last else blank),
            sd_g=dwell.sd if dwell else (last.sd if last else blank),
            expected_g=self.plan.expected(max(self.position, 0)),
            drift_g=self._drift if dwell and len(dwell.blocks) > 3 else blank,
            counters=self.stream.tally.line(),
            estimate=self._worker.rows,
            keys=KEYS,
        )

    def _note(self) -> str:
        match self.phase:
            case Phase.TURN:
                if not self._watch.still and self._watch.moved:
                    return "moving"
                seen = " (gravity looks the same as before: turn it, or press Enter)" if self._must_move else ""
                return f"turn the head there and let go{seen}"
            case Phase.SETTLING:
                left = self.plan.dwell.settle_s - self._settled / self._rate_hz
                return f"hands off: {max(left, 0) / self.plan.port.speed:.0f} s until recording"
            case Phase.CLOSING:
                return "done; checking for lost samples"
            case Phase.FINISHED:
                return "all positions are done"
        return "recording"
