"""Positions that are chosen during the run: asked for while the present one is recorded, and written down before a prompt."""

import time
from concurrent.futures import Future, ThreadPoolExecutor

from tumblecal.capture.capture_plan import PlanPosition
from tumblecal.capture.journal import ChosenPosition
from tumblecal.capture.run.choice import Choice, Chooser, DonePosition, Ending, Progress
from tumblecal.capture.run.run_folder import RunFolder
from tumblecal.ground.errors import InputError


class AdaptiveRun:
    """Chooses the positions after those of the plan.

    **Arguments:**

    - `run`: plan, journal and state; the plan gets the chosen positions.
    - `chooser`: called in a thread, so that the recording goes on.

    Times are those of the device: the host's clock times the speed of the port.
    """

    def __init__(self, run: RunFolder, chooser: Chooser):
        self._run, self._chooser = run, chooser
        self._thread = ThreadPoolExecutor(1)
        self._asked: tuple[object, Future[Choice | Ending]] | None = None
        self._began = time.monotonic()

    @property
    def remaining_s(self) -> float:
        """Remaining time of the run."""
        spent = self._run.spent_s + time.monotonic() - self._began
        return 60 * (self._run.state.minutes or 0.0) - spent * self._run.plan.port.speed

    def purpose(self, position: int) -> str:
        """The purpose of a position for the operator; empty for those of the plan."""
        chosen = self._run.state.chosen.get(position)
        return "" if chosen is None else chosen.purpose

    def prepare(self, present: int) -> None:
        """Ask for the position after the present one, whose dwell begins now, if no other is open."""
        state, steps = self._run.state, self._run.plan.steps
        if not set(range(len(steps))) - state.accepted.keys() - state.skipped - {present}:
            self._ask(self._progress(present))

    def decided(self) -> Choice | Ending | None:
        """The next position, or the end of the run; None as long as it is not known.

        **Raises:** `InputError` if the choice fails.
        """
        progress = self._progress(None)
        if self._asked is None or self._asked[0] != _key(progress):
            self._ask(progress)
        assert self._asked is not None
        answer = self._asked[1]
        if not answer.done():
            return None
        self._asked = None
        if error := answer.exception():
            raise InputError(
                f"the next position could not be chosen ({error}); the positions done are stored. Reduce them, or --resume"
            )
        return answer.result()

    def add(self, choice: Choice) -> int:
        """Add a chosen position to the journal and to the plan; its number."""
        run, number = self._run, len(self._run.plan.steps)
        chosen = ChosenPosition(str(number + 1), choice.alpha_deg, choice.beta_deg, choice.purpose)
        run.journal.write("chosen", position=number, **vars(chosen))
        run.state.chosen[number] = chosen
        step = PlanPosition(alpha_deg=chosen.alpha_deg, beta_deg=chosen.beta_deg, name=chosen.name)
        run.plan = run.plan.continued([step])
        return number

    def close(self) -> None:
        """Return without waiting; the thread ends with the program."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _ask(self, progress: Progress) -> None:
        self._asked = _key(progress), self._thread.submit(self._chooser, progress)

    def _progress(self, present: int | None) -> Progress:
        """The state of the run; `present`: a position that is taken as finished, one dwell from now."""
        state, plan = self._run.state, self._run.plan
        seconds, speed = plan.dwell.seconds, plan.port.speed
        others = [attempt for attempt in state.accepted.values() if attempt.position != present]
        others.sort(key=lambda attempt: attempt.wall_ns)
        ends = [1e-9 * attempt.wall_ns * speed for attempt in others]
        steps = [plan.steps[attempt.position] for attempt in others]
        sds = [tuple(map(float, attempt.summary.get("sd_of_mean_g", ()))) for attempt in others]
        end, remaining = time.time() * speed, self.remaining_s
        if present is not None:
            end, remaining = end + seconds, remaining - seconds
            ends, steps, sds = [*ends, end], [*steps, plan.steps[present]], [*sds, ()]
        done = tuple(
            DonePosition(step.alpha_deg, step.beta_deg, finished - seconds, sd)
            for step, finished, sd in zip(steps, ends, sds, strict=True)
        )
        skipped = tuple((plan.steps[k].alpha_deg, plan.steps[k].beta_deg) for k in sorted(state.skipped))
        return Progress(done, end, remaining, skipped)


def _key(progress: Progress) -> object:
    """The part of the state that a prepared choice depends on; the times are those that were expected."""
    return [(one.alpha_deg, one.beta_deg) for one in progress.done], progress.skipped
