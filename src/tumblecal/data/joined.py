"""Several position sets of one triad on one dividing head, joined into one."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.data.cells import number_in
from tumblecal.data.joined_clocks import JoinedClocks, joined_clocks
from tumblecal.data.position_comments import NOT_CONFIRMED, WITHIN_DWELLS
from tumblecal.data.positions import COLUMNS, LABELS, PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import SAME_MS2


# Prefixes of the comments on faults of a measurement.
FAULTS = (NOT_CONFIRMED, WITHIN_DWELLS)


def with_separate_runs(sets: Sequence[PositionSet]) -> list[PositionSet]:
    """Sets to be joined, with a separate run for each set without a run: named by its file, or by its folder if file names
    are equal. A set that shares no mount with others is unchanged, because its mount separates it already."""
    mounts = [set(given.labels("mount")) for given in sets]
    alone = [not any(mount & other for j, other in enumerate(mounts) if j != k) for k, mount in enumerate(mounts)]
    if len(sets) < 2 or all(alone):
        return list(sets)
    used = {label for given in sets for label in given.run or ()}
    named: list[PositionSet] = []
    for given, name, by_mount in zip(sets, _called(sets), alone, strict=True):
        if given.run is None and not by_mount:
            label = unused(name, used)
            used.add(label)
            given = replace(given, run=(label,) * len(given))
        named.append(given)
    return named


def _called(sets: Sequence[PositionSet]) -> list[str]:
    """A name for each set: its file, or its folder if file names are equal; numbered if folder names are equal too."""
    names = [Path(given.source).stem for given in sets]
    names = names if len(set(names)) == len(names) else [Path(given.source).absolute().parent.name for given in sets]
    called: list[str] = []
    for name in names:
        called.append(unused(name, called))
    return called


def unused(name: str, used: Collection[str], joint: str = " ") -> str:
    """The name, with the first number that makes it different from the used ones."""
    candidates = (name, *(f"{name}{joint}{k}" for k in range(2, len(used) + 3)))
    return next(candidate for candidate in candidates if candidate not in used)


def _names(sets: Sequence[PositionSet]) -> tuple[str, ...]:
    """The names of the positions; a name in several sets gets that of its set as prefix, such as `m1:p0`."""
    times = Counter(name for given in sets for name in set(given.names))
    called = _called(sets)
    return tuple(
        f"{prefix}:{name}" if times[name] > 1 else name
        for prefix, given in zip(called, sets, strict=True)
        for name in given.names
    )


def _comments(sets: Sequence[PositionSet]) -> dict[str, str]:
    """The comments of the first file, and those on faults from all files: joined words, and the largest size."""
    comments = {key: text for key, text in sets[0].comments.items() if not key.startswith(FAULTS)}
    for key in dict.fromkeys(key for given in sets for key in given.comments if key.startswith(FAULTS)):
        by_file = {name: given.comments.get(key, "") for name, given in zip(_called(sets), sets, strict=True)}
        texts = {name: text for name, text in by_file.items() if text}
        sizes = [value for text in texts.values() if np.isfinite(value := number_in(text)[0])]
        if sizes:
            comments[key] = f"{max(sizes):g}"
        elif texts:
            same = len(texts) == len(sets) and len({*texts.values()}) == 1
            comments[key] = (
                next(iter(texts.values())) if same else " ".join(f"{n}: {text}" for n, text in texts.items())
            )
    return comments


def joined(sets: Sequence[PositionSet], clocks: JoinedClocks | None = None) -> PositionSet:
    """The positions of all sets in order, with the times of `clocks` (by default those of `joined_clocks`).

    Position names in several sets get a prefix (`m1:p0`). Runs and mounts without a name are called 1. Time, temperature,
    approach and n are kept if all sets have them.

    **Raises:** `InputError` if only some sets have standard deviations, or if one g differs between sets.
    """
    if len(sets) == 1:
        return sets[0]
    with_sd = [given.sd is not None for given in sets]
    if any(with_sd) and not all(with_sd):
        lacking = ", ".join(given.source for given, has in zip(sets, with_sd, strict=True) if not has)
        raise InputError(f"{lacking}: no sd columns, but other files have them; give all files sd columns, or none")

    values = {given.source: given.gravity.value_ms2 for given in sets if given.gravity}
    if len(values) > 1 and np.ptp(list(values.values())) > SAME_MS2:
        listed = ", ".join(f"{source} {value:g}" for source, value in values.items())
        raise InputError(
            f"one g differs between these files (m/s^2): {listed}; if the site is the same, state it with --gravity"
        )

    clocks = joined_clocks(sets) if clocks is None else clocks
    columns: dict[str, Any] = {"names": _names(sets)}
    for name in COLUMNS[1:]:
        parts = [getattr(given, name) for given in sets]
        if name in LABELS:
            default = "" if name == "recorded_noise" else "1"
            labels = [part or (default,) * len(given) for part, given in zip(parts, sets, strict=True)]
            columns[name] = tuple(chain.from_iterable(labels)) if any(parts) else None
        else:
            columns[name] = None if any(part is None for part in parts) else np.concatenate(parts)
    columns |= {"time_s": None, "clock": None} if clocks is None else {"time_s": clocks.time_s, "clock": clocks.clock}
    return PositionSet(
        **columns,
        comments=_comments(sets),
        source=", ".join(given.source for given in sets),
        files=tuple(file for given in sets for file in given.files or (given.source,)),
        in_ms2=any(given.in_ms2 for given in sets),
    )
