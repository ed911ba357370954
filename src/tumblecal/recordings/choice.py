"""The columns of accelerations and angular rates, by their names; values check a choice and order proposals."""

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.column_names import STATES, Name, parsed
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.columns import COLUMNS_OPTION
from tumblecal.recordings.units import PER_G, may_be_gravity, signed_words, size_of


# Lengths that change less are computed (a unit vector); sizes below this share of gravity have none.
_LEAST_NOISE, _LEAST_GRAVITY = 1e-4, 0.25
_MOST_SHOWN = 4
_MOST_COLUMNS = 40


@dataclass(frozen=True)
class Triple:
    """Three columns for the axes x, y, z, the meaning of their names, and size, changes and dispersion by `size_of`."""

    columns: tuple[str, str, str]
    name: Name
    size: float
    changes: float
    dispersion: float

    @property
    def with_gravity(self) -> bool:
        """Whether the readings may have the size of gravity, with offsets and noise."""
        return self.changes > _LEAST_NOISE and may_be_gravity(self.size, self.name.unit)

    @property
    def without_gravity(self) -> bool:
        """Whether gravity was removed from the readings: they are near zero in their unit, or in any usual unit."""
        return self.size < _LEAST_GRAVITY * PER_G.get(self.name.unit, 1.0)

    def __str__(self) -> str:
        return ", ".join(self.columns)


Readings = Callable[[Sequence[str]], NDArray[np.float64]]


def triples_of(columns: Sequence[str], readings: Readings) -> list[Triple]:
    """Three columns with one quantity and one stem in their names, and axes x, y, z, or the numbers 0 to 2 or 1 to 3.

    **Arguments:**

    - `readings`: the numbers (n, k) of some columns.
    """
    groups: dict[tuple, dict[str, str]] = {}
    for column in columns:
        name = parsed(column)
        if name.axis and (name.stem or name.axis in "xyz"):
            groups.setdefault((name.quantity, name.stem, name.axis.isdecimal()), {}).setdefault(name.axis, column)
    found = []
    for group in groups.values():
        for axes in ("xyz", "012", "123"):
            if {*group} == {*axes}:
                three = (group[axes[0]], group[axes[1]], group[axes[2]])
                found.append(Triple(three, parsed(three[0]), *size_of(readings(three))))
    return sorted(found, key=lambda triple: columns.index(triple.columns[0]))


def chosen(columns: Sequence[str], readings: Readings, path: str) -> tuple[Triple, Triple | None, list[str]]:
    """The accelerations with gravity, the angular rates of the same sensor, and notes on the choice.

    Of several triples of one sensor, the least processed one with the size of gravity is used.

    **Raises:** `InputError` with the candidates and an option for each, if names do not give one triple.
    """
    triples = triples_of(columns, readings)
    named = [triple for triple in triples if triple.name.quantity == "acceleration"]
    axes_only = [triple for triple in triples if triple.name.quantity in ("", "letter")]
    candidates = [triple for triple in named or axes_only if triple.with_gravity]
    body = [triple for triple in candidates if triple.name.state not in ("free", "world")]
    if len(named) == 1 and named[0].name.state in ("raw", "", "processed") and not named[0].without_gravity:
        body = named
    if len({triple.name.sensor for triple in body}) != 1 or (not named and len(body) > 1):
        _ask(columns, readings, (named, body, axes_only), path)
    force = min(body, key=lambda triple: STATES.index(triple.name.state))
    notes = []
    if others := [triple for triple in named if triple is not force]:
        names = "; ".join(map(str, others[:_MOST_SHOWN]))
        notes.append(f"accelerations: {force}, not {names}; to override: {_option(columns, others[0].columns)}")
    elif not named:
        notes.append(
            f"accelerations: {force}, axes by their names, size {force.size:.5g}; to override: {COLUMNS_OPTION}"
        )
    return force, _rate(triples, force), notes


