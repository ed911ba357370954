"""Places of several files of one recording: from a table, or of a plan with the names of the files."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.data.cells import labels_in, number_in
from tumblecal.data.files import csv_table
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import shortened
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
        lines = [f"positions of {len(self.files)} files, by {self.by}; --table files.csv overrides this:"]
        for file, place in zip(self.files, self.places, strict=True):
            angles = f"  alpha {place.alpha_deg:g}  beta {place.beta_deg:g}" if place.known else ""
            lines.append(f"  {file}  {'?' if some and not angles else place.name}{angles}")
        return lines


def places_by_names(files: Sequence[Path], plan: CapturePlan | None, *, hand_held: bool) -> FilePlaces:
    """The positions of a plan that have the names of the files. Without a plan, attitudes are unknown, each file is a position;
    so they are if no file has the name of a position.

    **Raises:** `InputError` if only some files have the name of a position, with all places as its notes.
    """
    unknown = FilePlaces(tuple(files), tuple(map(Place, stems_of(files))), "their names, attitudes unknown")
    if plan is None or hand_held:
        return unknown
    steps = {str(step.name).casefold(): k for k, step in enumerate(plan.steps)}
    found = [steps.get(file.stem.casefold(), -1) for file in files]
    if max(found) < 0:
        return replace(unknown, by="the direction of gravity, as no file has the name of a position of the plan")
    placed = (Place("?") if step < 0 else Place("").at_step(plan, step) for step in found)
    places = FilePlaces(tuple(files), tuple(placed), "the plan's names")
    if not places.known:
        lacking = [file.name for file, step in zip(files, found, strict=True) if step < 0]
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
    with_angles = not name or any(angle in table.columns for angle in _ANGLES)
    if lacking := [one for one in ("file", *_ANGLES[: 2 * with_angles]) if one not in table.columns]:
        raise InputError(
            f"{path}: column {' and '.join(lacking)} is missing; write a row for each file, with the columns file and "
            "position, or alpha_deg and beta_deg"
        )
    listed = ["/" + text.replace("\\", "/").removeprefix("./") for text in labels_in(table.columns["file"])]
    names, runs, mounts = (labels_in(table.columns.get(key, [""] * len(listed))) for key in (name, "run", "mount"))
    steps = {str(step.name): k for k, step in enumerate(plan.steps if plan else ())}
    places, rows = list[Place](), list[int]()
    for file in files:
        # A row has the end of a path, with or without the suffix of the format.
        ends = [f"/{one.absolute().as_posix()}" for one in (file, file.with_suffix(""))]
        fits = [row for row, text in enumerate(listed) if text != "/" and any(end.endswith(text) for end in ends)]
        if len(fits) != 1 or fits[0] in rows:
            lines = f"line {', '.join(str(table.lines[row]) for row in fits)}" if fits else "no line"
            raise InputError(
                f"{table.source}: column file: {lines} for {file}; write one row for each file, with its folder"
            )
        row = fits[0]
        rows.append(row)
        place = Place(names[row] or file.stem, run=runs[row], mount=mounts[row])
        if with_angles:
            values = {}
            for column in _ANGLES:
                values[column], wrong = number_in(table.columns[column][row], column)
                if not np.isfinite(values[column]):
                    raise InputError(f"{table.place(row, column)}: {wrong}")
            place = replace(place, **values)
        elif plan is not None and place.name in steps:
            place = place.at_step(plan, steps[place.name])
        elif plan is not None:
            raise InputError(
                f"{table.place(row, name)}: {shown(place.name)} is not a position of the plan: {', '.join([*steps][:8])} ..."
            )
        places.append(place)
    return FilePlaces(tuple(files), tuple(places), f"the table {path}")
