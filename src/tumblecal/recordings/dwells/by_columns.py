"""Dwells by the columns of a table of samples: a stretch of rows with one position, angles, run and mounting is a dwell."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.data.cells import labels_in, number_in
from tumblecal.data.parquet import read_parquet
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.positions import stretches
from tumblecal.data.raw import Raw, header_of
from tumblecal.data.table import TIME_CLOCK
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, comments_of
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, dwell_samples, require_samples, stated_comments
from tumblecal.recordings.dwells.place import Place
from tumblecal.recordings.options import KnownContext


_ANGLES = ("alpha_deg", "beta_deg")
_LABELS = ("position", "run", "mount", TIME_CLOCK)


def dwells_by_columns(raw: Raw, recording: str, *, means_given: bool = False) -> DwellSamples:
    """The dwells of a table of samples; a position that occurs again is a second dwell.

    **Arguments:**

    - `raw`: columns `position` or angles, and `time_s` or the comment `# rate_hz: 100`. `recording`: its identifier.
    - `means_given`: the means of the positions are in a different file: all rows with the name of a position, wherever they
      are, are its samples, and angles are not needed.

    **Raises:** `InputError` for a table without these columns, or with too few samples in a dwell.
    """
    source, timed = str(raw.path), "time_s" in raw.frame.columns
    cells = _cells(raw, means_given=means_given)
    if means_given:
        label = cells["position"]
        dwells = [np.flatnonzero(label == name) for name in dict.fromkeys(label.tolist())]
    else:
        dwells = stretches(list(cells.values()))
    clocks = cells.pop(TIME_CLOCK, np.zeros(0))
    places = []
    for rows in dwells:
        stated: dict[str, Any] = {name: values[rows[0]].item() for name, values in cells.items()}
        places.append(Place(stated.pop("position", f"p{len(places) + 1}"), **stated))
    # A table of means may have neither times nor rate: the number of samples is checked first.
    require_samples(source, places, dwells)
    rate_hz, middle_s = _times(raw, dwells)
    gravity, warmth = raw.gravity or (STANDARD if raw.in_ms2 else None), raw.temperature_degc()
    comments = {key: value for key, value in raw.comments.items() if key != "rate_hz"}
    comments |= (comments_of(gravity) if gravity else {}) | {"reduced_from": raw.path.name}
    return dwell_samples(
        source,
        places,
        [raw.readings[rows] for rows in dwells],
        rate_hz,
        comments | ({ATTITUDES: UNKNOWN} if means_given else {}),
        temperatures=None if warmth is None else [warmth[rows] for rows in dwells],
        columns={
            "time_s": middle_s if timed or not means_given else None,
            "clock": tuple(clocks[rows[0]].item() for rows in dwells) if len(np.unique(clocks)) > 1 else None,
        },
        recording=recording,
        entries={"source": source},
    )


def table_with_plan(samples: Path, source: Path, known: tuple[KnownContext, CapturePlan | None]) -> Raw:
    """A table of samples with the angles of a plan by name, and with run and mounting of the options.

    **Arguments:**

    - `samples`: as of `read_recording`. `source`: for faults.

    **Raises:** `InputError` if no position of the table is in the plan.
    """
    context, plan = known
    comments = stated_comments(samples, source, plan, hand_held=context.static and plan is None)
    frame, stored = read_parquet(samples, check=False)
    if plan is not None:
        steps = [(str(step.name), float(step.alpha_deg), float(step.beta_deg)) for step in plan.steps]
        angles = pl.DataFrame(steps, schema=["position", *_ANGLES], orient="row")
        frame = frame.drop(_ANGLES, strict=False).join(angles, on="position", maintain_order="left")
        if not len(frame):
            names = ", ".join(name for name, *_ in steps[:8])
            raise InputError(f"{source}: none of its position names is in {context.plan}: {names} ...")
    labels = [pl.lit(label).alias(name) for name in ("run", "mount") if (label := getattr(context, name))]
    rate = {key: value for key, value in stored.items() if key == "rate_hz"}
    return header_of(source, frame.head(0), comments | rate).with_rows(frame.with_columns(labels))


def _cells(raw: Raw, *, means_given: bool) -> dict[str, NDArray]:
    """The columns that separate the dwells, one cell for each sample: only that of the position, if their means are given.

    **Raises:** `InputError` for missing columns, and empty cells.
    """
    source, there, columns = str(raw.path), raw.frame.columns, dict[str, NDArray]()
    hand_held = means_given or raw.comments.get(ATTITUDES) == UNKNOWN
    there = [name for name in there if name == "position"] if means_given else there
    if not len(raw.readings):
        raise InputError(f"{source}: no rows; write a row for each sample")
    if lacking := [name for name in (("position",) if hand_held else _ANGLES) if name not in there]:
        raise InputError(
            f"{source}: column {' and '.join(lacking)} is missing; write the {'name' if hand_held else 'angles'} in the row of "
            f"each sample (without angles: the comment `# {ATTITUDES}: {UNKNOWN}`, --plan PLAN.toml, or --static)"
        )
    for name in _LABELS:
        labels = labels_in(raw.frame[name].to_list()) if name in there else []
        # A column of runs or mountings that is empty in all rows is ignored.
        if not any(labels) and (name != "position" or not labels):
            continue
        if empty := labels.count(""):
            raise InputError(
                f"{source}: column {name}: {empty} empty cells; write the {name} in the row of each sample"
            )
        columns[name] = np.array(labels)
    return columns | {name: raw.numbers(name) for name in (*_ANGLES, "approach") if name in there}


def _times(raw: Raw, dwells: list[Integers]) -> tuple[float, Floats]:
    """Sample rate, Hz, and middle of each dwell, s: from the column of times, otherwise from the comment `# rate_hz: 100`.

    **Raises:** `InputError` for times that do not increase, or a missing or invalid rate.
    """
    if "time_s" in raw.frame.columns:
        times = raw.numbers("time_s")
        steps = np.concatenate([np.diff(times[rows]) for rows in dwells])
        if np.min(steps, initial=np.inf) <= 0:
            raise InputError(f"{raw.path}: column time_s must increase from sample to sample within a position")
        rate_hz = 1.0 / float(np.median(steps)) if len(steps) else np.nan
        return rate_hz, np.array([float(np.mean(times[rows])) for rows in dwells])
    text = raw.comments.get("rate_hz", "")
    rate, _ = number_in(text)
    if not (np.isfinite(rate) and rate > 0):
        raise InputError(
            f"{raw.path}: the sample rate is not known; add a column time_s or a comment `# rate_hz: 100`"
            + (f" instead of {text!r}" if text else "")
        )
    return rate, np.array([float(np.mean(rows)) for rows in dwells]) / rate
