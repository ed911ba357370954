"""Reduction of several files of one recording, one for each position or face, to position means."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.capture_plan import CapturePlan, names_of
from tumblecal.capture.journal import sha256_of
from tumblecal.data.parquet import scan_parquet
from tumblecal.ground.atomic import scratch_folder
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.gravity import stated_gravity, unit_in_g
from tumblecal.recordings.guesses import guessed
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.reduction.file_positions import FilePosition, FilePositions, at_step
from tumblecal.recordings.reduction.file_stream import FilePart, guesses_of, rate_of_files, with_clocks, write_files
from tumblecal.recordings.reduction.means_at_rest import check_still, reduced_at_rest, stillness_of
from tumblecal.recordings.reduction.plan_match import matched
from tumblecal.recordings.reduction.reduce_recording import reduce_by_name, run_and_mount, stated_comments
from tumblecal.recordings.reduction.reduction import Reduction
from tumblecal.recordings.reduction.still_by_file import (
    check_lengths,
    one_attitude_each,
    part_of,
    within_files,
    without_still,
)
from tumblecal.recordings.still.intervals import Interval
from tumblecal.recordings.still.stillness import Stillness


# Directions closer than this are equal for gravity.
_SAME_DEG = 1.0
# If readings contradict the angles of their files by more than this (g), after scale, axes and bias, files are exchanged.
_LARGEST_MISFIT = 0.15
_FEWEST_FOR_MISFIT = 6


@dataclass(frozen=True)
class FilesReduction:
    """A reduction of several files: their `parts` of the samples, their `positions`, the intervals at rest.

    `clock_words`: relation of their clocks. `doubts`: files to be checked, with reasons.
    """

    table: Reduction
    parts: Sequence[FilePart]
    positions: Sequence[FilePosition]
    clock_words: str
    doubts: Sequence[tuple[str, str]] = ()
    stillness: Stillness | None = None
    by_gravity: bool = False

    @property
    def read(self) -> list[tuple[str, Recording]]:
        """The files and their contents."""
        return [(str(part.file), part.contents) for part in self.parts]

    @property
    def warnings(self) -> list[tuple[str, list[str]]]:
        """Warnings for each file, and for all."""
        lines = [(file, contents.damage.lines) for file, contents in self.read]
        return [*lines, *((file, [line]) for file, line in self.doubts)]

    def as_dict(self) -> Mapping[str, object]:
        """Files and intervals for reduction.json."""
        entries: dict[str, object] = {"files": [self._of_file(part) for part in self.parts], "clocks": self.clock_words}
        return entries if self.stillness is None else entries | self.stillness.as_dict()

    def _of_file(self, part: FilePart) -> dict[str, object]:
        position = next((position for position in self.positions if position.file == part.file), None)
        entries = {"file": str(part.file), "position": position and position.name, "rows": part.stop - part.start}
        return entries | {"starts_at_s": part.base_s} | part.contents.entries


def reduce_files(
    positions: FilePositions,
    context: KnownContext,
    plan: CapturePlan | None,
    options: RecordingOptions,
    criterion: Criterion,
) -> FilesReduction:
    """Reduce several files as one recording.

    **Arguments:**

    - `positions`: positions of the files; if none has angles and there is a `plan`, they follow from gravity.
    - others: as for `reduce_recording`.

    **Raises:** `InputError` for files that cannot be read or are not of one recording; `NothingStill` without an interval at
    rest.
    """
    files = [position.file for position in positions.files]
    source = Path(f"{files[0]} and {len(files) - 1} more")
    with scratch_folder(source) as folder:
        samples, parts = write_files(files, folder, options, by=context.by)
        columns = set(scan_parquet(samples, check=False)[0].collect_schema())
        asked_for = context.static or context.table is not None or plan is not None
        if context.by or ({"position", "alpha_deg"} & columns and not asked_for):
            table = reduce_by_name(source, samples, context, plan, {})
            data, words = with_clocks(table.data, parts)
            return FilesReduction(replace(table, data=data), parts, (), words)
        with guessed(guesses_of([part.contents for part in parts])):
            return _by_file(source, samples, parts, positions, context, plan, criterion)


def _by_file(
    source: Path,
    samples: Path,
    parts: list[FilePart],
    positions: FilePositions,
    context: KnownContext,
    plan: CapturePlan | None,
    criterion: Criterion,
) -> FilesReduction:
    rate = rate_of_files(parts)
    stillness = within_files(stillness_of(samples, rate, criterion, plan), parts)
    hand_held = context.static or (plan is None and not positions.known)
    comments = stated_comments(samples, source, plan, hand_held=hand_held)
    to_g = unit_in_g(stillness.blocks.unit, stated_gravity(comments, str(source)))
    check_lengths(parts, criterion)
    check_still(source, stillness, to_g)
    of_part = [next(position for position in positions.files if position.file == part.file) for part in parts]
    if not hand_held:
        stillness = one_attitude_each(stillness, parts)
    doubts = without_still(stillness, parts)
    rows = [part_of(interval, parts) for interval in stillness.used]
    by_gravity = not hand_held and not positions.known
    if by_gravity:
        assert plan is not None
        of_part, more = _by_gravity(stillness, rows, of_part, plan)
        doubts += more
        surplus = {one.start for one, k in zip(stillness.used, rows, strict=True) if not of_part[k].known}
        stillness = stillness.rejecting(dict.fromkeys(surplus, "surplus: not a position of the plan"))
        rows = [k for k in rows if of_part[k].known]
        check_still(source, stillness, to_g)
    placed = [of_part[k] for k in rows]
    alpha, beta = (None, None) if hand_held else _angles(placed)
    approaches = [position.approach for position in placed]
    approach = None if hand_held or None in approaches else np.array(approaches, float)
    attitudes = names_of([position.name for position in placed]), alpha, beta, approach
    labels = {"comments": comments, "clock": tuple(str(k + 1) for k in rows)} | _labels(placed, context, plan)
    digests = "".join(sha256_of(part.file) if part.file.is_file() else part.file.name for part in parts)
    recording = hashlib.sha256(digests.encode()).hexdigest()[:16]
    table = reduced_at_rest(source, samples, stillness, to_g, attitudes, labels, rate, recording)
    if not hand_held:
        _check_exchanged(placed, table.data.readings, positions, doubts)
    data, words = with_clocks(table.data, parts)
    return FilesReduction(replace(table, data=data), parts, of_part, words, doubts, stillness, by_gravity)


def _angles(placed: Sequence[FilePosition]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.array([position.alpha_deg for position in placed], float), np.array(
        [position.beta_deg for position in placed], float
    )


def _labels(
    placed: Sequence[FilePosition], context: KnownContext, plan: CapturePlan | None
) -> dict[str, tuple[str, ...] | None]:
    """Run and mount of each row: from its file, or common to all."""
    usual = run_and_mount(context, plan, len(placed))
    labels = {}
    for name in ("run", "mount"):
        values = tuple(getattr(position, name) for position in placed)
        default = usual[name] or ("1",) * len(placed)
        labels[name] = tuple(a or b for a, b in zip(values, default, strict=True)) if any(values) else usual[name]
    return labels


def _by_gravity(
    stillness: Stillness, rows: Sequence[int], of_part: list[FilePosition], plan: CapturePlan
) -> tuple[list[FilePosition], list[tuple[str, str]]]:
    """The plan's position of each file, by its longest interval at rest."""
    longest: dict[int, Interval] = {}
    for interval, number in zip(stillness.used, rows, strict=True):
        if number not in longest or interval.stop - interval.start > longest[number].stop - longest[number].start:
            longest[number] = interval
    match = matched(np.array([interval.mean for interval in longest.values()]), plan)
    found = dict(zip(longest, match.positions.tolist(), strict=True))
    _check_separable(plan, {k: of_part[part].file for part, k in found.items() if k >= 0})
    placed = [
        at_step(position, plan, found[k]) if found.get(k, -1) >= 0 else position for k, position in enumerate(of_part)
    ]
    surplus = [str(position.file) for k, position in enumerate(placed) if k in found and not position.known]
    words = [(file, "not a position of the plan, by the direction of gravity") for file in surplus]
    if match.missing:
        words.append((str(placed[0].file), f"and the other files lack position {', '.join(match.missing)} of the plan"))
    return placed, words


