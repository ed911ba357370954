"""Dwells by the columns of a table: stretches of rows with one position, angles, run and mounting; tables of means."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.data.cells import labels_in, number_in
from tumblecal.data.parquet import read_parquet
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.positions import stretches
from tumblecal.data.raw import Raw, header_of, read_raw
from tumblecal.data.table import TIME_CLOCK
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, comments_of, stated_gravity
from tumblecal.recordings.dwells.dwell_checks import require_axes_answer
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, dwell_samples, require_samples, stated_comments
from tumblecal.recordings.dwells.places import ANGLES, Known, Place, places_of, position_set
from tumblecal.recordings.dwells.plan_match import matched
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording


_LABELS = ("position", "run", "mount", TIME_CLOCK)


def dwells_by_columns(raw: Raw, recording: str, *, means_given: bool = False) -> DwellSamples:
    """The dwells of a table of samples; a position that occurs again is a second dwell.

    **Arguments:**

    - `raw`: columns `position` or angles, and `time_s` or the comment `# rate_hz: 100`. `recording`: its identifier.
    - `means_given`: the means of the positions are in a different file: all rows with the name of a position, wherever they
      are, are its samples, and angles are not needed.

    **Raises:** `InputError` for a table without these columns, or with too few samples in a dwell.
    """
    source, timed, cells = str(raw.path), "time_s" in raw.frame.columns, _cells(raw, means_given=means_given)
    if means_given:
        label = cells["position"]
        dwells = [np.flatnonzero(label == name) for name in dict.fromkeys(label.tolist())]
    else:
        dwells = stretches(list(cells.values()))
    clocks = cells.pop(TIME_CLOCK, np.zeros(0))
    stated: list[dict[str, Any]] = [
        {"position": f"p{k}"} | {name: cells[name][rows[0]].item() for name in cells}
        for k, rows in enumerate(dwells, 1)
    ]
    places = [Place(**values) for values in stated]
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


def table_with_plan(samples: Path, source: Path, known: Known) -> Raw:
    """A table of samples with the angles of a plan by name, and with run and mounting of the options.

    **Arguments:**

    - `samples`: as of `read_recording`. `source`: for faults.

    **Raises:** `InputError` if no position of the table is in the plan.
    """
    context, plan = known
    comments = stated_comments(samples, source, plan, hand_held=context.static and plan is None)
    frame, stored = read_parquet(samples, check=False)
    if steps := places_of(plan):
        angles = pl.DataFrame(
            [(step.position, step.alpha_deg, step.beta_deg) for step in steps], ["position", *ANGLES], orient="row"
        )
        frame = frame.drop(ANGLES, strict=False).join(angles, on="position", maintain_order="left")
        if not len(frame):
            names = ", ".join(step.position for step in steps[:8])
            raise InputError(f"{source}: none of its position names is in {context.plan}: {names} ...")
    labels = [pl.lit(label).alias(name) for name in ("run", "mount") if (label := getattr(context, name))]
    rate = {key: value for key, value in stored.items() if key == "rate_hz"}
    return header_of(source, frame.head(0), comments | rate).with_rows(frame.with_columns(labels))


def means_of(path: Path, known: Known, options: RecordingOptions) -> DwellSamples:
    """The positions of a table with one mean in each row: spreadsheets, .mat files and text of any layout.

    **Arguments:**

    - `known`: context, and its plan, whose positions are found by name, otherwise by the direction of gravity.

    **Raises:** `InputError` for a table without accelerations, or with positions that are not in the plan.
    """
    context, plan = known
    with scratch_folder(path) as folder:
        samples = folder / "means.parquet"
        recording = read_recording(path, samples, options, by=context.by, in_g=True, means=True)
        raw = read_raw(samples, path)
        with_angles = plan is None and {*ANGLES} <= {*raw.frame.columns}
        comments = stated_comments(samples, path, plan, hand_held=plan is None and not with_angles)
    raw = raw.in_g_of(stated_gravity(comments, str(path))) if raw.in_ms2 else raw
    require_axes_answer(str(path), raw.readings[:, None])
    there, names = {*raw.frame.columns}, [f"p{k}" for k in range(1, len(raw.readings) + 1)]
    if "position" in there:
        names = raw.frame["position"].cast(str).to_list()
    angles = [raw.numbers(name).tolist() for name in ANGLES if with_angles]
    places = [Place(*row) for row in zip(names, *angles, strict=True)]
    if plan is not None:
        steps = places_of(plan)
        by_name = {step.position: step for step in steps}
        found = matched(raw.readings, plan).positions.tolist()
        placed = [by_name.get(name) for name in names] if "position" in there else [
            None if k < 0 else steps[k] for k in found
        ]  # fmt: skip
        if None in placed:
            raise InputError(
                f"{path}: row {placed.index(None) + 1}: not a position of the plan ({placed.count(None)} such rows); remove "
                "them"
            )
        places = [place for place in placed if place]
    time_s = raw.numbers("time_s") if "time_s" in there else None
    columns = {"temperature_degc": raw.temperature_degc(), "time_s": time_s}
    positions = position_set(str(path), raw.readings, places, comments, known, **columns)
    return DwellSamples(positions, read=(recording,), warnings=((str(path), recording.damage.lines),))


def _cells(raw: Raw, *, means_given: bool) -> dict[str, NDArray]:
    """The columns that separate the dwells, one cell for each sample: only that of the position, if their means are given.

    **Raises:** `InputError` for missing columns, and empty cells.
    """
    source, there, columns = str(raw.path), raw.frame.columns, dict[str, NDArray]()
    named = means_given or raw.comments.get(ATTITUDES) == UNKNOWN
    if not len(raw.readings):
        raise InputError(f"{source}: no rows; write a row for each sample")
    if lacking := [name for name in (("position",) if named else ANGLES) if name not in there]:
        raise InputError(
            f"{source}: column {' and '.join(lacking)} is missing; write the {'name' if named else 'angles'} in the row of "
            f"each sample (without angles: the comment `# {ATTITUDES}: {UNKNOWN}`, --plan PLAN.toml, or --static)"
        )
    for name in ("position",) if means_given else _LABELS:
        labels = labels_in(raw.frame[name].to_list()) if name in there else []
        # A column of runs or mountings that is empty in all rows is ignored.
        if any(labels) or (labels and name == "position"):
            columns[name] = np.array(labels)
            if empty := labels.count(""):
                raise InputError(
                    f"{source}: column {name}: {empty} empty cells; write the {name} in the row of each sample"
                )
    numbers = () if means_given else (*ANGLES, "approach")
    return columns | {name: raw.numbers(name) for name in numbers if name in there}


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


def read_position_samples(path: Path) -> DwellSamples:
    """The samples of positions whose means are given in a file, without the change within dwells that all share.

    **Arguments:**

    - `path`: folder of `tumblecal capture`, or a CSV or Parquet table with columns `position`, `ax_g, ay_g, az_g` (or
      `_mg`, `_ms2`) and `time_s`; without `time_s` a comment `# rate_hz: 100` gives the sample rate. With `_ms2` a comment
      `# gravity_ms2: 9.8123` gives local gravity.

    **Raises:** `InputError` if there are no such samples, or too few.
    """
    from dataclasses import replace

    from tumblecal.noise.within_dwells import without_common_change

    if path.is_dir():
        from tumblecal.recordings.dwells.captured import captured_dwells

        dwells = captured_dwells(path)
    else:
        dwells = dwells_by_columns(read_raw(path), "", means_given=True)
    quiet, _ = without_common_change(dwells.force, dwells.rate_hz, dwells.temperatures)
    return replace(dwells, force=quiet)
