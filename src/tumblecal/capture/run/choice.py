"""The choice of each next position of an adaptive run: what a chooser gets and returns.

The chooser itself is injected, because it needs the model of the instrument, and a capture does not.
"""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class DonePosition:
    """A finished position: angles, deg; `start_s` of its dwell, s of the device's time since any instant, and the standard
    deviation of its mean, g, per axis."""

    alpha_deg: float
    beta_deg: float
    start_s: float
    sd_g: tuple[float, ...]


@dataclass(frozen=True)
class Progress:
    """The state of a run before a choice.

    - `done`: finished positions in measuring order. `end_s`: end of the last dwell, on the same clock.
    - `remaining_s`: remaining time of the run from then on. `skipped`: angles (deg) that the operator skipped.
    """

    done: tuple[DonePosition, ...]
    end_s: float
    remaining_s: float
    skipped: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Choice:
    """The next position, and its purpose for the operator."""

    alpha_deg: float
    beta_deg: float
    purpose: str


@dataclass(frozen=True)
class Ending:
    """The run is over: `reason` is "target", "time" or "no position"; `text` for the operator."""

    reason: str
    text: str


# Called from a thread: it may take a second, and much longer at its first call.
Chooser = Callable[[Progress], Choice | Ending]
