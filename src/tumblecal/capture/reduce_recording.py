"""From a recording made elsewhere to position means: its still intervals, matched to a plan or as a hand-held set."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan, read_plan
from tumblecal.capture.journal import sha256_of
from tumblecal.capture.plan_match import PlanMatch, matched
from tumblecal.capture.recordings.roles import FORCE, RATE
from tumblecal.capture.recordings.sample_file import Contents, write_samples
from tumblecal.capture.recordings.table import Asked
from tumblecal.capture.reduce_table import TableReduction, enough_samples, names_of, reduce_table, reduction_of
from tumblecal.capture.still import Criterion, Interval, Stillness, still_intervals
from tumblecal.capture.still_blocks import blocks_of, pieces_of
from tumblecal.data.parquet import read_parquet, scan_parquet
from tumblecal.data.positions import ATTITUDES, UNKNOWN, PositionSet, attitudes_of
from tumblecal.data.raw import read_raw
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, Gravity, comments_of, stated_gravity


_ONE_ATTITUDE_DEG = 10.0


@dataclass(frozen=True)
class Known:
    """What is known of a recording besides its samples.

    `plan` None and `hand_held` True: attitudes unknown. `by`: column that names the positions. `run`, `mount`: labels.
    """

    plan: Path | None = None
    hand_held: bool = False
    by: str = ""
    gravity: Gravity | None = None
    run: str = ""
    mount: str = ""


@dataclass(frozen=True)
class RecordingReduction:
    """A reduction, with what was read; where intervals were looked for, what lies still, and what a plan says of it."""

    table: TableReduction
    contents: Contents
    stillness: Stillness | None = None
    match: PlanMatch | None = None
    plan: CapturePlan | None = None

    def as_dict(self) -> Mapping[str, object]:
        """What reduction.json says of the intervals."""
        if self.stillness is None:
            return {}
        s = self.stillness
        criterion = {
            "false_alarm": s.criterion.false_alarm,
            "least_s": s.criterion.least_s,
            "guard_s": s.criterion.guard_s,
        }
        told: dict[str, object] = {
            "still": {**criterion, "noise": s.noise.tolist(), "dof": s.dof.tolist()},
            "intervals": [interval.as_dict() for interval in s.intervals],
        }
        if self.match and self.plan:
            names = [str(step.name) for step in self.plan.steps]
            told["plan"] = {
                "in_order": self.match.in_order,
                "missing": [names[k] for k in self.match.missing],
                "repeated": [names[k] for k in self.match.repeated],
                "surplus": len(self.match.surplus),
            }
        return told


class NothingStill(InputError):
    """No interval that can be used; `stillness` says what was seen."""

    def __init__(self, fault: str, stillness: Stillness | None = None):
        super().__init__(fault)
        self.stillness = stillness

    def __reduce__(self) -> tuple:
        return NothingStill, (self.faults[0], self.stillness)


def reduce_recording(
    path: Path, known: Known, asked: Asked = Asked(), criterion: Criterion = Criterion()
) -> RecordingReduction:
    """Reduce a recording of any format.

    **Arguments:**

    - `path`: the recording. `known`: what is known of it; `asked`: of its columns and units.

    **Raises:** `InputError` for a recording that cannot be read, or from which no positions follow; `NothingStill` where
    nothing in it lies still.
    """
    with TemporaryDirectory() as folder:
        samples = Path(folder) / "samples.parquet"
        contents = write_samples(path, samples, asked, by=known.by, in_force_units=True)
        plan = None if known.plan is None else read_plan(known.plan)
        named = "position" in contents.layout.columns or "alpha_deg" in contents.layout.columns
        if known.by or (named and not known.hand_held and plan is None):
            return RecordingReduction(_by_name(path, samples, known, plan), contents)
        if plan is None and not known.hand_held:
            raise InputError(
                f"{path}: how are its positions told apart? --static finds still intervals of unknown attitudes (hand-held), "
                "--plan PLAN.toml those of a plan, --by COLUMN goes by a column; --means takes each row for a mean"
            )
        return _by_stillness(path, samples, (known, plan), contents, criterion)


def _comments(samples: Path, path: Path, known: Known, plan: CapturePlan | None) -> dict[str, str]:
    """The comments of the positions; gravity as asked, else as the plan or the file says, else standard for m/s^2."""
    table, _, kept = scan_parquet(samples)
    in_ms2 = "ax_ms2" in table.collect_schema()
    gravity = known.gravity or (plan.site.gravity if plan and not plan.site.gravity.assumed else None)
    gravity = gravity or stated_gravity(kept, str(path)) or (STANDARD if in_ms2 else None)
    stated = {key: value for key, value in kept.items() if key not in ("rate_hz", "imported_from")}
    stated |= {"reduced_from": path.name} | (comments_of(gravity) if gravity else {})
    return stated | ({ATTITUDES: UNKNOWN} if plan is None and known.hand_held else {})


def _by_name(path: Path, samples: Path, known: Known, plan: CapturePlan | None) -> TableReduction:
    """Dwells by the column that names them; their angles by the plan's names, where there is one."""
    import polars as pl

    comments = _comments(samples, path, known, plan)
    frame, kept = read_parquet(samples)
    if plan is not None:
        steps = pl.DataFrame(
            [(str(s.name), s.alpha_deg, s.beta_deg) for s in plan.steps],
            schema={"position": pl.String, "alpha_deg": pl.Float64, "beta_deg": pl.Float64},
            orient="row",
        )
        there = [name for name in ("alpha_deg", "beta_deg") if name in frame.columns]
        frame = frame.drop(there).join(steps, on="position", how="inner", maintain_order="left")
        if not len(frame):
            raise InputError(
                f"{path}: none of its positions is named as one of {known.plan}: {_few(steps['position'])}"
            )
    labels = {name: label for name, label in (("run", known.run), ("mount", known.mount)) if label}
    frame.with_columns(pl.lit(label).alias(name) for name, label in labels.items()).write_parquet(
        samples, metadata={**comments, **({"rate_hz": kept["rate_hz"]} if "rate_hz" in kept else {})}
    )
    return reduce_table(samples, path)


