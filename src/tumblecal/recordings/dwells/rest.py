"""Intervals at rest of one or several files with the place of each, for dwells and for temperatures; dwells by rest."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.parquet import scan_parquet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import stated_gravity, unit_in_g
from tumblecal.recordings.clock import LONGEST_STEP_S
from tumblecal.recordings.dwells.dwell_checks import require_axes_answer
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, dwell_samples, stated_comments
from tumblecal.recordings.dwells.join import Joined
from tumblecal.recordings.dwells.places import FilePlaces, Known, Place, places_of
from tumblecal.recordings.dwells.plan_match import PlanMatch, matched
from tumblecal.recordings.options import Criterion
from tumblecal.recordings.reduction_record import AtRestRecord, MatchRecord
from tumblecal.recordings.still.blocks import blocks_of, pieces_of
from tumblecal.recordings.still.intervals import ONE_ATTITUDE_G, Interval, grouped
from tumblecal.recordings.still.stillness import Stillness, still_intervals


# Median of chi-squared with one degree of freedom.
_MEDIAN_CHI2 = 0.455
# Rows whose noise is larger are means of different positions, whose standard deviation only the user knows.
_MOVING_G, _USUAL_G = 0.05, 1e-4


class NothingStill(InputError):
    """No usable interval; `stillness` has the intervals found."""

    def __init__(self, fault: str, stillness: Stillness | None = None):
        super().__init__(fault)
        self.stillness = stillness


class AtRest(NamedTuple):
    """The intervals at rest of a recording.

    - `places`: of each used interval; None if nothing states it. `to_g`: unit of the samples, g.
    - `comments`: of the positions. `lines`, `warnings`, `entries`: as of `DwellSamples`.
    - `number`: number of the file of an interval, by its first row.
    """

    stillness: Stillness
    places: list[Place | None]
    to_g: float
    comments: dict[str, str]
    number: dict[int, int]
    lines: list[str]
    warnings: list[tuple[str, list[str]]]
    entries: dict[str, object]


def at_rest(
    joined: Joined, of_files: FilePlaces | None, known: Known, criterion: Criterion, slow_hz: float | None = None
) -> AtRest:
    """The intervals at rest: of the positions of a plan by the direction of gravity, of the positions of files, or unknown.

    **Arguments:**

    - `of_files`: places of the files, in the order of `joined`; None for a single recording of several positions.
    - `known`: context, and its plan. `criterion`: for an interval at rest.
    - `slow_hz`: rate of a log that cannot show movements, which is then one interval.

    **Raises:** `InputError` for an unknown rate, and positions that gravity cannot separate; `NothingStill` without an interval
    at rest.
    """
    (context, plan), source, rate_hz = known, joined.source, slow_hz or joined.rate_hz
    if rate_hz is None:
        raise InputError(f"{source}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
    columns = scan_parquet(joined.samples, check=False)[0].collect_schema().names()
    channels = [name for name in columns if name[:2] in (*FORCE, *RATE)]
    if plan is not None:
        criterion = replace(criterion, guard_s=max(criterion.guard_s, plan.dwell.guard_s))
    stillness = still_intervals(blocks_of(joined.samples, channels, rate_hz, timed="time_s" in columns), criterion)
    files_known = of_files is not None and of_files.known
    hand_held = context.static or (plan is None and not files_known)
    comments = stated_comments(joined.samples, source, plan, hand_held=hand_held)
    to_g = unit_in_g(stillness.blocks.unit, stated_gravity(comments, str(source)))
    lines, entries, warnings = list[str](), dict[str, object](), list[tuple[str, list[str]]]()
    if slow_hz and slow_hz * LONGEST_STEP_S < 1:
        stillness = _taken_as_still(source, stillness, to_g)
        lines.append(f"samples at {slow_hz:.3g} Hz cannot show movements; taken as still, in one attitude")
    _require_rest(source, stillness, to_g)
    edges, paths = np.cumsum([one.rows for one in joined.recordings]), [one.path for one in joined.recordings]
    number = {one.start: int(np.searchsorted(edges, one.start, side="right")) for one in stillness.intervals}
    if of_files is not None:
        if not hand_held:
            # A file has one position: that of its longest interval.
            longest, reasons = dict[int, Floats](), dict[int, str]()
            for one in sorted(stillness.used, key=lambda one: one.start - one.stop):
                file = number[one.start]
                apart_g = to_g * float(np.linalg.norm(one.mean - longest.setdefault(file, one.mean)))
                if apart_g > ONE_ATTITUDE_G:
                    angle = 2 * np.degrees(np.arcsin(min(apart_g / 2, 1.0)))
                    words = f"attitude: {angle:.0f} deg from the longest interval at rest of {paths[file].name}"
                    reasons[one.start] = words
            stillness = stillness.rejecting(reasons)
        having = {number[one.start] for one in stillness.used}
        words = "no interval at rest, so its position is missing; reduce --least-s, or record it again"
        warnings += [(str(path), [words]) for k, path in enumerate(paths) if k not in having]
    places: list[Place | None] = [None] * len(stillness.used)
    if plan is not None and not (hand_held or files_known):
        stillness, match = _matched(source, stillness, known, to_g)
        steps = places_of(plan)
        places = [steps[k] for k in match.positions.tolist() if k >= 0]
        lines += match.words()
        entries["plan"] = MatchRecord.of(match).plain()
        if of_files is not None:
            files = [paths[number[one.start]] for one in stillness.used]
            _require_separable(steps, match, files)
            named = dict.fromkeys(
                f"{file.name} {place.position}" for file, place in zip(files, places, strict=True) if place
            )
            lines.append(f"positions by the direction of gravity: {', '.join(named)}")
    elif of_files is not None:
        places = [of_files.places[number[one.start]] for one in stillness.used]
    return AtRest(stillness, places, to_g, comments, number, lines, warnings, entries)


def dwells_at_rest(joined: Joined, of_files: FilePlaces | None, known: Known, criterion: Criterion) -> DwellSamples:
    """The dwells by the intervals at rest.

    **Arguments, raises:** as `at_rest`.
    """
    found = at_rest(joined, of_files, known, criterion)
    used, (force, temperatures) = found.stillness.used, _samples_at_rest(joined.samples, found)
    assert joined.rate_hz is not None
    return dwell_samples(
        str(joined.source),
        [place or Place(f"p{k}") for k, place in enumerate(found.places, start=1)],
        force,
        joined.rate_hz,
        found.comments,
        known,
        temperatures=temperatures,
        columns={
            "time_s": np.array([(one.start_s + one.stop_s) / 2 for one in used]),
            "clock": tuple(str(found.number[one.start] + 1) for one in used),
        },
        recording=joined.identifier,
        entries=found.entries | {"source": str(joined.source)} | AtRestRecord.of(found.stillness).plain(),
        warnings=tuple(found.warnings),
        lines=tuple(found.lines),
        stillness=found.stillness,
    )


def _taken_as_still(source: Path, stillness: Stillness, to_g: float) -> Stillness:
    """A log that is too slow to show movements, as one interval at rest.

    **Raises:** `InputError` for readings of several attitudes.
    """
    blocks = stillness.blocks
    mean = blocks.mean[:, :3]
    if (count := len(grouped(to_g * mean)[1])) > 1:
        noise = to_g * np.sqrt(np.median(blocks.squares[:, :3] / (blocks.size - 1)) / _MEDIAN_CHI2)
        raise InputError(
            f"{source}: samples at {blocks.rate_hz:.3g} Hz cannot show movements, and the readings have {count} attitudes; "
            "write a file for each attitude. If the sensor was at rest in every row, add --means --noise-sd "
            f"{1e3 * (noise if noise < _MOVING_G else _USUAL_G):.2g}mg (the standard deviation of a row)"
        )
    interval = Interval(0, blocks.rows, float(blocks.start_s[0]), float(blocks.start_s[-1]), mean.mean(0))
    return replace(stillness, intervals=[interval])


def _require_rest(source: Path, stillness: Stillness, to_g: float) -> None:
    """Check that a recording has a usable interval at rest.

    **Raises:** `NothingStill`, with the quietest second or the reasons against the intervals.
    """
    if stillness.used:
        return
    searched, least_s = len(stillness.noise) > 0, stillness.criterion.least_s
    why = "; ".join(f"{interval.start_s:.1f} s: {interval.reason}" for interval in stillness.intervals[:3])
    if not searched:
        why = f"{stillness.blocks.rows} samples are too few to find intervals at rest; for a table of means: --means"
    elif not why:
        noise_mg = float(stillness.noise[:3].max()) * to_g * 1e3
        why = f"in no second do the accelerations scatter by less than {noise_mg:.2g} mg, or no rest lasts"
    fault = f"{source}: no interval at rest of {least_s:g} s (--least-s) can be used: {why}"
    raise NothingStill(fault, stillness if searched else None)


def _matched(source: Path, stillness: Stillness, known: Known, to_g: float) -> tuple[Stillness, PlanMatch]:
    """The intervals without those that are no position of a plan, and the positions of all."""
    used, (_, plan) = stillness.used, known
    means = np.array([one.mean for one in used])
    require_axes_answer(str(source), to_g * means[:, None])
    assert plan is not None
    match = matched(means, plan)
    if (match.positions < 0).all():
        raise NothingStill(
            f"{source}: none of {len(means)} intervals at rest fits a position of the plan (nearest: "
            f"{match.angle_deg.min():.0f} deg away); check mount_rotation_deg of the plan",
            stillness,
        )
    surplus = "surplus: not a position of the plan, {:.0f} deg from the nearest one"
    return stillness.rejecting({used[k].start: surplus.format(match.angle_deg[k]) for k in match.surplus}), match


def _require_separable(steps: list[Place], match: PlanMatch, files: list[Path]) -> None:
    """Check that gravity determines the position of each file: all alpha at beta 90 are one direction.

    **Raises:** `InputError` for a file that fits several positions.
    """
    placed = [(k, same) for k, same in zip(match.positions.tolist(), match.same_direction, strict=True) if k >= 0]
    for (k, same), file in zip(placed, files, strict=True):
        at = (steps[k].alpha_deg, steps[k].beta_deg)
        if others := [match.names[one] for one in same if (steps[one].alpha_deg, steps[one].beta_deg) != at]:
            raise InputError(
                f"{file}: gravity cannot separate position {match.names[k]} of the plan from {', '.join(others[:4])}; name the "
                "files like the positions, or give --table files.csv"
            )


def _samples_at_rest(samples: Path, found: AtRest) -> tuple[list[Floats], list[Floats] | None]:
    """The accelerations (n, 3) of each used interval, g, without knocks and outliers, and their temperatures."""
    there, stillness = scan_parquet(samples, check=False)[0].collect_schema().names(), found.stillness
    columns = [name for name in there if name[:2] in FORCE or name == "temperature_degc"]
    good = np.zeros(stillness.blocks.rows, bool)
    for interval in stillness.used:
        good[interval.start : interval.stop] = True
        for start, stop in interval.knocks:
            good[start:stop] = False
    good[stillness.blocks.outliers] = False
    rows = np.concatenate([table[good[piece]] for piece, _, table in pieces_of(samples, columns)])
    counts = [int(good[interval.start : interval.stop].sum()) for interval in stillness.used]
    whole = np.split(rows, np.cumsum(counts)[:-1])
    temperatures = [part[:, 3] for part in whole] if len(columns) > 3 else None
    return [np.ascontiguousarray(part[:, :3]) * found.to_g for part in whole], temperatures
