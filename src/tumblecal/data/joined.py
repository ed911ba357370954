"""Several position sets of one triad on one head as one."""

from collections.abc import Sequence

import numpy as np

from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError


def joined(sets: Sequence[PositionSet]) -> PositionSet:
    """The positions of all sets in their order.

    Runs and mounts that are not named are called 1. The times of a set go on one mean step after those of the set before it.
    Time, temperature, approach and n are kept where all sets have them.

    **Raises:** `InputError` when some sets state standard deviations and some do not.
    """
    if len(sets) == 1:
        return sets[0]
    with_sd = [one.sd is not None for one in sets]
    if any(with_sd) and not all(with_sd):
        lacking = ", ".join(one.source for one, has in zip(sets, with_sd, strict=True) if not has)
        raise InputError(f"{lacking}: no sd columns, but other files have them; give all files sd columns, or none")

    def column(name: str) -> np.ndarray | None:
        parts = [getattr(one, name) for one in sets]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    def labels(name: str, default: str = "1") -> tuple[str, ...] | None:
        if all(getattr(one, name) is None for one in sets):
            return None
        return tuple(label for one in sets for label in getattr(one, name) or (default,) * len(one))

    return PositionSet(
        names=tuple(name for one in sets for name in one.names),
        alpha_deg=np.concatenate([one.alpha_deg for one in sets]),
        beta_deg=np.concatenate([one.beta_deg for one in sets]),
        readings=np.concatenate([one.readings for one in sets]),
        sd=column("sd"),
        run=labels("run"),
        mount=labels("mount"),
        time_s=_times(sets),
        temperature_degc=column("temperature_degc"),
        approach=column("approach"),
        n=column("n"),
        recorded_noise=labels("recorded_noise", ""),
        comments=dict(sets[0].comments),
        source=", ".join(one.source for one in sets),
    )


def _times(sets: Sequence[PositionSet]) -> np.ndarray | None:
    parts, now = [], 0.0
    for one in sets:
        if one.time_s is None:
            return None
        time = one.time_s - one.time_s.min() + now if parts else one.time_s
        parts.append(time)
        now = float(time.max() + np.ptp(time) / max(1, len(time) - 1))
    return np.concatenate(parts)
