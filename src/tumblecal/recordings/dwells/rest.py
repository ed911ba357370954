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
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, require_samples, stated_comments
from tumblecal.recordings.dwells.file_places import FilePlaces
from tumblecal.recordings.dwells.join import Joined
from tumblecal.recordings.dwells.place import Place, angles_of, position_set
from tumblecal.recordings.dwells.plan_match import PlanMatch, matched
from tumblecal.recordings.options import Criterion, KnownContext
from tumblecal.recordings.still.blocks import blocks_of, pieces_of
from tumblecal.recordings.still.stillness import Stillness, still_intervals


# Intervals of a file whose attitude differs by more than this from its longest one are of a different position, deg.
_OTHER_ATTITUDE_DEG = 10.0
# Directions closer than this are equal for gravity, deg.
_SAME_DEG = 1.0
# If readings contradict the angles of their files by more than this (g), after scale, axes and bias, files are exchanged.
_LARGEST_MISFIT, _FEWEST_FOR_MISFIT = 0.15, 6
_SURPLUS = "surplus: not a position of the plan, {:.0f} deg from the nearest one"


class NothingStill(InputError):
    """No usable interval; `stillness` has the intervals found."""

    def __init__(self, fault: str, stillness: Stillness | None = None):
        super().__init__(fault)
        self.stillness = stillness

    def __reduce__(self) -> tuple[object, ...]:
        return NothingStill, (self.faults[0], self.stillness)


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
    if not len(stillness.noise):
        raise NothingStill(
            f"{source}: {stillness.blocks.rows} samples are too few to find intervals at rest (for a table of means: --means)"
        )
    if not stillness.dof.any():
        noise_mg = float(stillness.noise[:3].max()) * to_g * 1e3
        raise NothingStill(
            f"{source}: no interval at rest: in no second do the accelerations scatter by less than "
            f"{noise_mg:.2g} mg, or no rest lasts {stillness.criterion.least_s:g} s (--least-s)",
            stillness,
        )
    if not stillness.used:
        reasons = "; ".join(f"{interval.start_s:.1f} s: {interval.reason}" for interval in stillness.intervals[:3])
        raise NothingStill(
            f"{source}: no interval at rest is long enough ({reasons or 'all moves'}); see --least-s", stillness
        )


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
    (context, plan), source = known, joined.source
    rate_hz = joined.rate_hz
    if rate_hz is None:
        raise InputError(f"{source}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
    stillness = stillness_of(joined.samples, rate_hz, criterion, plan)
    hand_held = context.static or (plan is None and not (places and places.known))
    comments = stated_comments(joined.samples, source, plan, hand_held=hand_held)
    to_g = unit_in_g(stillness.blocks.unit, stated_gravity(comments, str(source)))
    if len(joined.recordings) > 1:
        stillness = _within_files(stillness, joined)
    check_still(source, stillness, to_g)
    warnings = list[tuple[str, list[str]]]()
    lines, entries = list[str](), dict[str, object]()
    if places is not None:
        stillness = stillness if hand_held else _one_attitude_each(stillness, joined)
        warnings += _without_still(stillness, joined)
    if plan is not None and not hand_held and not (places and places.known):
        match = _matched(source, stillness, plan, to_g)
        surplus = {stillness.used[k].start: _SURPLUS.format(match.angle_deg[k]) for k in match.surplus}
        stillness = stillness.rejecting(surplus)
        placed = [Place("").at_step(plan, k) for k in match.positions.tolist() if k >= 0]
        lines += match.words()
        entries["plan"] = match.as_dict()
        if places is not None:
            _require_separable(plan, placed, [joined.recordings[k].path for k in _files_of(stillness, joined)])
            named = zip(_files_of(stillness, joined), placed, strict=True)
            words = dict.fromkeys(f"{joined.recordings[k].path.name} {place.name}" for k, place in named)
            lines.append(f"positions by the direction of gravity: {', '.join(words)}")
    elif places is not None:
        placed = [places.places[k] for k in _files_of(stillness, joined)]
    else:
        placed = [Place(f"p{k + 1}") for k in range(len(stillness.used))]
    force, temperatures = _samples_at_rest(joined.samples, stillness, to_g)
    readings = np.array([dwell.mean(0) for dwell in force])
    require_samples(str(source), [place.name for place in placed], force)
    if places is not None and not hand_held:
        warnings += _contradictions(placed, readings, stillness, joined, places.by)
    positions = position_set(
        str(source),
        readings,
        placed,
        comments,
        known,
        time_s=np.array([(interval.start_s + interval.stop_s) / 2 for interval in stillness.used]),
        temperature_degc=_mean_temperatures(temperatures),
        clock=tuple(str(k + 1) for k in _files_of(stillness, joined)),
        n=np.array([len(dwell) for dwell in force], float),
    )
    entries |= {"source": str(source)} | stillness.as_dict()
    return DwellSamples(
        positions,
        force,
        rate_hz,
        joined.identifier,
        temperatures,
        entries=entries,
        warnings=tuple(warnings),
        lines=tuple(lines),
        stillness=stillness,
    )


def _matched(source: Path, stillness: Stillness, plan: CapturePlan, to_g: float) -> PlanMatch:
    """The position of a plan of each used interval."""
    means = np.array([interval.mean for interval in stillness.used])
    require_axes_answer(str(source), to_g * means[:, None])
    match = matched(means, plan)
    if (match.positions < 0).all():
        raise NothingStill(
            f"{source}: none of {len(means)} intervals at rest fits a position of the plan (nearest: "
            f"{match.angle_deg.min():.0f} deg away); check mount_rotation_deg of the plan",
            stillness,
        )
    return match


def _files_of(stillness: Stillness, joined: Joined) -> list[int]:
    """The number of the recording of each used interval."""
    middles = [(interval.start + interval.stop) // 2 for interval in stillness.used]
    return (np.searchsorted(joined.edges, middles, side="right") - 1).tolist()


def _within_files(stillness: Stillness, joined: Joined) -> Stillness:
    """The intervals without rows of the file before or after, which a block at the boundary may include."""
    cut = []
    for interval in stillness.intervals:
        number = int(np.searchsorted(joined.edges, (interval.start + interval.stop) // 2, side="right"))
        start, stop = joined.edges[number - 1], joined.edges[number]
        cut.append(replace(interval, start=max(interval.start, start), stop=min(interval.stop, stop)))
    return replace(stillness, intervals=cut)


def _one_attitude_each(stillness: Stillness, joined: Joined) -> Stillness:
    """The longest interval of each file, and those with its attitude, since a file has one position."""
    longest: dict[int, NDArray[np.float64]] = {}
    of_file = list(zip(stillness.used, _files_of(stillness, joined), strict=True))
    for interval, number in sorted(of_file, key=lambda one: one[0].stop - one[0].start, reverse=True):
        longest.setdefault(number, interval.mean / np.linalg.norm(interval.mean))
    reasons = {}
    for interval, number in of_file:
        cosine = interval.mean @ longest[number] / np.linalg.norm(interval.mean)
        angle = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
        if angle > _OTHER_ATTITUDE_DEG:
            name = joined.recordings[number].path.name
            reasons[interval.start] = f"attitude: {angle:.0f} deg from the longest interval at rest of {name}"
    return stillness.rejecting(reasons)


def _without_still(stillness: Stillness, joined: Joined) -> list[tuple[str, list[str]]]:
    """A warning for each file without an interval at rest."""
    having = {*_files_of(stillness, joined)}
    return [
        (
            str(recording.path),
            [
                f"no interval at rest in its {joined.length_s(k):.2g} s, so its position is missing; reduce --least-s, or "
                "record it again"
            ],
        )
        for k, recording in enumerate(joined.recordings)
        if k not in having
    ]


def _require_separable(plan: CapturePlan, placed: Sequence[Place], files: Sequence[Path]) -> None:
    """Check that gravity determines the position of each file: all alpha at beta 90 are one direction.

    **Raises:** `InputError` for a file that fits several positions.
    """
    expected = np.array([plan.expected(k) for k in range(len(plan.steps))])
    angles = [(step.alpha_deg, step.beta_deg) for step in plan.steps]
    for place, file in zip(placed, files, strict=True):
        step = place.step or 0
        same_direction = np.flatnonzero(expected @ expected[step] > np.cos(np.radians(_SAME_DEG)))
        others = [str(plan.steps[k].name) for k in same_direction if angles[k] != angles[step]]
        if others:
            raise InputError(
                f"{file}: gravity cannot separate position {place.name} of the plan from {', '.join(others[:4])}; name the "
                "files like the positions, or give --table files.csv"
            )


def _contradictions(
    placed: Sequence[Place], readings: NDArray[np.float64], stillness: Stillness, joined: Joined, by: str
) -> list[tuple[str, list[str]]]:
    """A warning if scale factors, axes and biases do not explain the readings at the angles of their files."""
    alpha, beta = angles_of(placed)
    design = np.column_stack([gravity_in_head(np.radians(alpha), np.radians(beta)), np.ones(len(placed))])
    if len(placed) < _FEWEST_FOR_MISFIT or np.linalg.cond(design) > 100:
        return []
    solution, *_ = np.linalg.lstsq(design, readings, rcond=None)
    misfit = np.linalg.norm(readings - design @ solution, axis=1)
    turned = np.linalg.det(solution[:3]) < 0
    if misfit.max() < _LARGEST_MISFIT and not turned:
        return []
    worst = str(joined.recordings[_files_of(stillness, joined)[int(misfit.argmax())]].path)
    how = "mirrored" if turned else f"in error by up to {misfit.max():.2f} g ({worst})"
    return [(worst, [f"gravity contradicts the positions by {by}: readings {how}; check whether files are exchanged."])]


def _samples_at_rest(
    samples: Path, stillness: Stillness, to_g: float
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]] | None]:
    """The accelerations (n, 3) of each used interval, g, without knocks and outliers, and their temperatures."""
    there = scan_parquet(samples, check=False)[0].collect_schema().names()
    columns = [name for name in there if name[:2] in FORCE or name == "temperature_degc"]
    parts: list[list[NDArray[np.float64]]] = [[] for _ in stillness.used]
    alone = stillness.blocks.outliers
    for first, table in pieces_of(samples, columns):
        for part, interval in zip(parts, stillness.used, strict=True):
            start, stop = max(interval.start, first), min(interval.stop, first + len(table))
            if start >= stop:
                continue
            good = np.ones(stop - start, bool)
            good[alone[(alone >= start) & (alone < stop)] - start] = False
            for from_row, to_row in interval.knocks:
                good[max(from_row - start, 0) : max(to_row - start, 0)] = False
            part.append(table[start - first : stop - first][good])
    whole = [np.concatenate(part) for part in parts]
    temperatures = [part[:, 3] for part in whole] if len(columns) > 3 else None
    return [np.ascontiguousarray(part[:, :3]) * to_g for part in whole], temperatures


def _mean_temperatures(temperatures: Sequence[NDArray[np.float64]] | None) -> NDArray[np.float64] | None:
    """The mean temperature of each interval; None if an interval has none."""
    finite = [temperature[np.isfinite(temperature)] for temperature in temperatures or []]
    return np.array([temperature.mean() for temperature in finite]) if finite and all(map(len, finite)) else None
