"""A recording of any format as blocks at rest over temperature: time, accelerations, temperature, and the attitude of each."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from tumblecal.capture.decoding.samples import Floats, Integers
from tumblecal.data.parquet import scan_parquet
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import shortened
from tumblecal.recordings.clock import LONGEST_STEP_S
from tumblecal.recordings.dwells.join import joined
from tumblecal.recordings.dwells.places import ANGLES, FilePlaces, Known, Place, label_of_rows
from tumblecal.recordings.dwells.rest import AtRest, at_rest
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.still.intervals import ONE_ATTITUDE_G, blocks_of_interval, grouped
from tumblecal.recordings.thermal.temperature import (
    RATE,
    TEMPERATURE,
    block_temperatures,
    resolution_of,
    smoothed,
    stuck_words,
)
from tumblecal.recordings.thermal.thermal_table import READINGS


# Sums of squared deviations from the accelerations of a block, g^2.
SQUARES = ["ax_squares", "ay_squares", "az_squares"]
# Names of columns in units that are not converted.
_NOT_DEGC = re.compile(r"(?:^|[\W_]|(?<=[a-z]))(?:deg_?[FfKk]|F|K|(?<![A-Za-z])[fk]|[Ff]ahrenheit|[Kk]elvin)\W*$")
# A temperature that is missing for at most this time is interpolated; shorter times at rest without one are not reported, s.
_LONGEST_MISSING_S, _LONGEST_LOST_S = 60.0, 5.0
# Intervals of one attitude that differ by more than this (2 degrees) after a movement may be different positions.
_DOUBTFUL_G = ONE_ATTITUDE_G / 5
# Blocks on each side of a step whose means give its size: before it changes with temperature.
_STEP_BLOCKS = 16


@dataclass(frozen=True)
class ThermalSeries:
    """The blocks at rest of one recording, or of its part between two restarts of the clock.

    - `clock`: label of the recording, or of its part. `source`: its file. `comments`: gravity, serial number and others.
    - `block_s`: length of a block, s; `size`: its samples. `quantum` (3): smallest step of the readings, g; 0 if unknown.
    - `visits`: a row for each stay: `position`, `alpha_deg`, `beta_deg`, `mount`; null if unknown.
    - `blocks`: a row for each block at rest: `time_s` (middle, s), `ax_g` .. (mean, g), `SQUARES`, `visit` (number of the stay
      in one attitude), `TEMPERATURE` and `RATE` (smoothed).
    - `course`: smoothed temperature of the whole recording, including movements, on cells of `cell_s`, s (`smoothed`).
      `resolution`, `noise`: of the thermometer, degC.
    """

    clock: str
    source: str
    comments: dict[str, str]
    block_s: float
    size: int
    quantum: Float[np.ndarray, "3"]
    visits: pl.DataFrame
    blocks: pl.DataFrame
    course: pl.DataFrame
    cell_s: float
    noise: float
    resolution: float

    @classmethod
    def of(cls, recorded: pl.DataFrame, **known: Any) -> "ThermalSeries":
        """A series from all blocks with a temperature, those of movements with `visit` -1.

        **Arguments:** `known`: the fields that do not follow from these.
        """
        course, cell_s, noise = smoothed(
            recorded["time_s"].to_numpy(), recorded[TEMPERATURE].to_numpy(), known["resolution"]
        )
        blocks = recorded.filter(pl.col("visit") >= 0)
        at = {name: np.interp(blocks["time_s"], course["time_s"], course[name]) for name in (TEMPERATURE, RATE)}
        return cls(blocks=blocks.with_columns(**at), course=course, cell_s=cell_s, noise=noise, **known)


def read_series(
    path: Path,
    name: str,
    prefix: str,
    known: Known,
    options: RecordingOptions,
    criterion: Criterion,
    of_file: Place | None,
) -> tuple[Recording, list[ThermalSeries], list[str]]:
    """Read a recording: its contents; its blocks, in parts between restarts of the clock and steps; and warnings.

    **Arguments:**

    - `name`: for labels; `prefix`: of labels of unknown attitudes. `known`: context, and its plan. `of_file`: the position of
      the file, if a table states it.
    - others: as for `thermal_reading`.

    **Raises:** `InputError` as `thermal_reading`, with the guesses about the columns.
    """
    with scratch_folder(path) as folder:
        table = joined([path], folder, options, known[0].by)
        (recording,) = table.recordings
        with guessed(recording.layout.notes):
            column, rate_hz = recording.layout.columns.get("temperature"), recording.slow_hz or recording.rate_hz
            if column is None or _NOT_DEGC.search(column.name):
                raise InputError(
                    f"{path}: no temperature in degC among the columns {', '.join(recording.table.columns)[:200]}, by their "
                    "names and values; write one for each sample, not in kelvin or Fahrenheit, and name it: --columns "
                    "temperature=NAME"
                )
            if rate_hz is None:
                raise InputError(
                    f"{path}: the sample rate is not known; give --rate 100 (Hz), or --columns time=.... If each row is the "
                    "mean of a position, add --means --noise-sd 0.1mg, or the columns ax_sd_g, ay_sd_g, az_sd_g"
                )
            of_files = None if of_file is None else FilePlaces((path,), (of_file,))
            rest = at_rest(table, of_files, known, criterion, rate_hz)
            lines = [line for line in rest.lines if not line.startswith("measured again")]
            if reasons := [f"{one.start_s:.0f} s: {one.reason}" for one in rest.stillness.intervals if one.reason]:
                lines.append(f"intervals at rest that are not used: {shortened(reasons, 3)}")
            places = [place for place in rest.places if place]
            if not places:
                places, doubts = _places(table.samples, rest)
                lines += doubts
            blocks = rest.stillness.blocks
            degc, first = block_temperatures(path, table.samples, blocks)
            steps = _steps_of(blocks, first, rest.to_g)
            mount = label_of_rows(known, "mount")
            visit, visits = _stays(rest, places, [*steps], prefix, None if mount == "1" else mount)
            middle, block_s = blocks.start_s + (blocks.size - 1) / 2 / blocks.rate_hz, blocks.size / blocks.rate_hz
            cut = np.diff(middle, prepend=middle[:1]) < 0
            cut[[*steps]] = True
            values = [middle, degc, first, rest.to_g * blocks.mean[:, :3], rest.to_g**2 * blocks.squares[:, :3]]
            frame = pl.DataFrame(np.column_stack(values), ["time_s", TEMPERATURE, "first", *READINGS, *SQUARES])
            frame = frame.with_columns(pl.col(TEMPERATURE).fill_nan(None), visit=visit, part=np.cumsum(cut))
            # A missing temperature is interpolated between known ones that are near each other.
            known_s = pl.when(pl.col(TEMPERATURE).is_not_null()).then("time_s")
            near = known_s.backward_fill() - known_s.forward_fill() <= _LONGEST_MISSING_S
            filled = pl.when(near).then(pl.col(TEMPERATURE).interpolate_by("time_s"))
            parts = list[ThermalSeries]()
            for part in frame.partition_by("part", maintain_order=True):
                recorded = part.with_columns(filled).drop_nulls(TEMPERATURE)
                if (recorded["visit"] >= 0).any():
                    one = ThermalSeries.of(
                        recorded,
                        clock=f"{name} (clock {len(parts) + 1})" if parts else name,
                        source=str(recording.path),
                        comments=rest.comments | recording.clock_comments,
                        block_s=block_s,
                        size=blocks.size,
                        quantum=rest.to_g * blocks.quantum[:3],
                        visits=visits,
                        resolution=resolution_of(part["first"].to_numpy()),
                    )
                    parts.append(one)
            if not parts:
                raise InputError(
                    f"{path}: no interval at rest has a temperature, and is a position of the plan, if there is one; check "
                    "--columns temperature=..., and mount_rotation_deg of the plan"
                )
    lines += steps.values()
    lost_s = block_s * (np.count_nonzero(visit >= 0) - sum(len(part.blocks) for part in parts))
    if lost_s > _LONGEST_LOST_S:
        lines.append(f"{lost_s:.0f} s at rest have no temperature and are not used")
    return recording, parts, [*lines, *stuck_words(first, middle)]


def _places(samples: Path, rest: AtRest) -> tuple[list[Place], list[str]]:
    """The positions of the used intervals: those that columns of the samples state in their middle, otherwise one for each
    direction of gravity; and warnings."""
    table, intervals = scan_parquet(samples, check=False)[0], rest.stillness.used
    there = [name for name in ("position", *ANGLES) if name in table.collect_schema()]
    if "position" in there or {*ANGLES} <= {*there}:
        places = list[Place]()
        for interval in intervals:
            row = table.slice((interval.start + interval.stop) // 2, 1).select(there).collect().row(0, named=True)
            at = (float(row["alpha_deg"]), float(row["beta_deg"])) if {*ANGLES} <= {*there} else (None, None)
            places.append(Place(str(row["position"]) if "position" in there else "{:g}, {:g} deg".format(*at), *at))
        return places, []
    means = rest.to_g * np.array([interval.mean for interval in intervals])
    index, firsts = grouped(means)
    spread = np.linalg.norm(means - np.array(firsts)[index], axis=1)
    lines = [
        f"attitude a{k + 1}: its intervals differ by {np.degrees(spread[index == k].max()):.1f} deg; if these are different "
        "positions, give their angles: --plan PLAN.toml"
        for k in np.unique(index[spread > _DOUBTFUL_G])
    ]
    return [Place(f"a{k + 1}") for k in index], lines


def _steps_of(blocks: SignalBlocks, degc: Floats, to_g: float) -> dict[int, str]:
    """The first block after each step of a recording, and a line about the step: a join of `still/blocks.py` that changes the
    readings by less than a change of attitude, as of joined files or a moved unit.

    **Arguments:** `degc`: a reading of the thermometer in each block; NaN where unknown. `to_g`: unit of the blocks, g.
    """
    edges = np.unique(np.append(np.flatnonzero(blocks.broken), [0, len(blocks)])).tolist()
    mean = to_g * blocks.mean[:, :3]
    found = dict[int, str]()
    for begin, k, end in zip(edges, edges[1:], edges[2:], strict=False):
        pause = blocks.start_s[k] - blocks.start_s[k - 1]
        start, stop = max(k - _STEP_BLOCKS, begin), min(k + _STEP_BLOCKS, end)
        size = mean[k:stop].mean(0) - mean[start:k].mean(0)
        in_time = 0 <= pause <= LONGEST_STEP_S + blocks.size / blocks.rate_hz
        if not in_time or np.linalg.norm(size) >= ONE_ATTITUDE_G:
            continue
        variance = blocks.squares[start:stop, :3].mean(0) / (blocks.size - 1) / blocks.size
        u = to_g * np.sqrt(variance * (1 / (k - start) + 1 / (stop - k)))
        found[k] = (
            f"step at {blocks.start_s[k]:.2f} s, {degc[k]:.2f} degC: the readings jump by "
            f"{', '.join(f'{1e3 * one:.2f}' for one in size)} mg (standard uncertainty {1e3 * u.max():.2g} mg); the unit was "
            "moved, or two recordings are joined. The parts before and after it have separate attitudes and clocks"
        )
    return found


def _stays(
    rest: AtRest, places: list[Place], steps: list[int], prefix: str, mount: str | None
) -> tuple[Integers, pl.DataFrame]:
    """The number of the stay of each block, -1 in none, and the attitude of each stay; successive intervals in one attitude are
    one stay. After each step there are separate attitudes: its jump is then no change with temperature.

    **Arguments:** `places`: of each used interval. `steps`: blocks after a step. `prefix`: of labels of unknown attitudes.
    `mount`: the label of stays whose place has none.
    """
    blocks, stays = rest.stillness.blocks, list[Place]()
    visit, times = np.full(len(blocks), -1), blocks.start_s[steps]
    for interval, place in zip(rest.stillness.used, places, strict=True):
        after = "".join(f" after {at:.0f} s" for at in times[blocks.row[steps] <= interval.start][-1:])
        place = replace(place, position=f"{'' if place.known else prefix}{place.position}{after}")
        stays += [place] if place not in stays[-1:] else []
        visit[blocks_of_interval(interval, blocks)] = len(stays) - 1
    rows = [(one.position, one.mount or mount, one.alpha_deg, one.beta_deg) for one in stays]
    columns = {"position": pl.String, "mount": pl.String, "alpha_deg": pl.Float64, "beta_deg": pl.Float64}
    return visit, pl.DataFrame(rows, columns, orient="row")
