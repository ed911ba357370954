"""Reduction of a table of raw samples to position means: one row for each sample, with its position and angles.

Means, standard deviations and checks are those of a capture's folder (`capture.reduce`), without a journal.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import names_of
from tumblecal.capture.journal import sha256_of
from tumblecal.data.cells import labels_in
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.positions import PositionSet, attitudes_of, stretches
from tumblecal.data.raw import Raw, read_raw
from tumblecal.data.table import TIME_CLOCK
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, comments_of
from tumblecal.recordings.reduction.position_samples import FEWEST, labels_of, rate_of, stated_rate
from tumblecal.recordings.reduction.reduction import Reduction, reduction_of


_SETTINGS = ("alpha_deg", "beta_deg", "approach")
_LABELS = ("position", "run", "mount", TIME_CLOCK)
_SHOWN = 6


def reduce_table(path: Path, source: Path | None = None) -> Reduction:
    """Reduce a table of samples.

    A dwell is a stretch of consecutive rows with the same position, angles, run and mount; a position that occurs again is a
    second dwell.

    **Arguments:**

    - `path`: CSV or Parquet with columns `ax_g, ay_g, az_g` (or `_mg`, `_ms2`), `position` or angles, and `time_s` or the
      comment `# rate_hz: 100`. `temperature_degc` is averaged.
    - `source`: name of the original file in faults and results.

    **Raises:** `InputError` for a table without these columns, or with too few samples in a dwell.
    """
    raw = read_raw(path, source)
    hashed = raw.path if raw.path.is_file() else path
    path = raw.path
    if not len(raw.readings):
        raise InputError(f"{path}: no rows; write a row for each sample")
    hand_held = raw.comments.get(ATTITUDES) == UNKNOWN
    columns = _columns(path, raw, hand_held=hand_held)
    dwells = stretches(list(columns.values()))
    names = names_of([str(columns["position"][rows[0]]) for rows in dwells]) if "position" in columns else None
    names = names or tuple(f"p{number + 1}" for number in range(len(dwells)))
    enough_samples(path, names, dwells)
    times = raw.numbers("time_s") if "time_s" in raw.frame.columns else None
    rate = stated_rate(path, raw.comments) if times is None else rate_of(path, [times[rows] for rows in dwells])
    forces = [raw.readings[rows] for rows in dwells]
    middle = np.array([float(np.mean(rows if times is None else times[rows])) for rows in dwells])
    middle = middle / rate if times is None else middle
    data = _position_set(raw, columns, dwells, names, middle)
    return reduction_of(
        data,
        forces,
        rate,
        sha256_of(hashed)[:16],
        temperatures=None if (warmth := raw.temperature_degc()) is None else [warmth[rows] for rows in dwells],
    )


def enough_samples(path: Path, names: Sequence[str], dwells: Sequence[NDArray]) -> None:
    """Check that every dwell has enough samples for a mean.

    **Raises:** `InputError` with the dwells that have too few samples.
    """
    few = [f"{name} ({len(rows)})" for name, rows in zip(names, dwells, strict=True) if len(rows) < FEWEST]
    if few:
        more = f" and {len(few) - _SHOWN} more" if len(few) > _SHOWN else ""
        raise InputError(
            f"{path}: too few samples at position {', '.join(few[:_SHOWN])}{more}; {FEWEST} are needed at each. A table of "
            "means needs no reduction: give it to calibrate"
        )


def _columns(path: Path, raw: Raw, *, hand_held: bool) -> dict[str, NDArray]:
    """The columns that separate the dwells, one cell for each sample."""
    there = raw.frame.columns
    cells = {name: raw.frame[name].to_list() for name in _LABELS if name in there}
    # A column of runs or mountings that is empty in all rows is ignored.
    columns: dict[str, NDArray] = {
        name: labels_of(path, column, name)
        for name, column in cells.items()
        if name == "position" or any(labels_in(column))
    }
    columns |= {name: raw.numbers(name) for name in _SETTINGS if name in there}
    angles = [name for name in ("alpha_deg", "beta_deg") if name not in columns]
    if angles and not hand_held:
        raise InputError(
            f"{path}: column {' and '.join(angles)} is missing; write the angles in the row of each sample (or the comment "
            f"`# {ATTITUDES}: {UNKNOWN}` for a hand-held set), or have them found: --plan PLAN.toml, or --static"
        )
    if "position" not in columns and hand_held:
        raise InputError(
            f"{path}: column position is missing; write the name of the position in the row of each sample"
        )
    return columns


def _position_set(
    raw: Raw,
    columns: dict[str, NDArray],
    dwells: list[NDArray[np.int64]],
    names: tuple[str, ...],
    middle: NDArray[np.float64],
) -> PositionSet:
    first = np.array([rows[0] for rows in dwells])
    readings = np.array([raw.readings[rows].mean(0) for rows in dwells])
    warmth = raw.temperature_degc()
    gravity = raw.gravity or (STANDARD if raw.in_ms2 else None)
    comments = {key: value for key, value in raw.comments.items() if key != "rate_hz"}

    def numbers(name: str) -> NDArray[np.float64] | None:
        return columns[name][first] if name in columns else None

    def labels(name: str) -> tuple[str, ...] | None:
        return tuple(map(str, columns[name][first])) if name in columns else None

    alpha, beta = numbers("alpha_deg"), numbers("beta_deg")
    if alpha is None or beta is None:
        alpha, beta = attitudes_of(readings)
    return PositionSet(
        names=names,
        alpha_deg=alpha,
        beta_deg=beta,
        readings=readings,
        run=labels("run"),
        mount=labels("mount"),
        clock=labels(TIME_CLOCK) if len(set(labels(TIME_CLOCK) or ())) > 1 else None,
        time_s=middle,
        temperature_degc=None if warmth is None else np.array([float(warmth[rows].mean()) for rows in dwells]),
        approach=numbers("approach"),
        n=np.array([len(rows) for rows in dwells], float),
        comments=comments | (comments_of(gravity) if gravity else {}) | {"reduced_from": raw.path.name},
        source=str(raw.path),
    )
