"""Measured positions against those of a designed plan: missing, repeated and unknown ones, as lines to print.

A calibration uses the positions as they were measured: visits of settings are numbered by the recorded times. So a position
that is missing or repeated changes the uncertainties, and nothing else.
"""

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from tumblecal.chain.rig import Rig
from tumblecal.chain.where import VISITS
from tumblecal.data import PositionSet
from tumblecal.words import sentences


# The largest difference of two angles that are the same, deg.
_SAME_DEG = 0.05


def is_designed(rig: Rig | None) -> bool:
    """Whether a rig is that of a designed plan: the head is described, and every position has its time."""
    return rig is not None and rig.ability is not None and rig.plan.time_s is not None


def indexed_by_visit(rig: Rig | None) -> bool:
    """Whether a rig has errors of settings by visit, so that all files of a plan are one measurement."""
    return rig is not None and any(leaf.by in VISITS for leaf in rig.leaves.values())


def compared_with_plan(rig: Rig, data: PositionSet) -> list[str]:
    """Differences between measured positions and a designed plan, one line for each kind.

    **Arguments:**

    - `rig`: of the plan. Its positions and the measured ones are matched by mounting and name. Of joined files, a name in more
      than one file has that of its file as prefix.
    """
    plan = rig.plan
    only = plan.mounts[0] if len(set(plan.mounts)) == 1 else "1"
    wanted = dict(zip(_keys(plan.mounts, plan.names), zip(plan.alpha_deg, plan.beta_deg, strict=True), strict=True))
    keys = _keys(data.mount or (only,) * len(data), data.names)
    if len(data.files) > 1:
        keys = [key if key in wanted else (key[0], key[1].rpartition(":")[2]) for key in keys]
    rows = [(*key, *angles) for key, angles in zip(keys, zip(data.alpha_deg, data.beta_deg, strict=True), strict=True)]
    times = Counter((mount, name) for mount, name, *_ in rows)
    other = [
        (mount, name)
        for mount, name, alpha, beta in rows
        if (mount, name) in wanted
        and np.any(np.abs((np.subtract((alpha, beta), wanted[mount, name]) + 180.0) % 360.0 - 180.0) >= _SAME_DEG)
    ]
    unknown = [key for key in times if key not in wanted]
    if other or len(unknown) == len(times):
        return sentences("positions/other_plan", names=_names(other or unknown), other=bool(other), rig=rig.source)
    absent = [mount for mount in dict.fromkeys(plan.mounts) if all(key[0] != mount for key in times)]
    return sentences(
        "positions/compared_with_plan",
        rig=rig.source,
        planned=len(wanted),
        absent=[(mount, plan.mounts.count(mount)) for mount in absent],
        missing=_names(key for key in wanted if key not in times and key[0] not in absent),
        repeated=_names(key for key, count in times.items() if count > 1),
        unknown=_names(unknown),
    )


def _keys(mounts: Sequence[str], names: Sequence[str]) -> list[tuple[str, str]]:
    return list(zip(mounts, names, strict=True))


def _names(keys: Iterable[tuple[str, str]]) -> list[str]:
    """Positions by mounting: `A 3`, `A 4`."""
    return [f"{mount} {name}" for mount, name in dict.fromkeys(keys)]
