"""Dwells by the columns of a table of samples: a stretch of rows with one position, angles, run and mounting is a dwell."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan, names_of
from tumblecal.data.cells import labels_in, number_in
from tumblecal.data.parquet import read_parquet
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.positions import PositionSet, attitudes_of, stretches
from tumblecal.data.raw import Raw, header_of
from tumblecal.data.table import TIME_CLOCK
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, comments_of
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, require_samples, stated_comments
from tumblecal.recordings.options import KnownContext


_SETTINGS = ("alpha_deg", "beta_deg", "approach")
_LABELS = ("position", "run", "mount", TIME_CLOCK)


def dwells_by_columns(raw: Raw, recording: str) -> DwellSamples:
    """The dwells of a table of samples; a position that occurs again is a second dwell.

    **Arguments:**

    - `raw`: columns `position` or angles, and `time_s` or the comment `# rate_hz: 100`. `recording`: its identifier.

    **Raises:** `InputError` for a table without these columns, or with too few samples in a dwell.
    """
    source = str(raw.path)
    if not len(raw.readings):
        raise InputError(f"{source}: no rows; write a row for each sample")
    cells = _cells(raw)
    dwells = stretches(list(cells.values()))
    first = np.array([rows[0] for rows in dwells])
    placed = {name: values[first] for name, values in cells.items()}
    named = [str(name) for name in placed.get("position", ())]
    names = names_of(named) or tuple(f"p{number + 1}" for number in range(len(dwells)))
    require_samples(source, names, dwells)
    rate, middle_s = sample_times(raw, dwells)
    readings = np.array([raw.readings[rows].mean(0) for rows in dwells])
    labels = {name: tuple(map(str, placed[name])) for name in _LABELS[1:] if name in placed}
    clocks = labels.get(TIME_CLOCK, ())
    alpha, beta = (placed.get(name) for name in _SETTINGS[:2])
    if alpha is None or beta is None:
        alpha, beta = attitudes_of(readings)
    warmth = raw.temperature_degc()
    temperatures = None if warmth is None else [warmth[rows] for rows in dwells]
    gravity = raw.gravity or (STANDARD if raw.in_ms2 else None)
    comments = {key: value for key, value in raw.comments.items() if key != "rate_hz"}
    positions = PositionSet(
        names,
        alpha,
        beta,
        readings,
        run=labels.get("run"),
        mount=labels.get("mount"),
        clock=clocks if len(set(clocks)) > 1 else None,
        time_s=middle_s,
        temperature_degc=None if temperatures is None else np.array([float(part.mean()) for part in temperatures]),
        approach=placed.get("approach"),
        n=np.array([len(rows) for rows in dwells], float),
        comments=comments | (comments_of(gravity) if gravity else {}) | {"reduced_from": raw.path.name},
        source=source,
    )
    force = [raw.readings[rows] for rows in dwells]
    return DwellSamples(positions, force, rate, recording, temperatures, entries={"source": source})


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
        angles = pl.DataFrame(steps, schema=["position", "alpha_deg", "beta_deg"], orient="row")
        frame = frame.drop("alpha_deg", "beta_deg", strict=False)
        frame = frame.join(angles, on="position", how="inner", maintain_order="left")
        if not len(frame):
            names = ", ".join(name for name, *_ in steps[:8])
            raise InputError(f"{source}: none of its position names is in {context.plan}: {names} ...")
    labels = {name: label for name, label in (("run", context.run), ("mount", context.mount)) if label}
    frame = frame.with_columns(pl.lit(label).alias(name) for name, label in labels.items())
    rate = {key: value for key, value in stored.items() if key == "rate_hz"}
    return header_of(source, frame.head(0), comments | rate).with_rows(frame)


def labels_of_samples(source: str, cells: list[Any], column: str) -> NDArray[np.str_]:
    """Labels of the samples, as of `labels_in`.

    **Raises:** `InputError` for empty cells.
    """
    if not cells:
        raise InputError(f"{source}: no rows; write a row for each sample")
    names = labels_in(cells)
    if empty := sum(not name for name in names):
        raise InputError(
            f"{source}: column {column}: {empty} empty cells; write the {column} in the row of each sample"
        )
    return np.array(names)


def sample_times(raw: Raw, dwells: list[NDArray[np.int64]]) -> tuple[float, NDArray[np.float64]]:
    """Sample rate, Hz, and middle of each dwell, s: from the column of times, otherwise from the comment `# rate_hz: 100`.

    **Raises:** `InputError` for times that do not increase, or a missing or invalid rate.
    """
    source = str(raw.path)
    if "time_s" in raw.frame.columns:
        times = raw.numbers("time_s")
        steps = np.concatenate([np.diff(times[rows]) for rows in dwells])
        step = float(np.median(steps))
        if not step > 0 or np.min(steps) <= 0:
            raise InputError(f"{source}: column time_s must increase from sample to sample within a position")
        return 1.0 / step, np.array([float(np.mean(times[rows])) for rows in dwells])
    text = raw.comments.get("rate_hz")
    if text is None:
        raise InputError(f"{source}: the sample rate is not known; add a column time_s or a comment `# rate_hz: 100`")
    rate, _ = number_in(text)
    if not (np.isfinite(rate) and rate > 0):
        raise InputError(
            f"{source}: comment rate_hz: {text!r} is not a sample rate in Hz; write for example `# rate_hz: 100`"
        )
    return rate, np.array([float(np.mean(rows)) for rows in dwells]) / rate


def _cells(raw: Raw) -> dict[str, NDArray]:
    """The columns that separate the dwells, one cell for each sample."""
    source, hand_held = str(raw.path), raw.comments.get(ATTITUDES) == UNKNOWN
    texts = {name: raw.frame[name].to_list() for name in _LABELS if name in raw.frame.columns}
    # A column of runs or mountings that is empty in all rows is ignored.
    columns: dict[str, NDArray] = {
        name: labels_of_samples(source, column, name)
        for name, column in texts.items()
        if name == "position" or any(labels_in(column))
    }
    columns |= {name: raw.numbers(name) for name in _SETTINGS if name in raw.frame.columns}
    lacking = [name for name in _SETTINGS[:2] if name not in columns]
    if lacking and not hand_held:
        raise InputError(
            f"{source}: column {' and '.join(lacking)} is missing; write the angles in the row of each sample (or the comment "
            f"`# {ATTITUDES}: {UNKNOWN}` for a hand-held set), or have them found: --plan PLAN.toml, or --static"
        )
    if "position" not in columns and hand_held:
        raise InputError(
            f"{source}: column position is missing; write the name of the position in the row of each sample"
        )
    return columns
