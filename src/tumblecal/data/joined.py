"""Several position sets of one triad on one head as one."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.data.positions import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import SAME_MS2


def runs_apart(sets: Sequence[PositionSet]) -> list[PositionSet]:
    """Sets to be joined, each that names no run as a run of its own: the name of its file, or of its folder where files have
    one name. Sets that no other shares a mount with stay as they are: a mounting of their own says as much."""
    mounts = [set(given.mount or ("1",)) for given in sets]
    alone = [not any(own & other for j, other in enumerate(mounts) if j != k) for k, own in enumerate(mounts)]
    if len(sets) < 2 or all(alone):
        return list(sets)
    names = [Path(given.source).stem for given in sets]
    names = names if len(set(names)) == len(names) else [Path(given.source).absolute().parent.name for given in sets]
    taken = {label for given in sets for label in given.run or ()}
    named: list[PositionSet] = []
    for given, name, by_mount in zip(sets, names, alone, strict=True):
        if given.run is None and not by_mount:
            numbered = (name, *(f"{name} {number}" for number in range(2, len(sets) + len(taken) + 2)))
            label = next(label for label in numbered if label not in taken)
            taken.add(label)
            given = replace(given, run=(label,) * len(given))
        named.append(given)
    return named


def joined(sets: Sequence[PositionSet]) -> PositionSet:
    """The positions of all sets in their order.

    Runs and mounts that are not named are called 1. The times of a set go on one mean step after those of the set before it.
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

    return PositionSet(
        names=tuple(name for given in sets for name in given.names),
        alpha_deg=np.concatenate([given.alpha_deg for given in sets]),
        beta_deg=np.concatenate([given.beta_deg for given in sets]),
        readings=np.concatenate([given.readings for given in sets]),
        sd=column("sd"),
        run=labels("run"),
        mount=labels("mount"),
        time_s=_times(sets),
        temperature_degc=column("temperature_degc"),
        approach=column("approach"),
        n=column("n"),
        recorded_noise=labels("recorded_noise", ""),
        comments=dict(sets[0].comments),
        source=", ".join(given.source for given in sets),
        in_ms2=any(given.in_ms2 for given in sets),
    )


def _times(sets: Sequence[PositionSet]) -> np.ndarray | None:
    times = [given.time_s for given in sets]
    return None if any(time is None for time in times) else times_going_on([time for time in times if time is not None])


def times_going_on(clocks: Sequence[np.ndarray]) -> np.ndarray:
    """Times of stretches that follow one another, each by a clock of its own, s: a later one goes on after the one before."""
    parts, now = [], 0.0
    for clock in clocks:
        time = clock - clock.min() + now if parts else clock
        parts.append(time)
        now = float(time.max() + np.ptp(time) / max(1, len(time) - 1))
    return np.concatenate(parts)
