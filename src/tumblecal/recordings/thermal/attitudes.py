"""The attitude of each interval at rest: by a plan, by a table of files, by columns of the recording, or by gravity alone.

Intervals of unknown attitude have the same one if their mean readings differ by less than 0.17 g, the change of gravity in a
turn by 10 degrees. Biases do not affect this difference, and changes of bias and scale factor with temperature are smaller.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.parquet import scan_parquet
from tumblecal.ground.numbers_shown import shortened
from tumblecal.recordings.dwells.place import Place
from tumblecal.recordings.dwells.plan_match import matched
from tumblecal.recordings.still.intervals import Interval


ONE_ATTITUDE_G = 2 * float(np.sin(np.radians(10.0) / 2))
# Intervals of one attitude that differ by more than this (2 degrees) after a movement may be different positions.
_DOUBTFUL_G = ONE_ATTITUDE_G / 5


def attitudes_of_intervals(
    samples: Path,
    intervals: Sequence[Interval],
    means: NDArray[np.float64],
    plan: CapturePlan | None,
    of_file: Place | None,
) -> tuple[list[Place | None], list[str]]:
    """The attitude of each interval, None for one that is not used; and warnings.

    **Arguments:**

    - `samples`: the table of samples. `means` (intervals, 3): mean readings, g. `of_file`: the position of the file, if it is
      known: that of its longest interval.
    """
    if of_file is None and plan is not None:
        match = matched(means, plan)
        lines = [line for line in match.words() if "measured again" not in line]
        if surplus := [f"{intervals[k].start_s:.0f} s" for k in match.surplus]:
            lines.append(f"intervals at rest that are not positions of the plan are not used: {shortened(surplus, 6)}")
        return [Place("").at_step(plan, k) if k >= 0 else None for k in match.positions.tolist()], lines
    if of_file is None and (stated := _stated(samples, intervals)):
        return stated, []
    index, firsts = grouped(means)
    if of_file is not None:
        longest = np.bincount(index, [interval.stop - interval.start for interval in intervals]).argmax()
        others = int((index != longest).sum())
        lines = [f"{others} intervals in other attitudes than that of the file are not used"]
        return [of_file if k == longest else None for k in index], lines if others else []
    spread = np.linalg.norm(means - np.array(firsts)[index], axis=1)
    lines = [
        f"attitude a{k + 1}: its intervals differ by {np.degrees(spread[index == k].max()):.1f} deg; if these are different "
        "positions, give their angles: --plan PLAN.toml"
        for k in np.unique(index[spread > _DOUBTFUL_G])
    ]
    return [Place(f"a{k + 1}") for k in index], lines


def grouped(means: NDArray[np.float64]) -> tuple[NDArray[np.int64], list[NDArray[np.float64]]]:
    """Groups of readings (rows, 3) in g that differ by less than `ONE_ATTITUDE_G` from the first of their group."""
    index, firsts = np.zeros(len(means), int), list[NDArray[np.float64]]()
    for row, mean in enumerate(means):
        far = [float(np.linalg.norm(mean - first)) for first in firsts]
        if min(far, default=np.inf) > ONE_ATTITUDE_G:
            firsts.append(mean)
            far.append(0.0)
        index[row] = np.argmin(far)
    return index, firsts


def _stated(samples: Path, intervals: Sequence[Interval]) -> list[Place | None]:
    """The position that columns of the samples state in the middle of each interval; none without them."""
    table = scan_parquet(samples, check=False)[0]
    there = set(table.collect_schema())
    angles = {"alpha_deg", "beta_deg"} <= there
    if not (angles or "position" in there):
        return []
    places = list[Place | None]()
    for interval in intervals:
        row = table.slice((interval.start + interval.stop) // 2, 1).collect().row(0, named=True)
        at = (float(row["alpha_deg"]), float(row["beta_deg"])) if angles else (None, None)
        places.append(Place(str(row["position"]) if "position" in there else "{:g}, {:g} deg".format(*at), *at))
    return places
