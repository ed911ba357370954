"""The place of each dwell: of a plan, of a table of files, by the names of files, or unknown; and positions at places."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan, names_of
from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.cells import labels_in, number_in
from tumblecal.data.files import csv_table
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.positions import PositionSet, attitudes_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import shortened
from tumblecal.ground.text_file import shown
from tumblecal.recordings.dwells.file_names import stems_of
from tumblecal.recordings.options import KnownContext


Known = tuple[KnownContext, CapturePlan | None]
ANGLES = ("alpha_deg", "beta_deg")
_MOST = 4
_OPTION = "give a table of the files, --table files.csv, with the columns file, position, alpha_deg and beta_deg"


@dataclass(frozen=True)
class Place:
    """Name of a position; angles in deg, None if unknown; approach; labels of run and mounting."""

    position: str
    alpha_deg: float | None = None
    beta_deg: float | None = None
    approach: float | None = None
    run: str = ""
    mount: str = ""

    @property
    def known(self) -> bool:
        """Whether its angles are known."""
        return self.alpha_deg is not None


def places_of(plan: CapturePlan | None) -> list[Place]:
    """The positions of a plan; none without one."""
    steps = plan.steps if plan else ()
    return [Place(str(step.name), float(step.alpha_deg), float(step.beta_deg), step.approach) for step in steps]


def position_set(
    source: str,
    readings: Floats,
    places: Sequence[Place],
    comments: Mapping[str, str],
    known: Known = (KnownContext(), None),
    **columns: Any,
) -> PositionSet:
    """Readings (positions, 3) in g at these places.

    With the comment of unknown attitudes, the readings give approximate angles. Labels of a place precede those of the options
    and of the plan, `known`. `columns`: further columns of the set.
    """
    stated = {name: [getattr(place, name) for place in places] for name in Place.__dataclass_fields__}
    hand_held = comments.get(ATTITUDES) == UNKNOWN
    alpha, beta = attitudes_of(readings) if hand_held else (np.array(stated[name], float) for name in ANGLES)
    for name in ("run", "mount"):
        usual = label_of_rows(known, name)
        some = usual != "1" or any(stated[name])
        columns[name] = tuple(label or usual for label in stated[name]) if some else None
    return PositionSet(
        names_of(stated["position"]),
        alpha,
        beta,
        readings,
        approach=None if hand_held or None in stated["approach"] else np.array(stated["approach"], float),
        comments=dict(comments),
        source=source,
        **columns,
    )


def label_of_rows(known: Known, name: str) -> str:
    """The label of `run` or `mount` for all rows: by option, otherwise by the plan; "1" if neither states it."""
    context, plan = known
    return getattr(context, name) or (getattr(plan.session, name) if plan else "1")


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
        lines = [f"positions of {len(self.files)} files, by {self.by}; --table files.csv overrides this:"]
        for file, place in zip(self.files, self.places, strict=True):
            angles = f"  alpha {place.alpha_deg:g}  beta {place.beta_deg:g}" if place.known else ""
            lines.append(f"  {file}  {place.position}{angles}")
        return lines


def places_by_names(files: Sequence[Path], plan: CapturePlan | None, *, hand_held: bool) -> FilePlaces:
    """The positions of a plan that have the names of the files. Without a plan, attitudes are unknown, each file is a position;
    so they are if no file has the name of a position.

    **Raises:** `InputError` if only some files have the name of a position, with all places as its notes.
    """
    steps = {} if hand_held else {place.position.casefold(): place for place in places_of(plan)}
    places = tuple(steps.get(file.stem.casefold(), Place("?")) for file in files)
    if lacking := [file.name for file, place in zip(files, places, strict=True) if not place.known]:
        found = FilePlaces(tuple(files), places, "the plan's names")
        if len(lacking) < len(files):
            fault = InputError(
                f"{shortened(lacking, _MOST)}: not the name of a position of the plan; rename or remove, or {_OPTION}"
            )
            fault.add_note("\n".join(found.words()))
            raise fault
        by = "the direction of gravity, as no file has the name of a position of the plan"
        return replace(
            found, places=tuple(map(Place, stems_of(files))), by=by if steps else "their names, attitudes unknown"
        )
    return FilePlaces(tuple(files), places, "the plan's names")


def places_by_table(files: Sequence[Path], path: Path, plan: CapturePlan | None) -> FilePlaces:
    """The places of files by a table.

    **Raises:** `InputError` for a table without them, for files that it does not list, or lists twice, and for cells that are
    not angles, or not positions of the plan.
    """
    table = csv_table(path).with_points()
    name = next((name for name in ("position", "name") if name in table.columns), "")
    angles = ANGLES if not name or any(angle in table.columns for angle in ANGLES) else ()
    if lacking := [one for one in ("file", *angles) if one not in table.columns]:
        raise InputError(
            f"{path}: column {' and '.join(lacking)} is missing; write a row for each file, with the columns file and "
            "position, or alpha_deg and beta_deg"
        )
    listed = ["/" + text.replace("\\", "/").removeprefix("./") for text in labels_in(table.columns["file"])]
    names, runs, mounts = (labels_in(table.columns.get(key, [""] * len(listed))) for key in (name, "run", "mount"))
    steps = {place.position: place for place in places_of(plan)}
    places = dict[int, Place]()
    for file in files:
        # A row has the end of a path, with or without the suffix of the format.
        ends = [f"/{one.absolute().as_posix()}" for one in (file, file.with_suffix(""))]
        fits = [row for row, text in enumerate(listed) if text != "/" and any(end.endswith(text) for end in ends)]
        if len(fits) != 1 or fits[0] in places:
            lines = f"line {', '.join(str(table.lines[row]) for row in fits)}" if fits else "no line"
            raise InputError(
                f"{table.source}: column file: {lines} for {file}; write one row for each file, with its folder"
            )
        (row,) = fits
        place = Place(names[row] or file.stem)
        for column in angles:
            value, wrong = number_in(table.columns[column][row], column)
            if not np.isfinite(value):
                raise InputError(f"{table.place(row, column)}: {wrong}")
            place = replace(place, **{column: value})
        if steps and not angles:
            if place.position not in steps:
                raise InputError(
                    f"{table.place(row, name)}: {shown(place.position)} is not a position of the plan: "
                    f"{', '.join([*steps][:8])} ..."
                )
            place = steps[place.position]
        places[row] = replace(place, run=runs[row], mount=mounts[row])
    return FilePlaces(tuple(files), tuple(places.values()), f"the table {path}")