def _few(names) -> str:
    listed = list(names)
    return ", ".join(listed[:8]) + (" ..." if len(listed) > 8 else "")


def _by_stillness(
    path: Path, samples: Path, known: tuple[Known, CapturePlan | None], contents: Contents, criterion: Criterion
) -> RecordingReduction:
    own, plan = known
    if contents.rate_hz is None:
        raise InputError(f"{path}: the sample rate is not known; give --rate 100 (Hz), or --columns time=...")
    columns = scan_parquet(samples)[0].collect_schema().names()
    channels = [name for role in (*FORCE, *RATE) for name in columns if name.startswith(f"{role}_")]
    blocks = blocks_of(samples, channels, contents.rate_hz, timed="time_s" in columns)
    if plan is not None and plan.dwell.guard_s:
        criterion = replace(criterion, guard_s=max(criterion.guard_s, plan.dwell.guard_s))
    stillness = still_intervals(blocks, criterion)
    comments = _comments(samples, path, own, plan)
    gravity = stated_gravity(comments, str(path)) or STANDARD
    unit = channels[0].rpartition("_")[2]
    to_g = {"g": 1.0, "mg": 1e-3, "ms2": 1 / gravity.value_ms2}[unit]
    _check_still(path, stillness, to_g)
    match = None
    if plan is not None:
        match = matched(np.array([interval.mean for interval in stillness.used]), plan)
        stillness = _without_surplus(path, stillness, match)
        match = replace(match, positions=match.positions[match.positions >= 0])
    dwells, warmth = _samples_of(samples, stillness, channels[:3])
    data = _position_set(path, stillness, own, plan, match)
    readings = np.array([dwell.mean(0) for dwell in dwells]) * to_g
    alpha, beta = (data.alpha_deg, data.beta_deg) if plan is not None else attitudes_of(readings)
    enough_samples(path, data.names, dwells)
    counts = np.array([len(dwell) for dwell in dwells], float)
    data = replace(
        data, readings=readings, alpha_deg=alpha, beta_deg=beta, n=counts, temperature_degc=warmth, comments=comments
    )
    recording = sha256_of(path, 0, path.stat().st_size)[:16] if path.is_file() else path.name
    table = reduction_of(data, [dwell * to_g for dwell in dwells], contents.rate_hz, recording)
    return RecordingReduction(table, contents, stillness, match, plan)


