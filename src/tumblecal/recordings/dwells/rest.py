"""Dwells by the intervals at rest of one or several files: positions of a plan, of the files, or unknown ones."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.parquet import scan_parquet
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.gravity import stated_gravity, unit_in_g
from tumblecal.recordings.dwells.axis_checks import require_axes_answer
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, dwell_samples, stated_comments
from tumblecal.recordings.dwells.file_places import FilePlaces
from tumblecal.recordings.dwells.join import Joined
from tumblecal.recordings.dwells.place import Place, angles_of
from tumblecal.recordings.dwells.plan_match import matched
from tumblecal.recordings.options import Criterion, KnownContext
from tumblecal.recordings.still.blocks import blocks_of, pieces_of
from tumblecal.recordings.still.stillness import Stillness, still_intervals


# Intervals of a file whose attitude differs by more than this from its longest one are of a different position, deg.
_OTHER_ATTITUDE_DEG = 10.0
# Directions closer than this are equal for gravity, deg.
_SAME_DEG = 1.0
# If readings contradict the angles of their files by more than this (g), after scale, axes and bias, files are exchanged.
_LARGEST_MISFIT, _FEWEST_FOR_MISFIT = 0.15, 6


class NothingStill(InputError):
    """No usable interval; `stillness` has the intervals found."""

    def __init__(self, fault: str, stillness: Stillness | None = None):
        super().__init__(fault)
        self.stillness = stillness


def stillness_of(samples: Path, rate_hz: float, criterion: Criterion, plan: CapturePlan | None) -> Stillness:
    """The intervals at rest of a table of samples, with the guard of a plan if it is longer."""
    columns = scan_parquet(samples, check=False)[0].collect_schema().names()
    channels = [name for name in columns if name[:2] in (*FORCE, *RATE)]
    if plan is not None:
        criterion = replace(criterion, guard_s=max(criterion.guard_s, plan.dwell.guard_s))
    return still_intervals(blocks_of(samples, channels, rate_hz, timed="time_s" in columns), criterion)


def check_still(source: Path, stillness: Stillness, to_g: float) -> None:
    """Check that a recording has a usable interval at rest.

    **Raises:** `NothingStill`, with the quietest second or the reasons against the intervals.
    """
    if stillness.used:
        return
    why = [f"{interval.start_s:.1f} s: {interval.reason}" for interval in stillness.intervals[:3]]
    if not len(stillness.noise):
        why = [f"{stillness.blocks.rows} samples are too few to find intervals at rest; for a table of means: --means"]
    elif not why:
        noise_mg = float(stillness.noise[:3].max()) * to_g * 1e3
        why = [f"in no second do the accelerations scatter by less than {noise_mg:.2g} mg, or no rest lasts"]
    searched = stillness if len(stillness.noise) else None
    least = f"{stillness.criterion.least_s:g} s (--least-s)"
    raise NothingStill(f"{source}: no interval at rest of {least} can be used: {'; '.join(why)}", searched)


def dwells_at_rest(
    joined: Joined, places: FilePlaces | None, known: tuple[KnownContext, CapturePlan | None], criterion: Criterion
) -> DwellSamples:
    """The dwells by the intervals at rest.

    **Arguments:**

    - `places`: of the files, in the order of `joined`; None for a single recording of several positions.
    - `known`: context, and its plan. `criterion`: for an interval at rest.

    **Raises:** `InputError` for an unknown rate, and positions that gravity cannot separate; `NothingStill` without an interval
    at rest.
    """
    (context, plan), source, rate_hz = known, joined.source, joined.rate_hz
    if rate_hz is None:
        raise InputError(f"{source}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
    stillness = stillness_of(joined.samples, rate_hz, criterion, plan)
    files_known = places is not None and places.known
    hand_held = context.static or (plan is None and not files_known)
    comments = stated_comments(joined.samples, source, plan, hand_held=hand_held)
    to_g = unit_in_g(stillness.blocks.unit, stated_gravity(comments, str(source)))
    check_still(source, stillness, to_g)
    paths, warnings = [one.path for one in joined.recordings], list[tuple[str, list[str]]]()
    lines, entries = list[str](), dict[str, object]()
    if places is not None:
        stillness = stillness if hand_held else _one_attitude_each(stillness, joined)
        for number in sorted({*range(len(paths))} - {*_files_of(stillness, joined)}):
            words = "no interval at rest, so its position is missing; reduce --least-s, or record it again"
            warnings.append((str(paths[number]), [words]))
    if plan is not None and not (hand_held or files_known):
        stillness, placed, lines, entries["plan"] = _placed_by_plan(source, stillness, plan, to_g)
        if places is not None:
            files = [paths[k] for k in _files_of(stillness, joined)]
            _require_separable(plan, placed, files)
            named = dict.fromkeys(f"{file.name} {place.name}" for file, place in zip(files, placed, strict=True))
            lines.append(f"positions by the direction of gravity: {', '.join(named)}")
    elif places is not None:
        placed = [places.places[k] for k in _files_of(stillness, joined)]
    else:
        placed = [Place(f"p{k + 1}") for k in range(len(stillness.used))]
    force, temperatures = _samples_at_rest(joined.samples, stillness, to_g)
    files_of = _files_of(stillness, joined)
    columns = {
        "time_s": np.array([(interval.start_s + interval.stop_s) / 2 for interval in stillness.used]),
        "clock": tuple(str(k + 1) for k in files_of),
    }
    dwells = dwell_samples(
        str(source),
        placed,
        force,
        rate_hz,
        comments,
        known,
        temperatures=temperatures,
        columns=columns,
        recording=joined.identifier,
        entries=entries | {"source": str(source)} | stillness.as_dict(),
        lines=tuple(lines),
        stillness=stillness,
    )
    if places is not None and not hand_held:
        warnings += _contradictions(placed, dwells.positions.readings, [str(paths[k]) for k in files_of], places.by)
    return replace(dwells, warnings=tuple(warnings))


def _placed_by_plan(
    source: Path, stillness: Stillness, plan: CapturePlan, to_g: float
) -> tuple[Stillness, list[Place], list[str], dict[str, object]]:
    """The intervals without those that are no position of a plan, the positions of the others, lines, and a file's entries."""
    means = np.array([interval.mean for interval in stillness.used])
    require_axes_answer(str(source), to_g * means[:, None])
    match = matched(means, plan)
    if (match.positions < 0).all():
        raise NothingStill(
            f"{source}: none of {len(means)} intervals at rest fits a position of the plan (nearest: "
            f"{match.angle_deg.min():.0f} deg away); check mount_rotation_deg of the plan",
            stillness,
        )
    surplus = "surplus: not a position of the plan, {:.0f} deg from the nearest one"
    reasons = {stillness.used[k].start: surplus.format(match.angle_deg[k]) for k in match.surplus}
    placed = [Place("").at_step(plan, k) for k in match.positions.tolist() if k >= 0]
    return stillness.rejecting(reasons), placed, match.words(), match.as_dict()


