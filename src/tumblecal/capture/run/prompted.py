"""The prompted position: whether the head is there, and the probable mistake if it is not."""

from collections.abc import Callable

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.journal import Journal
from tumblecal.capture.run.expectation import Fault, Verdict, judge
from tumblecal.capture.run.stationarity import HeadWatch
from tumblecal.ground.frames import angle_between_deg


class Prompted:
    """The prompted position.

    **Arguments:**

    - `plan`: the positions. `watch`: the head. `journal`: for mistakes. `bell`: sounds the bell.

    `position`: index in the plan; `previous`: the one before, None for none. `must_move`: whether a turn must be observed.
    `forced`: whether the operator accepts the position as it is. `alarm`: its present fault; empty for none.
    """

    must_move: bool
    alarm: str

    def __init__(self, plan: CapturePlan, watch: HeadWatch, journal: Journal, bell: Callable[[], None]):
        self._plan, self._watch, self._journal, self._bell = plan, watch, journal, bell
        self.position = -1
        self.previous: int | None = None
        self.forced = self.must_move = False
        self.alarm = ""

    def begin(self, position: int) -> None:
        """Prompt for a position."""
        self.position, self.forced, self.alarm = position, False, ""
        # If gravity has the same direction as before, a turn of the head must be observed (or confirmed by Enter).
        before = self._plan.expected(self.previous) if self.previous is not None else None
        self.must_move = (
            before is not None
            and self.previous != position
            and angle_between_deg(before, self._plan.expected(position)) <= self._plan.tolerance_deg
            and not self._only_warmer()
        )

    def arrived(self) -> bool:
        """Whether the head is at rest at the position; a mistake is reported once."""
        watch = self._watch
        if not watch.still:
            watch.moved = True
            self.alarm = ""
            return False
        verdict = self._verdict()
        if self.must_move and not watch.moved and not self.forced:
            return False
        if verdict.fault is None or self.forced:
            self.alarm = ""
            return True
        not_begun = verdict.fault == Fault.NOT_TURNED and not watch.moved
        if not not_begun and verdict.text != self.alarm:
            self._refuse(verdict)
        return False

    def accept_as_is(self) -> None:
        """The operator accepts the position; the first time, a head that was not turned is reported."""
        verdict = self._verdict() if self._watch.blocks else None
        if verdict is not None and verdict.fault == Fault.NOT_TURNED and not self.alarm:
            self._refuse(verdict)
            return
        self.forced = True
        self._journal.write("forced", position=self.position, text=verdict.text if verdict else "")

    def _only_warmer(self) -> bool:
        """Whether the head stays where it is, and only the temperature changes."""
        steps, soaks = self._plan.steps, self._plan.soaks
        before, after = self.previous or 0, self.position
        angles = [(steps[k].alpha_deg, steps[k].beta_deg) for k in (before, after)]
        return angles[0] == angles[1] and soaks[before] != soaks[after]

    def _verdict(self) -> Verdict:
        return judge(self._plan, self.position, self._watch.blocks[-1].mean, self.previous)

    def _refuse(self, verdict: Verdict) -> None:
        self.alarm = verdict.text
        entry = "not_turned" if verdict.fault == Fault.NOT_TURNED else "wrong_position"
        self._journal.write(entry, position=self.position, text=verdict.text, off_deg=verdict.off_deg)
        self._bell()
