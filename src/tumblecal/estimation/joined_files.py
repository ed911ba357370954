"""Position files that are joined into one measurement: their runs, mountings and clocks."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.chain.rig import Rig
from tumblecal.data import PositionSet
from tumblecal.data.joined import joined, unused, with_separate_runs
from tumblecal.data.joined_clocks import joined_clocks
from tumblecal.estimation.mountings import EQUAL, FEWEST, distances, nearest_turns
from tumblecal.estimation.planned_positions import indexed_by_visit
from tumblecal.ground.errors import InputError
from tumblecal.words import sentences


def joined_files(
    parts: Sequence[PositionSet], rig: Rig | None, pauses: Sequence[str] = (), *, same_run: bool = False
) -> tuple[PositionSet, list[str]]:
    """The positions of all files, and words on runs and pauses.

    **Arguments:**

    - `pauses`: as of `joined_clocks`. `same_run`: whether all files without a column run are one run.

    **Raises:** `InputError` for files that do not belong together.
    """
    serials = {part.serial_number: part.source for part in parts if part.serial_number}
    if len(serials) > 1:
        listed = ", ".join(f"{source} {serial}" for serial, source in serials.items())
        raise InputError(f"--join: serial numbers differ ({listed}); join the files of one unit only")
    planned = indexed_by_visit(rig)
    parts = list(parts) if rig else with_distinct_mounts(parts)
    parts = parts if same_run or planned else with_separate_runs(parts)
    clocks = joined_clocks(parts, pauses)
    whole, words = joined(parts, clocks), [*(clocks.words if clocks else ())]
    if len(parts) < 2 or (whole.run is None and (whole.mount is not None or planned)):
        return whole, words  # each file has its own mounting, or all are those of a designed plan
    runs = None if whole.run is None else list(dict.fromkeys(whole.run))
    return whole, [*sentences("positions/runs", runs=runs, files=len(parts)), *words]


def possible_turns(data: PositionSet) -> frozenset[int]:
    """Numbers of the quarter turns that fit all readings of a set about equally well, with 24 added for mirrored
    axes; all 48 if the set is short."""
    proper, mirrored = distances(data, np.ones(len(data), bool))
    count = len(proper)
    if len(data) < FEWEST:
        return frozenset(range(2 * count))
    if proper.min() <= mirrored.min() + EQUAL:
        return nearest_turns(proper)
    return frozenset(count + number for number in nearest_turns(mirrored))


def with_distinct_mounts(sets: Sequence[PositionSet]) -> list[PositionSet]:
    """Sets to be joined. A set gets a new mount label, the name of its file, if the orientation of its triad differs from that
    of the previous set with the same label."""
    now: dict[str, tuple[str, frozenset[int]]] = {}
    used = {label for data in sets for label in data.mount or ("1",)}
    named: list[PositionSet] = []
    for data in sets:
        labels = list(data.labels("mount"))
        for label in dict.fromkeys(labels):
            possible = possible_turns(data.chosen([other == label for other in labels]))
            name, before = now.get(label, (label, possible))
            if not possible & before:
                stem = Path(data.source).stem
                name, before = unused(stem if data.mount is None else f"{label} of {stem}", used), possible
                used.add(name)
            now[label] = (name, possible & before)
        new = tuple(now[label][0] for label in labels)
        named.append(replace(data, mount=new) if list(new) != labels else data)
    return named
