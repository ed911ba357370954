"""Several position sets of one triad on one head as one."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.data.joined_clocks import JoinedClocks, joined_clocks
from tumblecal.data.positions import NOT_CONFIRMED, WITHIN_DWELLS, PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import SAME_MS2


# Comments on faults of a measurement, by what their keys begin with.
FAULTS = (NOT_CONFIRMED, WITHIN_DWELLS)


def runs_apart(sets: Sequence[PositionSet]) -> list[PositionSet]:
    """Sets to be joined, each that names no run as a run of its own: the name of its file, or of its folder where files have
    one name. Sets that no other shares a mount with stay as they are: a mounting of their own says as much."""
    mounts = [set(given.mount or ("1",)) for given in sets]
    alone = [not any(own & other for j, other in enumerate(mounts) if j != k) for k, own in enumerate(mounts)]
    if len(sets) < 2 or all(alone):
        return list(sets)
    taken = {label for given in sets for label in given.run or ()}
    named: list[PositionSet] = []
    for given, name, by_mount in zip(sets, _called(sets), alone, strict=True):
        if given.run is None and not by_mount:
            label = _free(name, taken)
            taken.add(label)
            given = replace(given, run=(label,) * len(given))
        named.append(given)
    return named


def _called(sets: Sequence[PositionSet]) -> list[str]:
    """What each set is called: as its file, or as its folder where files have one name; with a number where these do."""
    names = [Path(given.source).stem for given in sets]
    names = names if len(set(names)) == len(names) else [Path(given.source).absolute().parent.name for given in sets]
    called: list[str] = []
    for name in names:
        called.append(_free(name, set(called)))
    return called


def _free(name: str, taken: set[str]) -> str:
    """A name, with the first number that makes it another than those taken."""
    return next(free for free in (name, *(f"{name} {k}" for k in range(2, len(taken) + 3))) if free not in taken)


def _names(sets: Sequence[PositionSet]) -> tuple[str, ...]:
    """The positions' names; one that stands in several sets gets what its set is called before it, such as `m1:p0`."""
    times = Counter(name for given in sets for name in set(given.names))
    called = _called(sets)
    return tuple(
        f"{own}:{name}" if times[name] > 1 else name
        for own, given in zip(called, sets, strict=True)
        for name in given.names
    )


def _comments(sets: Sequence[PositionSet]) -> dict[str, str]:
    """The first file's comments, but those on faults of a measurement of every file: in words, and the largest of sizes."""
    comments = {key: text for key, text in sets[0].comments.items() if not key.startswith(FAULTS)}
    keys = dict.fromkeys(key for given in sets for key in given.comments if key.startswith(FAULTS))
    for key in keys:
        by_file = {name: given.comments.get(key, "") for name, given in zip(_called(sets), sets, strict=True)}
        texts = {name: text for name, text in by_file.items() if text}
        same = len(texts) == len(sets) and len(set(texts.values())) == 1
        sizes = [size for text in texts.values() if (size := _size(text)) is not None]
        if sizes:
            comments[key] = f"{max(sizes):g}"
        elif texts:
            comments[key] = next(iter(texts.values())) if same else " ".join(f"{name}: {texts[name]}" for name in texts)
    return comments


def _size(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def joined(sets: Sequence[PositionSet], clocks: JoinedClocks | None = None) -> PositionSet:
    """The positions of all sets in their order, with their times as `joined_clocks` has them (by the files where left out).

    Names of positions that stand in several sets are told apart (`m1:p0`). Runs and mounts that are not named are called 1.
    Time, temperature, approach and n are kept where all sets have them.

    **Raises:** `InputError` when some sets state standard deviations and some do not, or when one g is not the same for all.
    """
    if len(sets) == 1:
        return sets[0]
    with_sd = [given.sd is not None for given in sets]
    if any(with_sd) and not all(with_sd):
        lacking = ", ".join(given.source for given, has in zip(sets, with_sd, strict=True) if not has)
        raise InputError(f"{lacking}: no sd columns, but other files have them; give all files sd columns, or none")

    values = {given.source: given.gravity.value_ms2 for given in sets if given.gravity}
    if len(values) > 1 and np.ptp(list(values.values())) > SAME_MS2:
        said = ", ".join(f"{source} {value:g}" for source, value in values.items())
        raise InputError(
            f"one g is not the same in these files (m/s^2): {said}; if all were there, state it with --gravity"
        )

    def column(name: str) -> np.ndarray | None:
        parts = [getattr(given, name) for given in sets]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    def labels(name: str, default: str = "1") -> tuple[str, ...] | None:
        if all(getattr(given, name) is None for given in sets):
            return None
        return tuple(label for given in sets for label in getattr(given, name) or (default,) * len(given))

    clocks = joined_clocks(sets) if clocks is None else clocks
    return PositionSet(
        names=_names(sets),
        alpha_deg=np.concatenate([given.alpha_deg for given in sets]),
        beta_deg=np.concatenate([given.beta_deg for given in sets]),
        readings=np.concatenate([given.readings for given in sets]),
        sd=column("sd"),
        run=labels("run"),
        mount=labels("mount"),
        time_s=None if clocks is None else clocks.time_s,
        clock=None if clocks is None else clocks.clock,
        temperature_degc=column("temperature_degc"),
        approach=column("approach"),
        n=column("n"),
        recorded_noise=labels("recorded_noise", ""),
        comments=_comments(sets),
        source=", ".join(given.source for given in sets),
        files=tuple(file for given in sets for file in given.files or (given.source,)),
        in_ms2=any(given.in_ms2 for given in sets),
    )
