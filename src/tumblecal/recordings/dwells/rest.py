"""Dwells by the intervals at rest of one or several files: positions of a plan, of the files, or unknown ones."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.column_names import FORCE, RATE
from tumblecal.data.parquet import scan_parquet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import stated_gravity, unit_in_g
from tumblecal.recordings.dwells.axis_checks import require_axes_answer
from tumblecal.recordings.dwells.dwell_samples import DwellSamples, dwell_samples, stated_comments
from tumblecal.recordings.dwells.file_places import FilePlaces
from tumblecal.recordings.dwells.join import Joined
from tumblecal.recordings.dwells.place import Place
from tumblecal.recordings.dwells.plan_match import PlanMatch, matched
from tumblecal.recordings.options import Criterion, KnownContext
from tumblecal.recordings.reduction_record import AtRestRecord, MatchRecord
from tumblecal.recordings.still.blocks import blocks_of, pieces_of
from tumblecal.recordings.still.stillness import Stillness, still_intervals


# Intervals of a file whose attitude differs by more than this from its longest one are of a different position, deg.
_OTHER_ATTITUDE_DEG = 10.0


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
    searched, least_s = len(stillness.noise) > 0, stillness.criterion.least_s
    why = "; ".join(f"{interval.start_s:.1f} s: {interval.reason}" for interval in stillness.intervals[:3])
    if not searched:
        why = f"{stillness.blocks.rows} samples are too few to find intervals at rest; for a table of means: --means"
    elif not why:
        noise_mg = float(stillness.noise[:3].max()) * to_g * 1e3
        why = f"in no second do the accelerations scatter by less than {noise_mg:.2g} mg, or no rest lasts"
    fault = f"{source}: no interval at rest of {least_s:g} s (--least-s) can be used: {why}"
    raise NothingStill(fault, stillness if searched else None)


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
    edges, paths = np.cumsum([one.rows for one in joined.recordings]), [one.path for one in joined.recordings]
    number = {one.start: int(np.searchsorted(edges, one.start, side="right")) for one in stillness.intervals}
    lines, entries, warnings = list[str](), dict[str, object](), list[tuple[str, list[str]]]()
    if places is not None:
        stillness = stillness if hand_held else _one_attitude_each(stillness, number, paths)
        having = {number[one.start] for one in stillness.used}
        words = "no interval at rest, so its position is missing; reduce --least-s, or record it again"
        warnings += [(str(path), [words]) for k, path in enumerate(paths) if k not in having]
    if plan is not None and not (hand_held or files_known):
        stillness, placed, match = _placed_by_plan(source, stillness, plan, to_g)
        lines, entries["plan"] = match.words(), MatchRecord.of(match).plain()
        if places is not None:
            files = [paths[number[one.start]] for one in stillness.used]
            _require_separable(plan, match, files)
            named = dict.fromkeys(f"{file.name} {place.name}" for file, place in zip(files, placed, strict=True))
            lines.append(f"positions by the direction of gravity: {', '.join(named)}")
    elif places is not None:
        placed = [places.places[number[one.start]] for one in stillness.used]
    else:
        placed = [Place(f"p{k + 1}") for k in range(len(stillness.used))]
    used, (force, temperatures) = stillness.used, _samples_at_rest(joined.samples, stillness, to_g)
    return dwell_samples(
        str(source),
        placed,
        force,
        rate_hz,
        comments,
        known,
        temperatures=temperatures,
        columns={
            "time_s": np.array([(one.start_s + one.stop_s) / 2 for one in used]),
            "clock": tuple(str(number[one.start] + 1) for one in used),
        },
        recording=joined.identifier,
        entries=entries | {"source": str(source)} | AtRestRecord.of(stillness).plain(),
        warnings=tuple(warnings),
        lines=tuple(lines),
        stillness=stillness,
    )


def _placed_by_plan(
    source: Path, stillness: Stillness, plan: CapturePlan, to_g: float
) -> tuple[Stillness, list[Place], PlanMatch]:
    """The intervals without those that are no position of a plan, and the positions of the others."""
    means = np.array([one.mean for one in stillness.used])
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
    return stillness.rejecting(reasons), [Place("").at_step(plan, k) for k in match.positions.tolist() if k >= 0], match


def _one_attitude_each(stillness: Stillness, number: Mapping[int, int], paths: Sequence[Path]) -> Stillness:
    """The longest interval of each file, and those with its attitude, since a file has one position.

    **Arguments:**

    - `number`: number of the file of an interval, by its first row.
    """
    longest, reasons = dict[int, Floats](), dict[int, str]()
    for one in sorted(stillness.used, key=lambda one: one.start - one.stop):
        unit, file = one.mean / np.linalg.norm(one.mean), number[one.start]
        angle = np.degrees(np.arccos(np.clip(unit @ longest.setdefault(file, unit), -1, 1)))
        if angle > _OTHER_ATTITUDE_DEG:
            name = paths[file].name
            reasons[one.start] = f"attitude: {angle:.0f} deg from the longest interval at rest of {name}"
    return stillness.rejecting(reasons)


def _require_separable(plan: CapturePlan, match: PlanMatch, files: Sequence[Path]) -> None:
    """Check that gravity determines the position of each file: all alpha at beta 90 are one direction.

    **Raises:** `InputError` for a file that fits several positions.
    """
    placed = [(k, same) for k, same in zip(match.positions.tolist(), match.same_direction, strict=True) if k >= 0]
    for (k, same), file in zip(placed, files, strict=True):
        angles = [(plan.steps[other].alpha_deg, plan.steps[other].beta_deg) for other in (k, *same)]
        if others := [match.names[other] for other, pair in zip(same, angles[1:], strict=True) if pair != angles[0]]:
            raise InputError(
                f"{file}: gravity cannot separate position {match.names[k]} of the plan from {', '.join(others[:4])}; name the "
                "files like the positions, or give --table files.csv"
            )


def _samples_at_rest(samples: Path, stillness: Stillness, to_g: float) -> tuple[list[Floats], list[Floats] | None]:
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
