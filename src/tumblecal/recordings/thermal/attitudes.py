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
from tumblecal.recordings.thermal.series import Attitude, RecordingSeries


ONE_ATTITUDE_G = 2 * float(np.sin(np.radians(10.0) / 2))
# Intervals of one attitude that differ by more than this after a movement may be different positions.
_DOUBTFUL_G = 2 * float(np.sin(np.radians(2.0) / 2))


def attitudes_of_intervals(
    samples: Path,
    intervals: Sequence[Interval],
    means: NDArray[np.float64],
    context: KnownContext,
    plan: CapturePlan | None,
    of_file: Place | None,
) -> tuple[NDArray[np.int64], list[Attitude], list[str]]:
    """The attitude of each interval as an index, -1 for none; the attitudes; and warnings.

    **Arguments:**

    - `samples`: the table of samples. `means` (intervals, 3): mean readings, g.
    """
    mount = context.mount or (of_file.mount if of_file else "")
    if of_file is not None:
        return _of_file(intervals, means, replace(_unknown(of_file.name, means[0], mount), **_angles(of_file)))
    if plan is not None:
        return _in_plan(intervals, means, plan, mount)
    stated = _stated(samples, intervals)
    if stated is not None:
        return _by_columns(stated, means, mount)
    index, attitudes = grouped(means)
    warnings = [
        f"attitude a{k + 1}: its intervals differ by {np.degrees(spread):.1f} deg; if these are different positions, give "
        "their angles: --plan PLAN.toml"
        for k, of in enumerate(attitudes)
        if (spread := _spread(means[index == k])) > _DOUBTFUL_G
    ]
    return index, [_unknown(f"a{k + 1}", mean, mount) for k, mean in enumerate(attitudes)], warnings


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


def labelled(recordings: Sequence[RecordingSeries], *, same: bool) -> list[RecordingSeries]:
    """Recordings whose attitudes have different labels, unless angles are known, or they are the `same` by their readings."""
    if len(recordings) < 2:
        return list(recordings)
    unknown = [(k, a) for k, one in enumerate(recordings) for a, of in enumerate(one.attitudes) if of.alpha_deg is None]
    labels = {(k, a): f"{recordings[k].name}:{recordings[k].attitudes[a].label}" for k, a in unknown}
    if same and unknown:
        index, _ = grouped(np.array([recordings[k].attitudes[a].mean for k, a in unknown]))
        labels = {key: f"a{number + 1}" for key, number in zip(labels, index.tolist(), strict=True)}
    return [
        one.with_attitudes(tuple(replace(of, label=labels.get((k, a), of.label)) for a, of in enumerate(one.attitudes)))
        for k, one in enumerate(recordings)
    ]


def _unknown(label: str, mean: NDArray[np.float64], mount: str) -> Attitude:
    return Attitude(label, np.asarray(mean, float), mount=mount)


def _angles(position: Place) -> dict[str, float | None]:
    return {"alpha_deg": position.alpha_deg, "beta_deg": position.beta_deg}


def _spread(means: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(means - means[0], axis=1).max()) if len(means) else 0.0


def _of_file(
    intervals: Sequence[Interval], means: NDArray[np.float64], attitude: Attitude
) -> tuple[NDArray[np.int64], list[Attitude], list[str]]:
    """The attitude of a file: that of its longest interval; other attitudes are not used."""
    index, firsts = grouped(means)
    lengths = np.bincount(index, [interval.stop - interval.start for interval in intervals])
    longest = int(np.argmax(lengths))
    others = int((index != longest).sum())
    warnings = [f"{others} intervals in other attitudes than that of the file are not used"] if others else []
    return np.where(index == longest, 0, -1), [replace(attitude, mean=firsts[longest])], warnings


def _in_plan(
    intervals: Sequence[Interval], means: NDArray[np.float64], plan: CapturePlan, mount: str
) -> tuple[NDArray[np.int64], list[Attitude], list[str]]:
    match = matched(means, plan)
    mount = mount or (plan.session.mount if plan.session.mount != "1" else "")
    attitudes = [
        Attitude(str(step.name), plan.expected(k), float(step.alpha_deg), float(step.beta_deg), mount)
        for k, step in enumerate(plan.steps)
    ]
    surplus = [f"{intervals[k].start_s:.0f} s" for k in match.surplus]
    warnings = [f"intervals at rest that are not positions of the plan are not used: {', '.join(surplus[:6])}"]
    lines = [line for line in match.words() if "measured again" not in line]
    return match.positions, attitudes, [*lines, *(warnings if surplus else [])]


def _stated(samples: Path, intervals: Sequence[Interval]) -> list[tuple[str, float, float]] | None:
    """Position, alpha and beta (deg) that columns of the samples state in the middle of each interval; None without them."""
    table = scan_parquet(samples, check=False)[0]
    there = table.collect_schema().names()
    angles = {"alpha_deg", "beta_deg"} <= set(there)
    if "position" not in there and not angles:
        return None
    rows = []
    for interval in intervals:
        row = table.slice((interval.start + interval.stop) // 2, 1).collect()
        alpha, beta = (float(row[name][0]) if angles else np.nan for name in ("alpha_deg", "beta_deg"))
        name = str(row["position"][0]) if "position" in there else f"{alpha:g}, {beta:g} deg"
        rows.append((name, alpha, beta))
    return rows


def _by_columns(
    stated: list[tuple[str, float, float]], means: NDArray[np.float64], mount: str
) -> tuple[NDArray[np.int64], list[Attitude], list[str]]:
    places = list(dict.fromkeys(stated))
    index = np.array([places.index(one) for one in stated])
    attitudes = [
        Attitude(
            name,
            means[int(np.argmax(index == k))],
            float(alpha) if np.isfinite(alpha) else None,
            float(beta) if np.isfinite(beta) else None,
            mount,
        )
        for k, (name, alpha, beta) in enumerate(places)
    ]
    return index, attitudes, []