def _check_still(path: Path, stillness: Stillness, to_g: float) -> None:
    if not len(stillness.noise):
        raise NothingStill(f"{path}: {len(stillness.blocks) / 10:.1f} s are too short to tell what is still")
    if not stillness.dof.any():
        noise_mg = float(stillness.noise[:3].max()) * to_g * 1e3
        raise NothingStill(
            f"{path}: nothing lies still: even in its quietest second the accelerations scatter by {noise_mg:.0f} mg",
            stillness,
        )
    if not stillness.used:
        reasons = "; ".join(f"{one.start_s:.1f} s: {one.reason}" for one in stillness.intervals[:3])
        raise NothingStill(
            f"{path}: no interval lies still long enough ({reasons or 'all moves'}); see --least-s", stillness
        )


def _without_surplus(path: Path, stillness: Stillness, match: PlanMatch) -> Stillness:
    """The intervals that are no position of the plan, refused with their angle to the nearest."""
    if not (match.positions >= 0).any():
        raise NothingStill(
            f"{path}: none of {len(stillness.used)} still intervals looks like a position of the plan (nearest: "
            f"{match.angle_deg.min():.0f} deg off); is mount_rotation_deg of the plan right?",
            stillness,
        )
    reasons = {
        stillness.used[k].start: f"surplus: no position of the plan, the nearest is {match.angle_deg[k]:.0f} deg off"
        for k in match.surplus
    }
    told = [replace(one, reason=one.reason or reasons.get(one.start, "")) for one in stillness.intervals]
    return replace(stillness, intervals=told)


def _samples_of(
    samples: Path, stillness: Stillness, force: list[str]
) -> tuple[list[NDArray[np.float64]], NDArray[np.float64] | None]:
    """The accelerations (n, 3) of each interval used, without knocks and outliers, and its mean temperature."""
    warm = "temperature_degc" in scan_parquet(samples)[0].collect_schema()
    parts: list[list[NDArray[np.float64]]] = [[] for _ in stillness.used]
    alone = stillness.blocks.outliers
    for first, table in pieces_of(samples, [*force, *(["temperature_degc"] if warm else [])]):
        for part, interval in zip(parts, stillness.used, strict=True):
            start, stop = max(interval.start, first), min(interval.stop, first + len(table))
            if start >= stop:
                continue
            kept = np.ones(stop - start, bool)
            kept[alone[(alone >= start) & (alone < stop)] - start] = False
            for from_row, to_row in interval.knocks:
                kept[max(from_row - start, 0) : max(to_row - start, 0)] = False
            part.append(table[start - first : stop - first][kept])
    whole = [np.concatenate(part) for part in parts]
    warmth = (
        np.array([np.nanmean(part[:, 3]) if np.isfinite(part[:, 3]).any() else np.nan for part in whole])
        if warm
        else None
    )
    known = None if warmth is None or not np.isfinite(warmth).all() else warmth
    return [np.ascontiguousarray(part[:, :3]) for part in whole], known


