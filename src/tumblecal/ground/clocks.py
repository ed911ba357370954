"""Clocks that restart."""

from collections.abc import Sequence

import numpy as np


def continued_times(clocks: Sequence[np.ndarray]) -> np.ndarray:
    """Increasing times of consecutive stretches with separate clocks, s: each stretch continues after the previous one."""
    parts, now = [], 0.0
    for clock in clocks:
        time = clock - clock.min() + now if parts else clock
        parts.append(time)
        now = float(time.max() + np.ptp(time) / max(1, len(time) - 1))
    return np.concatenate(parts)
