"""Reduction of a recording to position means: by its intervals at rest, with a plan or hand-held, or by a column."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.capture.capture_plan import CapturePlan, read_plan
from tumblecal.capture.journal import sha256_of
from tumblecal.data.parquet import read_parquet, scan_parquet
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.positions import PositionSet
from tumblecal.data.raw import Raw, read_raw
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, comments_of, stated_gravity, unit_in_g
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.reading import read_recording
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.reduction.axis_checks import require_axes_answer
from tumblecal.recordings.reduction.means_at_rest import (
    Attitudes,
    NothingStill,
    check_still,
    position_set,
    reduced_at_rest,
    stillness_of,
)
from tumblecal.recordings.reduction.plan_match import PlanMatch, in_plan, matched
from tumblecal.recordings.reduction.reduce_table import reduce_table
from tumblecal.recordings.reduction.reduction import Reduction
from tumblecal.recordings.still.stillness import Stillness


@dataclass(frozen=True)
class RecordingReduction:
    """A reduction, with the contents of the source; with intervals at rest and their match to a plan, if these were used."""

    table: Reduction
    contents: Recording
    stillness: Stillness | None = None
    match: PlanMatch | None = None

    @property
    def read(self) -> list[tuple[str, Recording]]:
        """The source and its contents."""
        return [(self.table.data.source, self.contents)]

    @property
    def warnings(self) -> list[tuple[str, list[str]]]:
        """Warnings for the source."""
        return [(self.table.data.source, self.contents.damage.lines)]

    def as_dict(self) -> Mapping[str, object]:
        """Missing rows, damage and intervals for reduction.json."""
        entries = self.contents.entries
        if self.stillness is None:
            return entries
        return entries | self.stillness.as_dict() | ({"plan": self.match.as_dict()} if self.match else {})


def reduce_recording(
    path: Path,
    context: KnownContext,
    options: RecordingOptions = RecordingOptions(),
    criterion: Criterion = Criterion(),
) -> RecordingReduction:
    """Reduce a recording of any format.

    **Arguments:**

    - `path`: the recording. `context`: its positions, run and mounting; `options`: its columns and units.
    - `criterion`: the criterion for an interval at rest.

    **Raises:** `InputError` for a recording that cannot be read, or from which no positions follow; `NothingStill` without an
    interval at rest.
    """
    with scratch_folder(path) as folder:
        samples = folder / "samples.parquet"
        contents = read_recording(path, samples, options, by=context.by, in_g=True)
        plan = None if context.plan is None else read_plan(context.plan)
        named = {"position", "alpha_deg"} & set(contents.layout.columns)
        with guessed(contents.layout.notes):
            if context.by or (named and not context.static and plan is None):
                return RecordingReduction(
                    reduce_by_name(path, samples, context, plan, contents.clock_comments), contents
                )
            if plan is None and not context.static:
                raise InputError(
                    f"{path}: state how to find its positions: --static finds intervals at rest with unknown attitudes "
                    "(hand-held), --plan PLAN.toml those of a plan, --by COLUMN goes by a column; --means takes each row for "
                    "a mean"
                )
            return _by_stillness(path, samples, (context, plan), contents, criterion)


def stated_comments(samples: Path, path: Path, plan: CapturePlan | None, *, hand_held: bool) -> dict[str, str]:
    """The comments of the positions; gravity as stated, otherwise from the plan, otherwise standard for m/s^2."""
    table, _, stored = scan_parquet(samples, check=False)
    in_ms2 = "ax_ms2" in table.collect_schema()
    gravity = plan.site.gravity if plan and not plan.site.gravity.assumed else None
    gravity = stated_gravity(stored, str(path)) or gravity or (STANDARD if in_ms2 else None)
    stated = {key: value for key, value in stored.items() if key not in ("rate_hz", "imported_from")}
    stated |= {"reduced_from": path.name} | (comments_of(gravity) if gravity else {})
    return stated | ({ATTITUDES: UNKNOWN} if hand_held else {})


def reduce_by_name(
    path: Path, samples: Path, context: KnownContext, plan: CapturePlan | None, clock: Mapping[str, str]
) -> Reduction:
    """Dwells by the column that names them, with the angles of a plan, if given, by name. `clock`: comments of the clock."""
    comments = stated_comments(samples, path, plan, hand_held=context.static and plan is None) | dict(clock)
    frame, stored = read_parquet(samples, check=False)
    if plan is not None:
        rows = [(str(s.name), float(s.alpha_deg), float(s.beta_deg)) for s in plan.steps]
        steps = pl.DataFrame(rows, schema=["position", "alpha_deg", "beta_deg"], orient="row")
        angles = [name for name in ("alpha_deg", "beta_deg") if name in frame.columns]
        frame = frame.drop(angles).join(steps, on="position", how="inner", maintain_order="left")
        if not len(frame):
            names = ", ".join(name for name, *_ in rows[:8])
            raise InputError(f"{path}: none of its position names is in {context.plan}: {names} ...")
    labels = {name: label for name, label in (("run", context.run), ("mount", context.mount)) if label}
    rate = {key: value for key, value in stored.items() if key == "rate_hz"}
    frame.with_columns(pl.lit(label).alias(name) for name, label in labels.items()).write_parquet(
        samples, metadata=comments | rate
    )
    return reduce_table(samples, path)


def _by_stillness(
    path: Path, samples: Path, given: tuple[KnownContext, CapturePlan | None], contents: Recording, criterion: Criterion
) -> RecordingReduction:
    context, plan = given
    if contents.rate_hz is None:
        raise InputError(f"{path}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
    stillness = stillness_of(samples, contents.rate_hz, criterion, plan)
    comments = stated_comments(samples, path, plan, hand_held=plan is None) | contents.clock_comments
    to_g = unit_in_g(stillness.blocks.unit, stated_gravity(comments, str(path)))
    check_still(path, stillness, to_g)
    match = None
    if plan is not None:
        means = np.array([interval.mean for interval in stillness.used])
        require_axes_answer(str(path), to_g * means[:, None])
        match = matched(means, plan)
        stillness = _without_surplus(path, stillness, match)
    count = len(stillness.used)
    attitudes = _attitudes(count, match, plan)
    more = {"comments": comments} | run_and_mount(context, plan, count)
    recording = sha256_of(path)[:16] if path.is_file() else path.name
    reduction = reduced_at_rest(path, samples, stillness, to_g, attitudes, more, contents.rate_hz, recording)
    return RecordingReduction(reduction, contents, stillness, match)


def run_and_mount(context: KnownContext, plan: CapturePlan | None, count: int) -> dict[str, tuple[str, ...] | None]:
    """Run and mount of all rows: from the options, otherwise from the plan."""
    session = plan.session if plan else None
    usual = {
        "run": context.run or (session.run if session else "1"),
        "mount": context.mount or (session.mount if session else "1"),
    }
    return {name: (label,) * count if label != "1" else None for name, label in usual.items()}


def _attitudes(count: int, match: PlanMatch | None, plan: CapturePlan | None) -> Attitudes:
    """The attitudes of a plan's positions; without a plan, numbers as names, and unknown angles."""
    if plan is None or match is None:
        return tuple(f"p{k + 1}" for k in range(count)), None, None, None
    return in_plan(match, plan)