def _position_set(
    path: Path, stillness: Stillness, known: Known, plan: CapturePlan | None, match: PlanMatch | None
) -> PositionSet:
    """Names, angles, times and labels of the intervals; their readings are put in later."""
    used = stillness.used
    middle = np.array([(one.start_s + one.stop_s) / 2 for one in used])
    zeros = np.zeros(len(used))
    run = known.run or (plan.session.run if plan and plan.session.run != "1" else "")
    mount = known.mount or (plan.session.mount if plan and plan.session.mount != "1" else "")
    names, alpha, beta = tuple(f"p{k + 1}" for k in range(len(used))), zeros, zeros
    approach: NDArray[np.float64] | None = None
    if plan is not None and match is not None:
        steps = [plan.steps[k] for k in match.positions]
        names = names_of([str(step.name) for step in steps])
        alpha, beta = np.array([s.alpha_deg for s in steps], float), np.array([s.beta_deg for s in steps], float)
        if all(step.approach is not None for step in steps):
            approach = np.array([step.approach for step in steps], float)
    return PositionSet(
        names=names,
        alpha_deg=alpha,
        beta_deg=beta,
        readings=np.zeros((len(used), 3)),
        run=(run,) * len(used) if run else None,
        mount=(mount,) * len(used) if mount else None,
        time_s=middle,
        approach=approach,
        source=str(path),
    )


def one_attitude(intervals: list[Interval]) -> bool:
    """Whether all intervals show gravity from about the same side."""
    means = np.array([interval.mean for interval in intervals])
    unit = means / np.linalg.norm(means, axis=1, keepdims=True)
    return bool(np.degrees(np.arccos(np.clip(unit @ unit[0], -1, 1))).max() < _ONE_ATTITUDE_DEG)


def means_of(path: Path, known: Known, asked: Asked = Asked()) -> PositionSet:
    """A table that holds a mean a row: spreadsheets, .mat files and text of any layout.

    **Raises:** `InputError` for a table without accelerations, or with positions that the plan does not know.
    """
    with TemporaryDirectory() as folder:
        samples = Path(folder) / "means.parquet"
        write_samples(path, samples, asked, by=known.by, in_force_units=True)
        plan = None if known.plan is None else read_plan(known.plan)
        comments = _comments(samples, path, replace(known, hand_held=True), plan)
        raw = read_raw(samples)
        gravity = stated_gravity(comments, str(path))
        readings = raw.readings if gravity is None or not raw.in_ms2 else raw.in_g_of(gravity).readings
        labels = raw.frame["position"].to_list() if "position" in raw.frame.columns else None
        names = tuple(map(str, labels)) if labels else tuple(f"p{k + 1}" for k in range(len(readings)))
        alpha, beta = attitudes_of(readings)
        if {"alpha_deg", "beta_deg"} <= set(raw.frame.columns) and plan is None:
            alpha, beta = raw.numbers("alpha_deg"), raw.numbers("beta_deg")
            comments.pop(ATTITUDES, None)
        if plan is not None:
            names, alpha, beta = _in_plan(path, names if labels else None, readings, plan)
        return PositionSet(
            names=names,
            alpha_deg=alpha,
            beta_deg=beta,
            readings=readings,
            run=(known.run,) * len(names) if known.run else None,
            mount=(known.mount,) * len(names) if known.mount else None,
            temperature_degc=raw.temperature_degc(),
            comments=comments,
            source=str(path),
        )


def _in_plan(
    path: Path, names: tuple[str, ...] | None, readings: NDArray[np.float64], plan: CapturePlan
) -> tuple[tuple[str, ...], NDArray[np.float64], NDArray[np.float64]]:
    """Names and angles of means, by their names or else by their directions."""
    by_name = {str(step.name): k for k, step in enumerate(plan.steps)}
    positions = (
        matched(readings, plan).positions if names is None else np.array([by_name.get(name, -1) for name in names])
    )
    strange = np.flatnonzero(positions < 0)
    if len(strange):
        raise InputError(
            f"{path}: row {strange[0] + 1}: no position of the plan ({len(strange)} such rows); remove them"
        )
    steps = [plan.steps[k] for k in positions]
    alpha, beta = np.array([s.alpha_deg for s in steps], float), np.array([s.beta_deg for s in steps], float)
    return names_of([str(step.name) for step in steps]), alpha, beta
