"""Individuals charts (ISO 7870-2): limits from the mean moving range, and the false-alarm probability of results beyond.

The limits are as uncertain as the moving range. Without a change, a result is beyond them in 2 % of the charts with ten
results, in 4 % with twenty, and a unit has a dozen charts. So the p-value of a result beyond is that of the largest deviation
of a chart, by simulation.
"""

import numpy as np
from jaxtyping import Float


# Three standard deviations from the mean moving range, 3 / 1.128.
_MOVING_RANGE = 3 / 1.128
_FEWEST = 4
# Number of simulated charts, and largest number of drawn values (fixed seed: the same results give the same p).
_DRAWS, _NUMBERS = 10_000, 2_000_000


def control_limit(values: Float[np.ndarray, " entries"]) -> float:
    """Half width of the control limits; nan for less than four results."""
    return _MOVING_RANGE * float(np.mean(np.abs(np.diff(values)))) if len(values) >= _FEWEST else float("nan")


def beyond_by_chance(
    values: Float[np.ndarray, " entries"], sd: Float[np.ndarray, " entries"]
) -> Float[np.ndarray, " entries"]:
    """Probability, without a change, of a result as far beyond the limits of its chart as each of these; 1 within the limits,
    and without limits.

    **Arguments:**

    - `sd`: of each result; only their ratios are used, and only if none is 0 (not stated).
    """
    limit = control_limit(values)
    if not limit > 0:
        return np.ones(len(values))
    far = np.abs(values - np.mean(values)) / limit
    if not np.any(far > 1):
        return np.ones(len(values))
    draws = max(min(_DRAWS, _NUMBERS // len(values)), 1000)
    shape = sd / np.max(sd) if np.all(sd > 0) else np.ones(len(values))
    drawn = np.random.default_rng(0).normal(size=(draws, len(values))) * shape
    limits = _MOVING_RANGE * np.mean(np.abs(np.diff(drawn, axis=1)), axis=1)
    most = np.max(np.abs(drawn - np.mean(drawn, axis=1, keepdims=True)), axis=1) / limits
    return np.where(far > 1, np.mean(most[:, None] >= far, axis=0), 1.0)
