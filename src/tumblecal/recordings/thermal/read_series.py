"""A recording of any format as blocks over temperature: its samples, intervals at rest, temperatures and attitudes."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.column_names import WORDS, parsed
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import stated_gravity, unit_in_g
from tumblecal.recordings.clock import LONGEST_STEP_S
from tumblecal.recordings.dwells.dwell_samples import stated_comments
from tumblecal.recordings.dwells.place import Place
from tumblecal.recordings.dwells.rest import check_still, stillness_of
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.reading import read_recording
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.still.intervals import Interval, blocks_of_interval
from tumblecal.recordings.still.stillness import Stillness
from tumblecal.recordings.thermal.attitudes import attitudes_of_intervals, grouped
from tumblecal.recordings.thermal.block_temperature import block_temperatures, stuck_readings, without_short_gaps
from tumblecal.recordings.thermal.series import ThermalSeries
from tumblecal.recordings.thermal.smoothed_temperature import resolution_of
from tumblecal.recordings.thermal.steps import Step, steps_of


# Names of columns in units that are not converted.
_NOT_DEGC = re.compile(r"(?:^|[\W_]|(?<=[a-z]))(?:deg_?[FfKk]|F|K|(?<![A-Za-z])[fk]|[Ff]ahrenheit|[Kk]elvin)\W*$")
_SHOWN = 3
# Median of chi-squared with one degree of freedom.
_MEDIAN_CHI2 = 0.455
_MEANS = "If each row is the mean of a position, add --means --noise-sd 0.1mg, or the columns ax_sd_g, ay_sd_g, az_sd_g"
_AT_REST = "If the sensor was at rest in every row, add --means --noise-sd {:.2g}mg"
# Successive rows that differ by more are not one position.
_MOVING_G = 0.05
# Time at rest without a temperature that is not worth a warning, s.
_LONGEST_LOST_S = 5.0


def read_series(
    path: Path,
    name: str,
    known: tuple[KnownContext, CapturePlan | None],
    options: RecordingOptions,
    criterion: Criterion,
    of_file: Place | None,
) -> tuple[list[ThermalSeries], list[str]]:
    """Read a recording: its blocks, in parts between restarts of the clock and steps, and warnings.

    **Arguments:**

    - `name`: for labels. `known`: context, and its plan. `of_file`: the position of the file, if a table states it.
    - others: as for `thermal_reading`.

    **Raises:** `InputError` as `thermal_reading`, with the guesses about the columns.
    """
    context, plan = known
    with scratch_folder(path) as folder:
        samples = folder / "samples.parquet"
        recording = read_recording(path, samples, options, by=context.by, in_g=True)
        with guessed(recording.layout.notes):
            _check_columns(path, recording)
            rate_hz = recording.slow_hz or recording.rate_hz
            assert rate_hz is not None
            stillness = stillness_of(samples, rate_hz, criterion, plan)
            comments = stated_comments(samples, path, plan, hand_held=plan is None and of_file is None)
            to_g = unit_in_g(stillness.blocks.unit, stated_gravity(comments, str(path)))
            slow = list[str]()
            if rate_hz * LONGEST_STEP_S < 1:
                stillness = _taken_as_still(path, stillness, to_g)
                slow.append(f"samples at {rate_hz:.3g} Hz cannot show movements; taken as still, in one attitude")
            else:
                check_still(path, stillness, to_g)
            degc, first = block_temperatures(path, samples, stillness.blocks)
            means = to_g * np.array([interval.mean for interval in stillness.used])
            index, places, warnings = attitudes_of_intervals(samples, stillness.used, means, known, of_file)
            if (index < 0).all():
                raise InputError(f"{path}: no interval at rest is a position of the plan; check mount_rotation_deg")
            steps = steps_of(stillness.blocks, first, to_g)
            index, places = apart_at_steps(stillness, index, places, steps)
            comments |= recording.clock_comments
            source = (name, recording, comments)
            parts, more = series_of(source, stillness, (index, tuple(places)), (degc, first), to_g, steps)
            if not parts:
                raise InputError(
                    f"{path}: no interval at rest has a temperature; give the column by --columns temperature=..."
                )
    return parts, [*slow, *_rejected(stillness), *warnings, *more]


def _check_columns(path: Path, recording: Recording) -> None:
    column = recording.layout.columns.get("temperature")
    if column is None:
        raise InputError(f"{path}: {_no_temperature(recording.table.columns)}")
    if _NOT_DEGC.search(column.name):
        raise InputError(f"{path}: {_other_unit(column.name)}")
    if (recording.slow_hz or recording.rate_hz) is None:
        raise InputError(f"{path}: the sample rate is not known; give --rate 100 (Hz), or --columns time=.... {_MEANS}")


def _taken_as_still(path: Path, stillness: Stillness, to_g: float) -> Stillness:
    """A log that is too slow to show movements, as one interval at rest.

    **Raises:** `InputError` for readings of several attitudes.
    """
    blocks = stillness.blocks
    mean = blocks.mean[:, :3]
    if (count := len(grouped(to_g * mean)[1])) > 1:
        noise = to_g * np.sqrt(np.median(blocks.squares[:, :3] / max(blocks.size - 1, 1)) / _MEDIAN_CHI2)
        raise InputError(
            f"{path}: samples at {blocks.rate_hz:.3g} Hz cannot show movements, and the readings have {count} attitudes; write "
            f"a file for each attitude. {_MEANS if noise > _MOVING_G else _AT_REST.format(1e3 * noise)}"
        )
    interval = Interval(0, blocks.rows, float(blocks.start_s[0]), float(blocks.start_s[-1]), mean.mean(0))
    return replace(stillness, intervals=[interval])


def _no_temperature(there: Sequence[str]) -> str:
    """The reason why none of these columns is the temperature, and the remedy."""
    meanings = {name: parsed(name) for name in there}
    if empty := [name for name, meaning in meanings.items() if meaning.quantity == "temperature"]:
        return (
            f"column {empty[0]} has no values; write the temperature of the sensor there (degC), or give a different column by "
            "--columns temperature=NAME"
        )
    words = {name: {WORDS.get(word) for word in meaning.stem} for name, meaning in meanings.items()}
    if other := [name for name in there if "temperature" in words[name] and _NOT_DEGC.search(name)]:
        return _other_unit(other[0])
    return f"no temperature among the columns {', '.join(there)[:200]}; name it: --columns temperature=NAME (in degC)"


def _other_unit(name: str) -> str:
    return (
        f"column {name} is in kelvin or Fahrenheit by its name; write a column in degC, and give it by "
        "--columns temperature=..."
    )


def _rejected(stillness: Stillness) -> list[str]:
    """A line about the intervals that are not used."""
    reasons = [f"{one.start_s:.0f} s: {one.reason}" for one in stillness.intervals if one.reason]
    if not reasons:
        return []
    more = f" and {len(reasons) - _SHOWN} more" if len(reasons) > _SHOWN else ""
    return [f"intervals at rest that are not used: {'; '.join(reasons[:_SHOWN])}{more}"]


def series_of(
    source: tuple[str, Recording, Mapping[str, str]],
    stillness: Stillness,
    known: tuple[NDArray[np.int64], tuple[Place, ...]],
    temperatures: tuple[NDArray[np.float64], NDArray[np.float64]],
    to_g: float,
    steps: Sequence[Step] = (),
) -> tuple[list[ThermalSeries], list[str]]:
    """The blocks of the used intervals, in parts between restarts of the clock and steps, and warnings.

    **Arguments:**

    - `source`: name of the recording in labels, the recording, and comments.
    - `known`: attitude of each used interval, -1 for none, and the positions. `to_g`: unit of the blocks, g.
    - `temperatures`: mean of each block, and its first reading, degC.
    """
    (name, recording, comments), blocks = source, stillness.blocks
    (index, places), (degc, first) = known, temperatures
    visit, of_visit = _visits(stillness, index)
    middle = blocks.start_s + (blocks.size - 1) / 2 / blocks.rate_hz
    restarts = np.flatnonzero(np.diff(middle) < 0) + 1
    edges = [0, *np.union1d(restarts, [step.block for step in steps]).astype(int).tolist(), len(blocks)]
    parts, without = list[ThermalSeries](), 0
    for start, stop in pairwise(edges):
        part = slice(start, stop)
        if not np.isfinite(degc[part]).any():
            without += int((visit[part] >= 0).sum())
            continue
        filled = without_short_gaps(middle[part], degc[part])
        recorded = np.isfinite(filled)
        rest = visit[part] >= 0
        without += int((rest & ~recorded).sum())
        used = np.flatnonzero(rest & recorded)
        if not len(used):
            continue
        parts.append(
            ThermalSeries(
                name=name,
                clock=f"{name} (clock {len(parts) + 1})" if parts else name,
                recording=recording,
                comments=comments,
                block_s=blocks.size / blocks.rate_hz,
                size=blocks.size,
                time_s=middle[part][used],
                force=to_g * blocks.mean[part, :3][used],
                squares=to_g**2 * blocks.squares[part, :3][used],
                visit=visit[part][used],
                attitude=of_visit,
                places=places,
                quantum=to_g * blocks.quantum[:3],
                course_time_s=middle[part][recorded],
                course_degc=filled[recorded],
                resolution=resolution_of(first[part]),
            )
        )
    lost_s = without * blocks.size / blocks.rate_hz
    lines = [step.words for step in steps]
    lines += [f"{lost_s:.0f} s at rest have no temperature and are not used"] if lost_s > _LONGEST_LOST_S else []
    if run := stuck_readings(first):
        start_s, stop_s = middle[run[0]], middle[run[1] - 1]
        lines.append(
            f"the thermometer shows exactly {first[run[0]]:.6g} degC from {start_s:.0f} s to {stop_s:.0f} s, without the noise "
            "of other times: it may be stuck; cut this part out"
        )
    return parts, lines


def apart_at_steps(
    stillness: Stillness, index: NDArray[np.int64], places: Sequence[Place], steps: Sequence[Step]
) -> tuple[NDArray[np.int64], list[Place]]:
    """Attitudes of the intervals with a separate one after each step: its jump is then no change with temperature."""
    times = stillness.blocks.start_s[[step.block for step in steps]] if steps else np.zeros(0)
    part = np.searchsorted(times, [interval.start_s for interval in stillness.used], side="right")
    keys = [(int(at), int(number)) for at, number in zip(index, part, strict=True)]
    apart = [key for key in dict.fromkeys(keys) if key[0] >= 0]
    first = int(part.min(initial=len(steps)))
    divided = [
        replace(places[at], name=places[at].name + (f" after {times[n - 1]:.0f} s" if n > first else ""))
        for at, n in apart
    ]
    return np.array([apart.index(key) if key[0] >= 0 else -1 for key in keys], int), divided


def _visits(stillness: Stillness, index: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The number of the stay of each block, -1 in none, and the attitude of each stay; successive intervals in one attitude are
    one stay."""
    visit, of_visit = np.full(len(stillness.blocks), -1), list[int]()
    for interval, attitude in zip(stillness.used, index.tolist(), strict=True):
        if not of_visit or of_visit[-1] != attitude:
            of_visit.append(attitude)
        if attitude >= 0:
            visit[blocks_of_interval(interval, stillness.blocks)] = len(of_visit) - 1
    return visit, np.array(of_visit, int)
