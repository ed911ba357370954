"""Places of several files of one recording: from a table, or of a plan with the names of the files."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.cells import labels_in, number_in
from tumblecal.data.files import csv_table
from tumblecal.data.table import Table
from tumblecal.ground.counted import shortened
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.dwells.file_names import stems_of
from tumblecal.recordings.dwells.place import Place


_MOST = 4
_OPTION = "give a table of the files, --table files.csv, with the columns file, position, alpha_deg and beta_deg"
_ANGLES = ("alpha_deg", "beta_deg")


@dataclass(frozen=True)
class FilePlaces:
    """The place of each file, and the evidence `by`, in words ("" if it is columns of the files)."""

    files: tuple[Path, ...]
    places: tuple[Place, ...]
    by: str = ""

    @property
    def known(self) -> bool:
        """Whether the angles of all are known."""
        return all(place.known for place in self.places)

    def words(self) -> list[str]:
        """A line for each file: file, position, angles."""
        if not self.by:
            return []
        some = any(place.known for place in self.places)
        rows = [
            (str(file), place.name if place.known or not some else "?", *_angle_words(place))
            for file, place in zip(self.files, self.places, strict=True)
        ]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        first = f"positions of {len(rows)} files, by {self.by}; --table files.csv overrides this:"
        return [first, *("  " + line for line in lines)]


def _angle_words(place: Place) -> tuple[str, str]:
    return (f"alpha {place.alpha_deg:g}", f"beta {place.beta_deg:g}") if place.known else ("", "")


def places_by_names(files: Sequence[Path], plan: CapturePlan | None, *, hand_held: bool) -> FilePlaces:
    """The positions of a plan that have the names of the files. Without a plan, attitudes are unknown, each file is a position;
    so they are if no file has the name of a position.

    **Raises:** `InputError` if only some files have the name of a position, with all places as its notes.
    """
    unknown = FilePlaces(tuple(files), tuple(Place(stem) for stem in stems_of(files)), "their names, attitudes unknown")
    if plan is None or hand_held:
        return unknown
    steps = {str(step.name).casefold(): k for k, step in enumerate(plan.steps)}
    found = [steps.get(file.stem.casefold()) for file in files]
    lacking = [file.name for file, step in zip(files, found, strict=True) if step is None]
    if len(lacking) == len(files):
        by = "the direction of gravity, as no file has the name of a position of the plan"
        return replace(unknown, by=by)
    placed = tuple(
        place if step is None else place.at_step(plan, step) for place, step in zip(unknown.places, found, strict=True)
    )
    places = replace(unknown, places=placed, by="the plan's names")
    if lacking:
        fault = InputError(
            f"{shortened(lacking, _MOST)}: not the name of a position of the plan; rename or remove, or {_OPTION}"
        )
        fault.add_note("\n".join(places.words()))
        raise fault
    return places


def places_by_table(files: Sequence[Path], path: Path, plan: CapturePlan | None) -> FilePlaces:
    """The places of files by a table.

    **Raises:** `InputError` for a table without them, for files that it does not list, or lists twice, and for cells that are
    not angles, or not positions of the plan.
    """
    table = csv_table(path).with_points()
    name = next((name for name in ("position", "name") if name in table.columns), "")
    angles = [angle for angle in _ANGLES if angle in table.columns]
    lacking = [] if "file" in table.columns else ["file"]
    if not angles and not name:
        lacking.append("position, or alpha_deg and beta_deg")
    elif len(angles) == 1:
        lacking += [angle for angle in _ANGLES if angle not in angles]
    if lacking:
        raise InputError(f"{path}: column {' and '.join(lacking)} is missing; write a row for each file")
    rows = [_row_of(table, file) for file in files]
    for k, row in enumerate(rows):
        if rows.index(row) < k:
            raise InputError(
                f"{path}: one row fits {files[rows.index(row)]} and a second file; write one row for each, with its folder"
            )
    places = tuple(_at_row(table, row, file, name, plan) for row, file in zip(rows, files, strict=True))
    return FilePlaces(tuple(files), places, f"the table {path}")


def _row_of(table: Table, file: Path) -> int:
    """The row of a file: the longest listed end of its path, with or without the suffix of the format."""
    listed = [Path(text.replace("\\", "/")).parts for text in labels_in(table.columns["file"])]
    listed = [tuple(part for part in parts if part != ".") for parts in listed]
    ends = [(*file.absolute().parts[:-1], name) for name in (file.name, file.stem)]
    rows = [row for row, parts in enumerate(listed) if parts and any(end[-len(parts) :] == parts for end in ends)]
    most = max((len(listed[row]) for row in rows), default=0)
    rows = [row for row in rows if len(listed[row]) == most]
    if not rows:
        raise InputError(f"{table.source}: column file does not list {file}; add its row, or remove the file")
    if len(rows) > 1:
        lines = " and ".join(str(table.lines[row]) for row in rows)
        raise InputError(f"{table.source}: lines {lines} both fit {file}; keep one")
    return rows[0]


def _at_row(table: Table, row: int, file: Path, name: str, plan: CapturePlan | None) -> Place:
    labels = {key: labels_in(table.columns[key])[row] for key in (name, "run", "mount") if key in table.columns}
    place = Place(labels.get(name) or file.stem, run=labels.get("run", ""), mount=labels.get("mount", ""))
    if _ANGLES[0] in table.columns:
        values = {}
        for column in _ANGLES:
            values[column], wrong = number_in(table.columns[column][row], column)
            if not np.isfinite(values[column]):
                raise InputError(f"{table.place(row, column)}: {wrong}")
        return replace(place, **values)
    if plan is None:
        return place
    steps = [k for k, step in enumerate(plan.steps) if str(step.name) == place.name]
    if not steps:
        there = ", ".join(str(step.name) for step in plan.steps[:8])
        raise InputError(f"{table.place(row, name)}: {shown(place.name)} is not a position of the plan: {there} ...")
    return place.at_step(plan, steps[0])
