"""Positions that sample an unexplained error: between the measured ones where it is, in the reverse order."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

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
    order, inside = diagnosis.problem.where.measuring_order, unnamed.excess.positions
    found = list[Sample]()
    for level in np.unique(data.pitch_setting_deg).tolist():
        if allowed.beta_deg is not None and not np.any(np.isclose(allowed.beta_deg, level)):
            continue
        here = np.flatnonzero((data.pitch_setting_deg == level) & unnamed.fit.retained)
        here = here[np.argsort(np.mod(data.alpha_deg[here], 360.0), kind="stable")]
        for alpha, before, after in _between(np.mod(data.alpha_deg[here], 360.0), allowed.alpha_deg):
            both = here[[before, after]]
            if np.any(inside[both]):
                found.append(Sample(alpha, level, float(np.mean(sizes[both])), float(np.mean(order[both]))))
    if len(found) < _LEAST and allowed.alpha_deg is None and allowed.beta_deg is None:
        found += [
            Sample(float(data.alpha_deg[k]), float(data.pitch_setting_deg[k]), float(sizes[k]), float(order[k]))
            for k in np.flatnonzero(inside).tolist()
        ]
    largest = sorted(found, key=lambda sample: -sample.in_sd)[:most]
    return sorted(largest, key=lambda sample: -sample.order)


def _between(alpha_deg: Float[np.ndarray, " own"], allowed: tuple[float, ...] | None) -> list[tuple[float, int, int]]:
    """Angles with the numbers of the measured ones before and after each: half-way, or those allowed."""
    count = len(alpha_deg)
    gaps = np.mod(np.roll(alpha_deg, -1) - alpha_deg, 360.0)
    middles = [
        (float(np.mod(alpha_deg[k] + 0.5 * gaps[k], 360.0)), k, (k + 1) % count) for k in range(count) if gaps[k] > 0
    ]
    if allowed is None:
        return [(alpha, before, after) for alpha, before, after in middles if gaps[before] <= _FARTHEST_DEG]
    places = [int(np.argmin(np.mod(alpha - alpha_deg, 360.0))) for alpha in allowed] if count else []
    return [(float(alpha), k, (k + 1) % count) for alpha, k in zip(allowed, places, strict=True)]
