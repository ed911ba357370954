"""A recording of any format as blocks over temperature: its samples, intervals at rest, temperatures and attitudes."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import stated_gravity, unit_in_g
from tumblecal.ground.numbers_shown import shortened
from tumblecal.recordings.clock import LONGEST_STEP_S
from tumblecal.recordings.dwells.dwell_samples import stated_comments
from tumblecal.recordings.dwells.place import Place, label_of_rows
from tumblecal.recordings.dwells.rest import check_still, stillness_of
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.reading import read_recording
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.still.blocks import SignalBlocks
from tumblecal.recordings.still.intervals import Interval, blocks_of_interval
from tumblecal.recordings.still.stillness import Stillness
from tumblecal.recordings.thermal.attitudes import attitudes_of_intervals, grouped
from tumblecal.recordings.thermal.block_temperature import block_temperatures, stuck_words
from tumblecal.recordings.thermal.series import SQUARES, TEMPERATURE, ThermalSeries
from tumblecal.recordings.thermal.smoothed_temperature import resolution_of
from tumblecal.recordings.thermal.steps import steps_of
from tumblecal.recordings.thermal.thermal_table import READINGS


# Names of columns in units that are not converted.
_NOT_DEGC = re.compile(r"(?:^|[\W_]|(?<=[a-z]))(?:deg_?[FfKk]|F|K|(?<![A-Za-z])[fk]|[Ff]ahrenheit|[Kk]elvin)\W*$")
# Median of chi-squared with one degree of freedom.
_MEDIAN_CHI2 = 0.455
# Rows whose noise is larger are means of different positions, whose standard deviation only the user knows.
_MOVING_G, _USUAL_G = 0.05, 1e-4
# A temperature that is missing for at most this time is interpolated; shorter times at rest without one are not reported, s.
_LONGEST_MISSING_S, _LONGEST_LOST_S = 60.0, 5.0


def read_series(
    path: Path,
    name: str,
    prefix: str,
    known: tuple[KnownContext, CapturePlan | None],
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
    context, plan = known
    with scratch_folder(path) as folder:
        samples = folder / "samples.parquet"
        recording = read_recording(path, samples, options, by=context.by, in_g=True)
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
            stillness = stillness_of(samples, rate_hz, criterion, plan)
            comments = stated_comments(samples, path, plan, hand_held=plan is None and of_file is None)
            to_g = unit_in_g(stillness.blocks.unit, stated_gravity(comments, str(path)))
            lines = list[str]()
            if rate_hz * LONGEST_STEP_S < 1:
                stillness = _taken_as_still(path, stillness, to_g)
                lines.append(f"samples at {rate_hz:.3g} Hz cannot show movements; taken as still, in one attitude")
            else:
                check_still(path, stillness, to_g)
            if reasons := [f"{one.start_s:.0f} s: {one.reason}" for one in stillness.intervals if one.reason]:
                lines.append(f"intervals at rest that are not used: {shortened(reasons, 3)}")
            degc, first = block_temperatures(path, samples, stillness.blocks)
            means = to_g * np.array([interval.mean for interval in stillness.used])
            places, warnings = attitudes_of_intervals(samples, stillness.used, means, plan, of_file)
            steps = steps_of(stillness.blocks, first, to_g)
            edges = list(steps)
            mount = label_of_rows(known, "mount")
            stays = _stays(stillness, places, edges, prefix, None if mount == "1" else mount)
            source = (name, str(recording.path), comments | recording.clock_comments)
            parts, more = _parts(source, stillness.blocks, stays, (degc, first), to_g, edges)
            if not parts:
                raise InputError(
                    f"{path}: no interval at rest has a temperature, and is a position of the plan, if there is one; check "
                    "--columns temperature=..., and mount_rotation_deg of the plan"
                )
    return recording, parts, [*lines, *warnings, *steps.values(), *more]


def _taken_as_still(path: Path, stillness: Stillness, to_g: float) -> Stillness:
    """A log that is too slow to show movements, as one interval at rest.

    **Raises:** `InputError` for readings of several attitudes.
    """
    blocks = stillness.blocks
    mean = blocks.mean[:, :3]
    if (count := len(grouped(to_g * mean)[1])) > 1:
        noise = to_g * np.sqrt(np.median(blocks.squares[:, :3] / (blocks.size - 1)) / _MEDIAN_CHI2)
        raise InputError(
            f"{path}: samples at {blocks.rate_hz:.3g} Hz cannot show movements, and the readings have {count} attitudes; write "
            "a file for each attitude. If the sensor was at rest in every row, add --means --noise-sd "
            f"{1e3 * (noise if noise < _MOVING_G else _USUAL_G):.2g}mg (the standard deviation of a row)"
        )
    interval = Interval(0, blocks.rows, float(blocks.start_s[0]), float(blocks.start_s[-1]), mean.mean(0))
    return replace(stillness, intervals=[interval])


def _stays(
    stillness: Stillness, places: Sequence[Place | None], steps: Sequence[int], prefix: str, mount: str | None
) -> tuple[NDArray[np.int64], pl.DataFrame]:
    """The number of the stay of each block, -1 in none, and the attitude of each stay; successive intervals in one attitude are
    one stay. After each step there are separate attitudes: its jump is then no change with temperature.

    **Arguments:** `places`: of each used interval. `steps`: blocks after a step. `prefix`: of labels of unknown attitudes.
    `mount`: the label of stays whose place has none.
    """
    blocks, stays, before = stillness.blocks, list[Place](), None
    visit, times = np.full(len(blocks), -1), blocks.start_s[steps]
    for interval, place in zip(stillness.used, places, strict=True):
        if place is not None:
            after = "".join(f" after {at:.0f} s" for at in times[blocks.row[steps] <= interval.start][-1:])
            place = replace(place, name=f"{'' if place.known else prefix}{place.name}{after}")
            stays += [place] if place != before else []
            visit[blocks_of_interval(interval, blocks)] = len(stays) - 1
        before = place
    rows = [(one.name, one.mount or mount, one.alpha_deg, one.beta_deg) for one in stays]
    columns = {"position": pl.String, "mount": pl.String, "alpha_deg": pl.Float64, "beta_deg": pl.Float64}
    return visit, pl.DataFrame(rows, columns, orient="row")


def _parts(
    source: tuple[str, str, dict[str, str]],
    blocks: SignalBlocks,
    stays: tuple[NDArray[np.int64], pl.DataFrame],
    temperatures: tuple[NDArray[np.float64], NDArray[np.float64]],
    to_g: float,
    steps: Sequence[int],
) -> tuple[list[ThermalSeries], list[str]]:
    """The blocks of the used intervals, in parts between restarts of the clock and steps, and warnings.

    **Arguments:**

    - `source`: name of the recording in labels, its file, and comments. `stays`: of each block. `temperatures`: mean of
      each block, and its first reading, degC. `to_g`: unit of the blocks, g. `steps`: blocks after a step.
    """
    (name, file, comments), (visit, visits), (degc, first) = source, stays, temperatures
    middle, block_s = blocks.start_s + (blocks.size - 1) / 2 / blocks.rate_hz, blocks.size / blocks.rate_hz
    cut = np.diff(middle, prepend=middle[:1]) < 0
    cut[steps] = True
    values = [middle, degc, first, to_g * blocks.mean[:, :3], to_g**2 * blocks.squares[:, :3]]
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
            parts.append(
                ThermalSeries.of(
                    recorded,
                    clock=f"{name} (clock {len(parts) + 1})" if parts else name,
                    source=file,
                    comments=comments,
                    block_s=block_s,
                    size=blocks.size,
                    quantum=to_g * blocks.quantum[:3],
                    visits=visits,
                    resolution=resolution_of(part["first"].to_numpy()),
                )
            )
    lost_s = block_s * (np.count_nonzero(visit >= 0) - sum(len(part.blocks) for part in parts))
    lost = [f"{lost_s:.0f} s at rest have no temperature and are not used"] if lost_s > _LONGEST_LOST_S else []
    return parts, lost + stuck_words(first, middle)
