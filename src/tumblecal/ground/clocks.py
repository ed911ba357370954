"""Clocks that start anew."""

from collections.abc import Sequence

import numpy as np


def times_going_on(clocks: Sequence[np.ndarray]) -> np.ndarray:
    """Times of stretches that follow one another, each by a clock of its own, s: a later one goes on after the one before."""
    parts, now = [], 0.0
    for clock in clocks:
        time = clock - clock.min() + now if parts else clock
        parts.append(time)
        now = float(time.max() + np.ptp(time) / max(1, len(time) - 1))
    return np.concatenate(parts)
