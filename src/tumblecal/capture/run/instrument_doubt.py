"""Handling of an instrument that does not state its serial number: a message, and the comparison of a finished position.

If the line was interrupted and the instrument does not state the serial number of the run, the position finished last is
measured again. The run continues if both dwells agree within their noise, and stops otherwise.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from tumblecal.capture.decoding.samples import Event
from tumblecal.capture.journal import Attempt, Journal, RunState
from tumblecal.capture.run.dwell import Dwell
from tumblecal.capture.run.identity import Answer, Identity
from tumblecal.capture.run.meeting import OTHER_SETTINGS, OTHER_UNIT
from tumblecal.capture.run.stationarity import Block, mean_variance
from tumblecal.ground.errors import InputError


# One false disagreement in a million comparisons.
LEAST_P = 1e-6
# Standard uncertainty of returning to a position: optical dividing heads repeat to some arc seconds.
REPEATABILITY_RAD = np.radians(10.0 / 3600)


@dataclass(frozen=True)
class Comparison:
    """Two dwells at one position.

    **Arguments:**

    - `difference_g`: second minus first mean, local g, shape (3,). `u_g`: its standard uncertainty per axis.
    - `p`: probability of such a difference for the same instrument. `agrees`: whether that is credible.
    """

    difference_g: NDArray[np.float64]
    u_g: NDArray[np.float64]
    p: float

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the noise."""
        return self.p >= LEAST_P

    @property
    def text(self) -> str:
        """The result in words."""
        axis = int(np.argmax(np.abs(self.difference_g) / self.u_g))
        size = float(self.difference_g[axis])
        return (
            f"{'agrees' if self.agrees else 'differs'}: largest difference {1e3 * size:+.3f} mg in {'xyz'[axis]} "
            f"({abs(size) / self.u_g[axis]:.1f} u), p {'= ' + format(self.p, '.2g') if self.p > 1e-100 else '< 1e-100'}"
        )


def compare(before_g: NDArray[np.float64], before_variance: NDArray[np.float64], blocks: list[Block]) -> Comparison:
    """Compare the mean of an earlier dwell and its variance per axis with a new dwell."""
    mean = np.average([block.mean for block in blocks], axis=0, weights=[block.n for block in blocks])
    difference = mean - before_g
    direction = before_g / np.linalg.norm(before_g)
    # Two arrivals at the position; a turn changes the reading at right angles to gravity only.
    turned = 2 * REPEATABILITY_RAD**2 * (np.eye(3) - np.outer(direction, direction))
    covariance = np.diag(before_variance + mean_variance(blocks)) + turned
    quadratic = float(difference @ np.linalg.solve(covariance, difference))
    return Comparison(difference, np.sqrt(np.diag(covariance)), float(chdtrc(3, quadratic)))


# Seconds of good samples for the comparison with a finished position.
COMPARED_S = 60.0
# Shortest time in which an instrument can be exchanged behind the same adapter, s.
_EXCHANGE_S = 3.0