def _without_surplus(path: Path, stillness: Stillness, match: PlanMatch) -> Stillness:
    """Reject the intervals that are not positions of the plan, with their angle to the nearest."""
    used = stillness.used
    if len(match.surplus) == len(used):
        raise NothingStill(
            f"{path}: none of {len(used)} intervals at rest fits a position of the plan (nearest: "
            f"{match.angle_deg.min():.0f} deg away); check mount_rotation_deg of the plan",
            stillness,
        )
    words = "surplus: not a position of the plan, {:.0f} deg from the nearest one"
    return stillness.rejecting({used[k].start: words.format(match.angle_deg[k]) for k in match.surplus})


def means_of(
    path: Path, context: KnownContext, options: RecordingOptions = RecordingOptions()
) -> tuple[PositionSet, Recording]:
    """The positions of a table with one mean in each row: spreadsheets, .mat files and text of any layout.

    **Returns:** the positions, and the contents of the table.

    **Raises:** `InputError` for a table without accelerations, or with positions that are not in the plan.
    """
    with scratch_folder(path) as folder:
        samples = folder / "means.parquet"
        contents = read_recording(path, samples, options, by=context.by, in_g=True, means=True)
        plan = None if context.plan is None else read_plan(context.plan)
        raw = read_raw(samples, path)
        with_angles = {"alpha_deg", "beta_deg"} <= set(raw.frame.columns)
        comments = stated_comments(samples, path, plan, hand_held=plan is None and not with_angles)
        gravity = stated_gravity(comments, str(path))
        raw = raw.in_g_of(gravity) if raw.in_ms2 else raw
    require_axes_answer(str(path), raw.readings[:, None])
    names = tuple(map(str, raw.frame["position"].to_list())) if "position" in raw.frame.columns else None
    attitudes = _attitudes(len(raw.readings), _match_of(path, names, raw, plan), plan)
    if plan is None:
        alpha, beta = (raw.numbers("alpha_deg"), raw.numbers("beta_deg")) if with_angles else (None, None)
        attitudes = names or attitudes[0], alpha, beta, None
    data = position_set(path, raw.readings, attitudes)
    labels = run_and_mount(context, plan, len(data))
    time_s = raw.numbers("time_s") if "time_s" in raw.frame.columns else None
    return replace(data, comments=comments, temperature_degc=raw.temperature_degc(), time_s=time_s, **labels), contents


def _match_of(path: Path, names: tuple[str, ...] | None, raw: Raw, plan: CapturePlan | None) -> PlanMatch | None:
    """The plan's positions of means, by their names or otherwise by their directions."""
    if plan is None:
        return None
    match = matched(raw.readings, plan)
    if names is not None:
        by_name = {str(step.name): k for k, step in enumerate(plan.steps)}
        match = replace(match, positions=np.array([by_name.get(name, -1) for name in names]))
    if match.surplus:
        raise InputError(
            f"{path}: row {match.surplus[0] + 1}: not a position of the plan ({len(match.surplus)} such rows); remove them"
        )
    return match
