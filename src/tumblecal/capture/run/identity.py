"""Whether the instrument on the line is the one with which the run began.

A missing answer does not mean a different instrument: the receive line may not be connected, or the answer may be late. If
the line was interrupted and the instrument does not state the serial number of the run, the position finished last is
measured again. The run continues if both dwells agree within their noise, and stops otherwise.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from tumblecal.capture.decoding.samples import Event
from tumblecal.capture.journal import Attempt, Journal
from tumblecal.capture.run import contact
from tumblecal.capture.run.dwell import Dwell
from tumblecal.capture.run.rest import Blocks, mean_variance
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# One false disagreement in a million comparisons.
LEAST_P = 1e-6
# Standard uncertainty of returning to a position: optical dividing heads repeat to some arc seconds.
REPEATABILITY_RAD = np.radians(10.0 / 3600)
# Seconds of good samples for the comparison with a finished position.
COMPARED_S = 60.0
# Shortest time in which an instrument can be exchanged behind the same adapter, s.
_EXCHANGE_S = 3.0


class Comparison(NamedTuple):
    """Two dwells at one position: second minus first mean, local g, its standard uncertainty per axis, shapes (3,), and the
    probability of such a difference for the same instrument."""

    difference_g: NDArray[np.float64]
    u_g: NDArray[np.float64]
    p: float


def compare(
    before_g: NDArray[np.float64], before_variance: NDArray[np.float64], after: Blocks, size: int
) -> Comparison:
    """Compare the mean of an earlier dwell and its variance per axis with a new dwell, in blocks of `size` samples."""
    difference = after[:, 0].mean(0) - before_g
    direction = before_g / np.linalg.norm(before_g)
    # Two arrivals at the position; a turn changes the reading at right angles to gravity only.
    turned = 2 * REPEATABILITY_RAD**2 * (np.eye(3) - np.outer(direction, direction))
    covariance = np.diag(before_variance + mean_variance(after, size)) + turned
    quadratic = float(difference @ np.linalg.solve(covariance, difference))
    return Comparison(difference, np.sqrt(np.diag(covariance)), float(chdtrc(3, quadratic)))


class Identity:
    """Checks whether the instrument on the line is the one of the run.

    **Arguments:**

    - `journal`: of the run; results are written into it.
    - `send`: sends a command to the instrument. `queries`: commands that make it state its serial number and settings.
    - `trust`: the operator states that it is the same instrument.

    `serial_number`: as stated since the line was connected; None if it was not.
    """

    serial_number: str | None

    def __init__(self, journal: Journal, send: Callable[[bytes], None], queries: tuple[bytes, ...], *, trust: bool):
        self._journal, self._send, self._queries, self._trust = journal, send, queries, trust
        self.serial_number = None
        self._questions: contact.Questions | None = None

    @property
    def comparing(self) -> Attempt | None:
        """The finished position that is measured again before the run continues; None if none must be."""
        state = self._journal.state
        return state.last_accepted if state.to_compare else None

    @property
    def asking(self) -> bool:
        """Whether an answer may still come, so that nothing may be accepted yet."""
        return self._questions is not None

    @property
    def confirmed(self) -> bool:
        """Whether the instrument stated the serial number of the run since its line was connected."""
        return self.serial_number is not None and self.serial_number == self._journal.state.serial_number

    @property
    def text(self) -> str:
        """Message for the screen; empty if there is no doubt."""
        if self._questions is not None:
            return f"querying the serial number of the instrument, attempt {self._questions.tries}"
        if self.confirmed or not self._journal.state.doubts:
            return ""
        again = "; a finished position is measured again before the run continues" if self.comparing else ""
        return f"identity not confirmed: the instrument does not state its serial number{again}"

    def check(self, events: list[Event]) -> None:
        """Evaluate answers of the instrument.

        **Raises:** `InputError` if it is a different instrument, or has different settings.
        """
        state = self._journal.state
        began, settings = state.serial_number, (state.configuration or {}).get("raw")
        for event in events:
            if event.kind == "serial_number":
                self.serial_number = str(event.content["serial_number"])
                if began not in (None, self.serial_number):
                    raise InputError(
                        f"this run began with serial number {began}, but {self.serial_number} is connected: connect {began}, "
                        "or begin a new run"
                    )
            if (
                event.kind == "configuration"
                and settings is not None
                and event.content.get("raw") not in (None, settings)
            ):
                raise InputError(
                    "the settings of the instrument differ from those of this run: restore them, then --resume, or begin a "
                    "new run"
                )

    def begin(self, position: int) -> None:
        """Start or resume a run at a position."""
        if not self.confirmed and self._journal.state.serial_number is not None:
            self._not_confirmed(position, len(contact.WAITS_S))
        elif self.comparing is not None and self._trust:
            self._trusted()

    def interrupted(self, notice: dict[str, Any], speed: float) -> None:
        """Register an interruption of the line: the instrument may be a different one, unless the interruption was short."""
        if notice["event"] == "reopened" or notice.get("after_s", 0.0) * speed > _EXCHANGE_S:
            known = self._journal.state.serial_number is not None
            self.serial_number = None
            self._questions = contact.Questions(self._send, self._queries if known else ())

    def hear(self, events: list[Event], position: int) -> bool:
        """Evaluate answers of the instrument, and repeat the questions when they are due; whether to prompt again.

        **Raises:** `InputError` if it is a different instrument, or has different settings.
        """
        before, comparing = self.confirmed, self.comparing is not None
        self.check(events)
        if self.confirmed and not before:
            self._questions = None
            self._journal.write("identity_confirmed", serial_number=self.serial_number)
            return comparing
        if self._questions is None or self._questions.open():
            return False
        tries, self._questions = self._questions.tries, None
        self._not_confirmed(position, tries)
        return self.comparing is not None

    def compared(self, name: str, dwell: Dwell) -> None:
        """Compare the position that was measured again.

        **Raises:** `InputError` if it does not agree.
        """
        before = self.comparing
        assert before is not None
        summary = before.summary
        sd = np.array(summary.get("sd_of_mean_g", np.array(summary["sd_g"]) / np.sqrt(summary["n"])))
        found = compare(np.array(summary["mean_g"]), sd**2, dwell.blocks, dwell.size)
        agrees, ratios = found.p >= LEAST_P, np.abs(found.difference_g) / found.u_g
        axis = int(np.argmax(ratios))
        text = (
            f"position {name} measured again {'agrees' if agrees else 'differs'}: largest difference "
            f"{1e3 * found.difference_g[axis]:+.3f} mg in {AXES[axis]} ({ratios[axis]:.1f} u), p "
            f"{'= ' + format(found.p, '.2g') if found.p > 1e-100 else '< 1e-100'}"
        )
        self._journal.write(
            "compared",
            position=before.position,
            attempt=dwell.number,
            agrees=agrees,
            difference_g=found.difference_g.tolist(),
            u_g=found.u_g.tolist(),
            p=found.p,
            text=text,
        )
        if not agrees:
            raise InputError(
                f"{text}: the instrument is different, was changed or moved. Connect "
                "the first one and --resume; if you know that it is the same one, --resume with --trust-instrument"
            )

    def _not_confirmed(self, position: int, tries: int) -> None:
        asked = f"asked {tries} times" if self._queries else "this kind of instrument states none"
        text = f"identity not confirmed: no serial number stated since the line was connected ({asked})"
        began = self._journal.state.serial_number
        self._journal.write("identity_not_confirmed", position=position, serial_number=began, asked=tries, text=text)
        if self.comparing is not None and self._trust:
            self._trusted()

    def _trusted(self) -> None:
        self._journal.write("identity_trusted", text="the operator states that it is the same instrument")