def _rate(triples: Sequence[Triple], force: Triple) -> Triple | None:
    """The rates with most words in common with the accelerations, the least processed."""
    rates = [triple for triple in triples if triple.name.quantity == "rate"] or [
        triple
        for triple in triples
        if triple.name.quantity == "letter" and triple.name.stem[:1] == ("g",) and triple is not force
    ]
    common = {triple: len({*triple.name.stem} & {*force.name.stem}) for triple in rates}
    return min(rates, key=lambda triple: (-common[triple], STATES.index(triple.name.state)), default=None)


def _ask(
    columns: Sequence[str], readings: Readings, found: tuple[list[Triple], list[Triple], list[Triple]], path: str
) -> None:
    """Raise the question which columns are the accelerations, with the options that can be pasted."""
    named, body, axes_only = found
    if body:
        several = "accelerometers" if named else "triples of columns with the size of gravity"
        _raise(columns, path, f"{len(body)} {several}; choose one", body)
    if named:
        if words := signed_words(named[0].columns, readings(named[0].columns)):
            raise InputError(f"{path}: {words}")
        of_earth = all(triple.name.state == "world" for triple in named)
        size = f"without the size of gravity ({named[0].size:.3g})"
        why = "along axes of the Earth, not of the sensor" if of_earth else size
        remedy = "no calibration is possible from them. Record the sensor's readings, or use these all the same"
        _raise(columns, path, f"{named[0]} are accelerations {why}: {remedy}", named)
    single = [column for column in columns if parsed(column).quantity == "acceleration"]
    if len(single) >= 3:
        words = f"{', '.join(single)} are accelerations, but not of axes x, y, z; assign the axes"
        raise InputError(f"{path}: {words}: {_option(columns, single[:3])}")
    if single:
        raise InputError(
            f"{path}: only {', '.join(single)} among the columns {shown(', '.join(columns))}; name the three: {COLUMNS_OPTION}"
        )
    values = readings(columns[:_MOST_COLUMNS])
    proposed = axes_only or proposals(columns, values)
    if not proposed:
        raise InputError(
            f"{path}: ax, ay, az not found among the columns {shown(', '.join(columns))}; name them: {COLUMNS_OPTION}"
        )
    steps = np.diff(values, axis=0)
    rising = np.flatnonzero((steps > 0).all(0) & ~(steps == 1).all(0)) if len(steps) else np.zeros(0, int)
    named_time = any(parsed(column).quantity == "time" for column in columns)
    clock = "" if named_time or axes_only or not len(rising) else f",time={rising[0] + 1}"
    _raise(columns, path, "the columns' names do not state the accelerations; give them", proposed, clock)


def proposals(columns: Sequence[str], values: NDArray[np.float64]) -> list[Triple]:
    """Neighbouring columns whose values (n, k) may be accelerations, most likely first: constant lengths of about gravity."""
    varied = [
        k for k, column in enumerate(values.T) if np.isfinite(column).any() and np.nanmax(column) > np.nanmin(column)
    ]
    varied = [k for k in varied if (np.diff(values[:, k]) < 0).any()]
    found = []
    for first in varied:
        if {first + 1, first + 2} <= {*varied}:
            three = (columns[first], columns[first + 1], columns[first + 2])
            found.append(Triple(three, Name(), *size_of(values[:, first : first + 3])))
    return sorted(found, key=lambda triple: (not triple.with_gravity, triple.dispersion))


def _raise(columns: Sequence[str], path: str, words: str, triples: Sequence[Triple], clock: str = "") -> None:
    options = [f"{_option(columns, one.columns)}{clock} (size {one.size:.4g})" for one in triples[:_MOST_SHOWN]]
    raise InputError(f"{path}: {words}: {' or '.join(options)}")


def _option(columns: Sequence[str], three: Sequence[str]) -> str:
    """The option that selects three columns, by number if a name needs quotation marks."""
    if any(re.search(r"[^\w.\[\]/]", name) or name.isdecimal() for name in three):
        three = [str(columns.index(name) + 1) for name in three]
    return f"--columns {shlex.quote(','.join(f'a{axis}={name}' for axis, name in zip('xyz', three, strict=True)))}"
