"""Measured positions against those of a designed plan: missing, repeated and unknown ones, as lines to print.

A calibration uses the positions as they were measured: visits of settings are numbered by the recorded times. So a position
that is missing or repeated changes the uncertainties, and nothing else.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from tumblecal.chain.rig import Rig
from tumblecal.chain.where import VISITS
from tumblecal.data import PositionSet
from tumblecal.ground.numbers_shown import counted, shortened


# Names of positions in one line, and the largest difference of two angles that are the same, deg.
_MOST_NAMES, _SAME_DEG = 6, 0.05


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
        what = f"{_names(other or unknown)} {'with other angles than' if other else 'which are not in'}"
        return [
            f"positions {what} {rig.source}: it is the rig of a different plan; give the rig.toml that "
            "tumblecal plan wrote with the plan of the capture"
        ]
    lines = list[str]()
    absent = [mount for mount in dict.fromkeys(plan.mounts) if all(key[0] != mount for key in times)]
    for mount in absent:
        lines.append(
            f"no position of mounting {mount}, of {plan.mounts.count(mount)} in {rig.source}: the standard uncertainties are "
            "larger than planned; capture this mounting, and give all files in one call with --join"
        )
    if missing := [key for key in wanted if key not in times and key[0] not in absent]:
        lines.append(
            f"{counted(len(missing), 'position')} of {len(wanted)} in {rig.source} not measured ({_names(missing)}): the "
            "standard uncertainties are larger than planned; continue the capture with --resume, or capture these positions"
        )
    if repeated := [key for key, count in times.items() if count > 1]:
        lines.append(
            f"{counted(len(repeated), 'position')} of {rig.source} measured more than once ({_names(repeated)}): every "
            "measurement is used, at its recorded time; delete rows that must not be used"
        )
    if unknown:
        lines.append(
            f"{counted(len(unknown), 'position')} not in {rig.source} ({_names(unknown)}): used, in addition to the plan; "
            "delete rows that must not be used"
        )
    return lines


def _keys(mounts: Sequence[str], names: Sequence[str]) -> list[tuple[str, str]]:
    return list(zip(mounts, names, strict=True))


def _names(keys: Sequence[tuple[str, str]]) -> str:
    """Positions by mounting: `A 3, A 4`."""
    return shortened([f"{mount} {name}" for mount, name in dict.fromkeys(keys)], _MOST_NAMES)
