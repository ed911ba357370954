"""Positions that sample an unexplained error: between the measured ones where it is, in the reverse order."""

import numpy as np

from tumblecal.diagnosis import Diagnosis
from tumblecal.plan.next.proposals import Allowed, NextPosition


SAMPLE = "sample the unexplained error"
REVERSED = "Keep this order, the reverse of the first: an error that depends on time then appears at different angles."
# No position is proposed between measured angles with a larger distance (deg).
_FARTHEST_DEG = 120.0
_LEAST = 3


def samples(diagnosis: Diagnosis, allowed: Allowed, most: int) -> list[NextPosition]:
    """Positions where an unexplained error is: between neighbouring spindle angles of a pitch setting, or at the allowed ones,
    and if these are few also at the measured ones; the last measured first. Their value is the error near them in standard
    deviations of the noise."""
    unnamed, data = diagnosis.unnamed, diagnosis.data
    assert unnamed is not None
    sizes = np.max(np.abs(unnamed.excess.values) / (diagnosis.level * diagnosis.problem.sd), axis=1)
    # Angles, and the measured positions near them.
    listed = list[tuple[float, float, list[int]]]()
    for level in np.unique(data.pitch_setting_deg).tolist():
        here = np.flatnonzero((data.pitch_setting_deg == level) & unnamed.fit.retained)
        if not len(here) or not (allowed.beta_deg is None or np.any(np.isclose(allowed.beta_deg, level))):
            continue
        here = here[np.argsort(np.mod(data.alpha_deg[here], 360.0), kind="stable")]
        alpha = np.mod(data.alpha_deg[here], 360.0)
        gaps = np.mod(np.roll(alpha, -1) - alpha, 360.0)
        between = np.mod(alpha + 0.5 * gaps, 360.0)[(gaps > 0) & (gaps <= _FARTHEST_DEG)]
        for angle in between.tolist() if allowed.alpha_deg is None else allowed.alpha_deg:
            before = int(np.argmin(np.mod(angle - alpha, 360.0)))
            listed.append((float(angle), level, [int(here[before]), int(here[(before + 1) % len(here)])]))

    def shown(near: list[int]) -> bool:
        return bool(np.any(unnamed.excess.positions[near]))

    if sum(shown(near) for *_, near in listed) < _LEAST and allowed.alpha_deg is None and allowed.beta_deg is None:
        listed += zip(
            data.alpha_deg.tolist(), data.pitch_setting_deg.tolist(), ([k] for k in range(len(data))), strict=True
        )
    chosen = sorted((one for one in listed if shown(one[2])), key=lambda one: -np.mean(sizes[one[2]]))[:most]
    order = diagnosis.problem.where.measuring_order
    chosen.sort(key=lambda one: -np.mean(order[one[2]]))
    return [NextPosition(alpha, beta, "", SAMPLE, float(np.mean(sizes[near]))) for alpha, beta, near in chosen]
