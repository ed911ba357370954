"""The attitude of each interval at rest: by a plan, by a table of files, by columns of the recording, or by gravity alone.

Intervals of unknown attitude have the same one if their mean readings differ by less than 0.17 g, the change of gravity in a
turn by 10 degrees. Biases do not affect this difference, and changes of bias and scale factor with temperature are smaller.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.parquet import scan_parquet
from tumblecal.recordings.dwells.place import Place
from tumblecal.recordings.dwells.plan_match import matched
from tumblecal.recordings.options import KnownContext
from tumblecal.recordings.still.intervals import Interval
from tumblecal.recordings.thermal.series import ThermalSeries


ONE_ATTITUDE_G = 2 * float(np.sin(np.radians(10.0) / 2))
# Intervals of one attitude that differ by more than this after a movement may be different positions.
_DOUBTFUL_G = 2 * float(np.sin(np.radians(2.0) / 2))
_SHOWN = 6


def attitudes_of_intervals(
    samples: Path,
    intervals: Sequence[Interval],
    means: NDArray[np.float64],
    known: tuple[KnownContext, CapturePlan | None],
    of_file: Place | None,
) -> tuple[NDArray[np.int64], list[Place], list[str]]:
    """The attitude of each interval as an index, -1 for none; the positions; and warnings.

    **Arguments:**

    - `samples`: the table of samples. `means` (intervals, 3): mean readings, g. `known`: context, and its plan. `of_file`: the
      position of the file, if it is known: that of its longest interval.
    """
    context, plan = known
    mount = context.mount or (of_file.mount if of_file else "")
    if of_file is None and plan is not None:
        mount = mount or (plan.session.mount if plan.session.mount != "1" else "")
        match = matched(means, plan)
        lines = [line for line in match.words() if "measured again" not in line]
        if surplus := [f"{intervals[k].start_s:.0f} s" for k in match.surplus]:
            lines.append(
                f"intervals at rest that are not positions of the plan are not used: {', '.join(surplus[:_SHOWN])}"
            )
        return match.positions, [Place("", mount=mount).at_step(plan, k) for k in range(len(plan.steps))], lines
    if of_file is None and (stated := _stated(samples, intervals)) is not None:
        places = list(dict.fromkeys(stated))
        return np.array([places.index(one) for one in stated]), [replace(one, mount=mount) for one in places], []
    index, firsts = grouped(means)
    if of_file is not None:
        lengths = np.bincount(index, [interval.stop - interval.start for interval in intervals])
        longest = int(np.argmax(lengths))
        others = int((index != longest).sum())
        lines = [f"{others} intervals in other attitudes than that of the file are not used"] if others else []
        return np.where(index == longest, 0, -1), [replace(of_file, mount=mount)], lines
    spreads = [float(np.linalg.norm(means[index == k] - first, axis=1).max()) for k, first in enumerate(firsts)]
    lines = [
        f"attitude a{k + 1}: its intervals differ by {np.degrees(spread):.1f} deg; if these are different positions, give "
        "their angles: --plan PLAN.toml"
        for k, spread in enumerate(spreads)
        if spread > _DOUBTFUL_G
    ]
    return index, [Place(f"a{k + 1}", mount=mount) for k in range(len(firsts))], lines


def grouped(means: NDArray[np.float64]) -> tuple[NDArray[np.int64], list[NDArray[np.float64]]]:
    """Groups of readings (rows, 3) in g that differ by less than `ONE_ATTITUDE_G` from the first of their group."""
    index, firsts = np.zeros(len(means), int), list[NDArray[np.float64]]()
    for row, mean in enumerate(means):
        far = [float(np.linalg.norm(mean - first)) for first in firsts]
        if not far or min(far) > ONE_ATTITUDE_G:
            firsts.append(mean)
            far.append(0.0)
        index[row] = int(np.argmin(far))
    return index, firsts


def labelled(series: Sequence[ThermalSeries], *, same: bool) -> list[ThermalSeries]:
    """Series whose unknown attitudes have different labels in different recordings, or, if they are the `same`, equal ones for
    equal directions of gravity."""
    names = list(dict.fromkeys(one.name for one in series))
    if len(names) < 2:
        return list(series)
    forces = dict[tuple[str, int], list[NDArray[np.float64]]]()
    for one in series:
        attitude = one.attitude[one.visit]
        for k in np.unique(attitude).tolist():
            if not one.places[k].known:
                forces.setdefault((one.name, k), []).append(one.force[attitude == k])
    labels = {
        (name, k): f"{name}:{next(one for one in series if one.name == name).places[k].name}" for name, k in forces
    }
    if same and forces:
        index, _ = grouped(np.array([np.concatenate(parts).mean(0) for parts in forces.values()]))
        labels = {key: f"a{number + 1}" for key, number in zip(forces, index.tolist(), strict=True)}
    return [
        replace(
            one,
            places=tuple(replace(at, name=labels.get((one.name, k), at.name)) for k, at in enumerate(one.places)),
        )
        for one in series
    ]


def _stated(samples: Path, intervals: Sequence[Interval]) -> list[Place] | None:
    """The position that columns of the samples state in the middle of each interval; None without them."""
    table = scan_parquet(samples, check=False)[0]
    there = table.collect_schema().names()
    angles = {"alpha_deg", "beta_deg"} <= set(there)
    if "position" not in there and not angles:
        return None
    places = []
    for interval in intervals:
        row = table.slice((interval.start + interval.stop) // 2, 1).collect().row(0, named=True)
        alpha, beta = (float(row[name]) if angles else None for name in ("alpha_deg", "beta_deg"))
        name = str(row["position"]) if "position" in there else f"{alpha:g}, {beta:g} deg"
        places.append(Place(name, alpha, beta))
    return places
