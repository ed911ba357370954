"""Positions of several files of one recording: from a table, or of a plan with the names of the files."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.cells import labels_in, number_in
from tumblecal.data.files import csv_table
from tumblecal.data.table import Table
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.reduction.file_names import stems_of


_MOST = 4
_OPTION = "give a table of the files, --table files.csv, with the columns file, position, alpha_deg and beta_deg"


@dataclass(frozen=True)
class FilePosition:
    """The position of a file: its name, its angles, deg (None if unknown), labels of run and mounting, the plan's index."""

    file: Path
    name: str
    alpha_deg: float | None = None
    beta_deg: float | None = None
    approach: int | None = None
    run: str = ""
    mount: str = ""
    step: int | None = None

    @property
    def known(self) -> bool:
        """Whether its angles are known."""
        return self.alpha_deg is not None


@dataclass(frozen=True)
class FilePositions:
    """The positions of all files and their evidence `by`, in words ("" if it is columns of the files).

    `fault`: why they cannot be used, with the option that resolves it; "" if they can.
    """

    files: tuple[FilePosition, ...]
    by: str
    fault: str = ""

    @property
    def known(self) -> bool:
        """Whether the angles of all are known."""
        return all(position.known for position in self.files)

    def words(self) -> list[str]:
        """A line for each file: file, position, angles."""
        if not self.by:
            return []
        some = any(position.known for position in self.files)
        rows = [
            (str(position.file), position.name if position.known or not some else "?", *_angle_words(position))
            for position in self.files
        ]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        return [
            f"positions of {len(rows)} files, by {self.by}; --table files.csv overrides this:",
            *("  " + x for x in lines),
        ]


def _angle_words(position: FilePosition) -> tuple[str, ...]:
    if position.alpha_deg is None or position.beta_deg is None:
        return ("", "")
    return f"alpha {position.alpha_deg:g}", f"beta {position.beta_deg:g}"


def positions_by_names(files: Sequence[Path], plan: CapturePlan | None, *, hand_held: bool) -> FilePositions:
    """The positions of a plan that have the names of the files. Without a plan, attitudes are unknown, each file is a position.

    If only some files have the name of a position, it is a fault; if none has, the positions are unknown.
    """
    named = tuple(FilePosition(file, stem) for file, stem in zip(files, stems_of(files), strict=True))
    if plan is None or hand_held:
        return FilePositions(named, "their names, attitudes unknown")
    steps = {str(step.name).casefold(): k for k, step in enumerate(plan.steps)}
    found = [steps.get(position.file.stem.casefold()) for position in named]
    if not any(step is not None for step in found):
        return FilePositions(named, "the direction of gravity, as no file has the name of a position of the plan")
    placed = tuple(
        position if step is None else at_step(position, plan, step) for position, step in zip(named, found, strict=True)
    )
    fault, by = "", "the plan's names"
    if lacking := [position.file.name for position in placed if not position.known]:
        more = f" and {len(lacking) - _MOST} more" if len(lacking) > _MOST else ""
        fault = f"{', '.join(lacking[:_MOST])}{more}: not the name of a position of the plan; rename or remove, or {_OPTION}"
    return FilePositions(placed, by, fault)


def at_step(position: FilePosition, plan: CapturePlan, step: int) -> FilePosition:
    """A file at a position of a plan."""
    at = plan.steps[step]
    angles = {"alpha_deg": float(at.alpha_deg), "beta_deg": float(at.beta_deg)}
    return replace(position, name=str(at.name), approach=at.approach, step=step, **angles)


def positions_by_table(files: Sequence[Path], path: Path, plan: CapturePlan | None) -> FilePositions:
    """The positions of files by a table.

    **Raises:** `InputError` for a table without them, for files that it does not list, or lists twice, and for cells that are
    not angles, or not positions of the plan.
    """
    table = csv_table(path).with_points()
    names = next((name for name in ("position", "name") if name in table.columns), None)
    lacking = [] if "file" in table.columns else ["file"]
    angles = [name for name in ("alpha_deg", "beta_deg") if name in table.columns]
    lacking += ["position, or alpha_deg and beta_deg"] if names is None and len(angles) < 2 else []
    lacking += [name for name in ("alpha_deg", "beta_deg") if len(angles) == 1 and name not in angles]
    if lacking:
        raise InputError(f"{path}: column {' and '.join(lacking)} is missing; write a row for each file")
    rows = {row: file for file in files for row in [_row_of(table, file)]}
    if twice := [file for file in files if rows[_row_of(table, file)] != file]:
        raise InputError(f"{path}: one row fits {twice[0]} and a second file; write one row for each, with its folder")
    read = {file: _at_row(table, row, file, names, angles, plan) for row, file in rows.items()}
    return FilePositions(tuple(read[file] for file in files), f"the table {path}")


def _row_of(table: Table, file: Path) -> int:
    """The row of a file: the longest listed end of its path, with or without the suffix of the format."""
    listed = [Path(text.replace("\\", "/")) for text in labels_in(table.columns["file"])]

    def fits(listed_path: Path) -> bool:
        parts = [part for part in listed_path.parts if part != "."]
        ends = [(*file.absolute().parts[:-1], name) for name in (file.name, file.stem)]
        return any(end[-len(parts) :] == tuple(parts) for end in ends) if parts else False

    rows = [row for row, path in enumerate(listed) if fits(path)]
    most = max((len(listed[row].parts) for row in rows), default=0)
    rows = [row for row in rows if len(listed[row].parts) == most]
    if len(rows) == 1:
        return rows[0]
    if not rows:
        raise InputError(f"{table.source}: column file does not list {file}; add its row, or remove the file")
    lines = " and ".join(str(table.lines[row]) for row in rows)
    raise InputError(f"{table.source}: lines {lines} both fit {file}; keep one")


def _at_row(
    table: Table, row: int, file: Path, names: str | None, angles: Sequence[str], plan: CapturePlan | None
) -> FilePosition:
    labels = {
        name: labels_in(table.columns[name])[row] for name in (names, "run", "mount") if name and name in table.columns
    }
    name = labels.get(names, "") if names else ""
    position = FilePosition(file, name or file.stem, run=labels.get("run", ""), mount=labels.get("mount", ""))
    if angles:
        values = []
        for column in angles:
            value, wrong = number_in(table.columns[column][row], column)
            if not np.isfinite(value):
                raise InputError(f"{table.place(row, column)}: {wrong}")
            values.append(value)
        return replace(position, alpha_deg=values[0], beta_deg=values[1])
    if plan is None:
        return position
    steps = [k for k, step in enumerate(plan.steps) if str(step.name) == name]
    if not steps:
        there = ", ".join(str(step.name) for step in plan.steps[:8])
        raise InputError(f"{table.place(row, names or '')}: {shown(name)} is not a position of the plan: {there} ...")
    return at_step(position, plan, steps[0])
