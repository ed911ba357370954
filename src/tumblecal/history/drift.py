"""Parameters that drift, and a history without their drift: the drift explains findings that are only in the former."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from tumblecal.data.sensor_parameters import leaf_of
from tumblecal.history.repeatability import Trend, UnitHistory, months_of, unit_history, unlikely_among


@dataclass(frozen=True)
class Drift:
    """A parameter that changes with time, base units: its trend, and the p-value of no drift (Student's t)."""

    trend: Trend
    p_value: float


def drifts(history: UnitHistory) -> list[Drift]:
    """The parameters with a significant slope, at a family-wise error rate of 0.05 (Sidak 1967)."""
    known = [trend for trend in history.trends if np.isfinite(trend.drift) and trend.drift_sd > 0]
    found = [Drift(trend, 2 * float(stdtr(min(trend.dof, 1e9), -abs(trend.drift) / trend.drift_sd))) for trend in known]
    return [drift for drift in found if drift.p_value < unlikely_among(len(known))]


def without_drift(history: UnitHistory, found: Sequence[Drift]) -> UnitHistory:
    """The same results, with the line of each drift subtracted."""
    slopes = {drift.trend.name: drift.trend.drift for drift in found}
    months = months_of([entry.when for entry in history.entries])
    entries = []
    for entry, after in zip(history.entries, months, strict=True):
        assert entry.parameters is not None
        parameters = entry.parameters
        moved = np.array([slopes.get(name, 0.0) for name in parameters.names]) * after
        entries.append(replace(entry, parameters=replace(parameters, values=parameters.values - moved)))
    return unit_history(entries, {leaf_of(trend.name): trend.limit for trend in history.trends})