class InstrumentDoubt:
    """Checks whether the instrument on the line is the one with which the run began.

    **Arguments:**

    - `identity`: queries it; None for no check.
    - `state`, `journal`: state and journal of the run; results are written into both.
    - `trust`: the operator states that it is the same instrument.

    `comparing`: the finished position that is being measured again; None otherwise.
    """

    def __init__(self, identity: Identity | None, state: RunState, journal: Journal, *, trust: bool):
        self._identity, self._state, self._journal, self._trust = identity, state, journal, trust
        self.comparing: Attempt | None = None
        self._interrupted = False

    @property
    def serial_number(self) -> str | None:
        """The serial number that was stated since the line was connected."""
        return self._identity.heard if self._identity is not None else self._state.serial_number

    @property
    def asking(self) -> bool:
        """Whether an answer may still come, so that nothing may be accepted yet."""
        return self._identity is not None and self._identity.answer == Answer.ASKED

    @property
    def text(self) -> str:
        """Message for the screen; empty if there is no doubt."""
        identity = self._identity
        if identity is None or identity.answer == Answer.CONFIRMED:
            return ""
        if identity.answer == Answer.ASKED:
            return f"querying the serial number of the instrument, attempt {identity.tries}"
        if not self._state.doubts:
            return ""
        again = "; a finished position is measured again before the run continues" if self.comparing else ""
        return f"identity not confirmed: the instrument does not state its serial number{again}"

    def begin(self, position: int) -> bool:
        """Start or resume a run; return whether a position must be compared first."""
        identity = self._identity
        if identity is not None and identity.answer == Answer.NONE and identity.serial_number is not None:
            return self._not_confirmed(position)
        return self._state.to_compare and self._to_compare()

    def interrupted(self, notice: dict[str, Any], speed: float) -> None:
        """Register an interruption of the line: the instrument may be a different one, unless the interruption was short."""
        reopened = notice["event"] == "reopened"
        if self._identity is not None and (reopened or notice.get("after_s", 0.0) * speed > _EXCHANGE_S):
            self._interrupted = True
            self._identity.interrupted()

    def hear(self, events: list[Event], position: int) -> bool:
        """Evaluate answers of the instrument; True if the guide must prompt again.

        **Raises:** `InputError` if it is a different instrument, or has different settings.
        """
        if self._identity is None:
            return False
        before = self._identity.answer
        answer = self._identity.look(events)
        if answer == Answer.OTHER:
            raise InputError(OTHER_UNIT.format(began=self._identity.serial_number, seen=self._identity.heard))
        if answer == Answer.OTHER_SETTINGS:
            raise InputError(OTHER_SETTINGS)
        interrupted, self._interrupted = self._interrupted, self._interrupted and answer == Answer.ASKED
        if answer == Answer.CONFIRMED and before != Answer.CONFIRMED:
            self._note("identity_confirmed", serial_number=self._identity.heard)
            compared, self.comparing = self.comparing, None
            return compared is not None
        return interrupted and answer == Answer.NONE and self._not_confirmed(position)

    def compared(self, name: str, dwell: Dwell) -> None:
        """Compare the position that was measured again.

        **Raises:** `InputError` if it does not agree.
        """
        before = self.comparing
        assert before is not None
        summary = before.summary
        sd = np.array(summary.get("sd_of_mean_g", np.array(summary["sd_g"]) / np.sqrt(summary["n"])))
        found = compare(np.array(summary["mean_g"]), sd**2, dwell.blocks)
        self._note(
            "compared",
            position=before.position,
            attempt=dwell.number,
            agrees=found.agrees,
            difference_g=found.difference_g.tolist(),
            u_g=found.u_g.tolist(),
            p=found.p,
            text=f"position {name} measured again {found.text}",
        )
        if not found.agrees:
            raise InputError(
                f"position {name} measured again {found.text}: the instrument is different, was changed or moved. Connect "
                "the first one and --resume; if you know that it is the same one, --resume with --trust-instrument"
            )
        self.comparing = None

    def _not_confirmed(self, position: int) -> bool:
        assert self._identity is not None
        tries = self._identity.tries
        asked = f"asked {tries} times" if tries else "this kind of instrument states none"
        text = f"identity not confirmed: no serial number stated since the line was connected ({asked})"
        began = self._identity.serial_number
        self._note("identity_not_confirmed", position=position, serial_number=began, asked=tries, text=text)
        return self._to_compare()

    def _to_compare(self) -> bool:
        if self._state.last_accepted is None:
            return False
        if self._trust:
            self._note("identity_trusted", text="the operator states that it is the same instrument")
            return False
        self.comparing = self._state.last_accepted
        return True

    def _note(self, entry: str, **content: object) -> None:
        self._state.doubts.append(self._journal.write(entry, **content))