def _check_separable(plan: CapturePlan, files: Mapping[int, Path]) -> None:
    """Check that gravity determines the position of each file: all alpha at beta 90 are one direction.

    **Raises:** `InputError` for a file that fits several positions.
    """
    expected = np.array([plan.expected(k) for k in range(len(plan.steps))])
    angles = [(step.alpha_deg, step.beta_deg) for step in plan.steps]
    for step, file in files.items():
        same_direction = np.flatnonzero(expected @ expected[step] > np.cos(np.radians(_SAME_DEG)))
        others = [str(plan.steps[k].name) for k in same_direction if angles[k] != angles[step]]
        if others:
            raise InputError(
                f"{file}: gravity cannot separate position {plan.steps[step].name} of the plan from {', '.join(others[:4])}; "
                "name the files like the positions, or give --table files.csv"
            )


def _check_exchanged(
    placed: Sequence[FilePosition],
    readings: NDArray[np.float64],
    positions: FilePositions,
    doubts: list[tuple[str, str]],
) -> None:
    """Compare the readings with the angles of their files: scale factors, axes and biases explain them, unless files are
    exchanged; then a doubt is added.
    """
    if len(placed) < _FEWEST_FOR_MISFIT:
        return
    alpha, beta = _angles(placed)
    design = np.column_stack([gravity_in_head(np.radians(alpha), np.radians(beta)), np.ones(len(placed))])
    if np.linalg.cond(design) > 100:
        return
    solution, *_ = np.linalg.lstsq(design, readings, rcond=None)
    misfit = np.linalg.norm(readings - design @ solution, axis=1)
    turned = np.linalg.det(solution[:3]) < 0
    if misfit.max() < _LARGEST_MISFIT and not turned:
        return
    worst = placed[int(misfit.argmax())].file
    how = "mirrored" if turned else f"in error by up to {misfit.max():.2f} g ({worst})"
    words = f"gravity contradicts the positions by {positions.by}: readings {how}; check whether files are exchanged."
    doubts.append((str(worst), words))
