"""Positions that sample an unexplained error: between the measured ones where it is, in the reverse order."""

from typing import NamedTuple

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.planning.proposals import Allowed


SAMPLE = "sample the unexplained error"
REVERSED = "Keep this order, the reverse of the first: an error that depends on time then appears at different angles."
# No position is proposed between measured angles with a larger distance (deg).
_FARTHEST_DEG = 120.0
_LEAST = 3


class Sample(NamedTuple):
    """A position, deg, and the error near it in standard deviations of the noise; `order`: measuring order nearby."""

    alpha_deg: float
    beta_deg: float
    in_sd: float
    order: float


def samples(diagnosis: Diagnosis, allowed: Allowed, most: int) -> list[Sample]:
    """Positions where an unexplained error is: between neighbouring spindle angles of a pitch setting, or at the allowed ones,
    and if these are few also at the measured ones; the last measured first."""
    unnamed, data = diagnosis.unnamed, diagnosis.data
    assert unnamed is not None
    sizes = np.max(np.abs(unnamed.excess.values) / (diagnosis.level * diagnosis.problem.sd), axis=1)
    order, found = diagnosis.problem.where.measuring_order, list[Sample]()

    def sample(alpha: float, beta: float, near: np.ndarray) -> None:
        if np.any(unnamed.excess.positions[near]):
            found.append(Sample(alpha, beta, float(np.mean(sizes[near])), float(np.mean(order[near]))))

    for level in np.unique(data.pitch_setting_deg).tolist():
        here = np.flatnonzero((data.pitch_setting_deg == level) & unnamed.fit.retained)
        if not len(here) or not (allowed.beta_deg is None or np.any(np.isclose(allowed.beta_deg, level))):
            continue
        here = here[np.argsort(np.mod(data.alpha_deg[here], 360.0), kind="stable")]
        alpha, after = np.mod(data.alpha_deg[here], 360.0), np.roll(here, -1)
        gaps = np.mod(np.roll(alpha, -1) - alpha, 360.0)
        half_way = np.flatnonzero((gaps > 0) & (gaps <= _FARTHEST_DEG))
        angles = np.mod(alpha + 0.5 * gaps, 360.0)[half_way] if allowed.alpha_deg is None else allowed.alpha_deg
        for angle in angles:
            before = int(np.argmin(np.mod(angle - alpha, 360.0)))
            sample(float(angle), level, np.array([here[before], after[before]]))
    if len(found) < _LEAST and allowed.alpha_deg is None and allowed.beta_deg is None:
        for k in range(len(data)):
            sample(float(data.alpha_deg[k]), float(data.pitch_setting_deg[k]), np.array([k]))
    largest = sorted(found, key=lambda one: -one.in_sd)[:most]
    return sorted(largest, key=lambda one: -one.order)
