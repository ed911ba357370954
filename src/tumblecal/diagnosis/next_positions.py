"""Where to measure next: the positions that separate the leading explanations, or help the worst parameter."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NextPosition:
    """A proposal: angles in degrees, mounting in words, and the expected log Bayes factor (or sd ratio) it brings."""

    alpha_deg: float
    beta_deg: float
    mount: str
    purpose: str
    value: float


def next_positions(*_) -> list[NextPosition]:
    """None yet."""
    return []