def _files_of(stillness: Stillness, joined: Joined) -> list[int]:
    """The number of the recording of each used interval."""
    starts = [interval.start for interval in stillness.used]
    return (np.searchsorted(joined.edges, starts, side="right") - 1).tolist()


def _one_attitude_each(stillness: Stillness, joined: Joined) -> Stillness:
    """The longest interval of each file, and those with its attitude, since a file has one position."""
    longest, reasons = dict[int, NDArray[np.float64]](), dict[int, str]()
    of_file = list(zip(stillness.used, _files_of(stillness, joined), strict=True))
    for interval, number in sorted(of_file, key=lambda one: one[0].start - one[0].stop):
        unit = interval.mean / np.linalg.norm(interval.mean)
        angle = np.degrees(np.arccos(np.clip(unit @ longest.setdefault(number, unit), -1, 1)))
        if angle > _OTHER_ATTITUDE_DEG:
            name = joined.recordings[number].path.name
            reasons[interval.start] = f"attitude: {angle:.0f} deg from the longest interval at rest of {name}"
    return stillness.rejecting(reasons)


def _require_separable(plan: CapturePlan, placed: Sequence[Place], files: Sequence[Path]) -> None:
    """Check that gravity determines the position of each file: all alpha at beta 90 are one direction.

    **Raises:** `InputError` for a file that fits several positions.
    """
    expected = np.array([plan.expected(k) for k in range(len(plan.steps))])
    for place, file in zip(placed, files, strict=True):
        same = np.flatnonzero(expected @ expected[place.step or 0] > np.cos(np.radians(_SAME_DEG)))
        angles = place.alpha_deg, place.beta_deg
        steps = [plan.steps[k] for k in same]
        if others := [str(step.name) for step in steps if (step.alpha_deg, step.beta_deg) != angles]:
            raise InputError(
                f"{file}: gravity cannot separate position {place.name} of the plan from {', '.join(others[:4])}; name the "
                "files like the positions, or give --table files.csv"
            )


def _contradictions(
    placed: Sequence[Place], readings: NDArray[np.float64], files: Sequence[str], by: str
) -> list[tuple[str, list[str]]]:
    """A warning if scale factors, axes and biases do not explain the readings at the angles of their files."""
    design = np.column_stack([gravity_in_head(*np.radians(angles_of(placed))), np.ones(len(placed))])
    if len(placed) < _FEWEST_FOR_MISFIT or np.linalg.cond(design) > 100:
        return []
    solution = np.linalg.lstsq(design, readings, rcond=None)[0]
    misfit = np.linalg.norm(readings - design @ solution, axis=1)
    if misfit.max() < _LARGEST_MISFIT and np.linalg.det(solution[:3]) > 0:
        return []
    words = f"(mirrored, or in error by up to {misfit.max():.2f} g); check whether files are exchanged."
    return [(files[int(misfit.argmax())], [f"gravity contradicts the positions by {by} {words}"])]


def _samples_at_rest(
    samples: Path, stillness: Stillness, to_g: float
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]] | None]:
    """The accelerations (n, 3) of each used interval, g, without knocks and outliers, and their temperatures."""
    there = scan_parquet(samples, check=False)[0].collect_schema().names()
    columns = [name for name in there if name[:2] in FORCE or name == "temperature_degc"]
    good = np.zeros(stillness.blocks.rows, bool)
    for interval in stillness.used:
        good[interval.start : interval.stop] = True
        for start, stop in interval.knocks:
            good[start:stop] = False
    good[stillness.blocks.outliers] = False
    rows = np.concatenate([table[good[first : first + len(table)]] for first, table in pieces_of(samples, columns)])
    counts = [int(good[interval.start : interval.stop].sum()) for interval in stillness.used]
    whole = np.split(rows, np.cumsum(counts)[:-1])
    temperatures = [part[:, 3] for part in whole] if len(columns) > 3 else None
    return [np.ascontiguousarray(part[:, :3]) * to_g for part in whole], temperatures
