"""The columns of accelerations and angular rates, by their names; values check a choice and order proposals."""

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.column_names import FORCE, RATE, STATES, Name, parsed
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown
from tumblecal.recordings.columns import COLUMNS_OPTION, Column
from tumblecal.recordings.guesses import question
from tumblecal.recordings.sizes import PER_G, may_be_gravity, size_of


# Lengths that change less are computed (a unit vector); sizes below this share of gravity have none.
_LEAST_NOISE, _LEAST_GRAVITY = 1e-4, 0.25
_MOST_SHOWN, _MOST_COLUMNS = 4, 40


@dataclass(frozen=True)
class Triple:
    """Three columns for the axes x, y, z, the meaning of their names, and size, changes and dispersion by `size_of`."""

    columns: tuple[str, ...]
    name: Name
    size: float
    changes: float
    dispersion: float

    @property
    def with_gravity(self) -> bool:
        """Whether the readings may have the size of gravity, with offsets and noise."""
        return self.changes > _LEAST_NOISE and may_be_gravity(self.size, self.name.unit)

    def option(self, columns: Sequence[str], more: str = "") -> str:
        """The option that selects it, by number if a name needs quotation marks, and its size."""
        names = self.columns
        if any(re.search(r"[^\w.\[\]/]", name) or name.isdecimal() for name in names):
            names = tuple(str(columns.index(name) + 1) for name in names)
        axes = ",".join(f"{axis}={name}" for axis, name in zip(FORCE, names, strict=True))
        return f"--columns {shlex.quote(axes)}{more} (size {self.size:.4g})"


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
        if (axes := "".join(sorted(group))) in ("xyz", "012", "123"):
            three = tuple(group[axis] for axis in axes)
            found.append(Triple(three, parsed(three[0]), *size_of(readings(three))))
    return sorted(found, key=lambda triple: columns.index(triple.columns[0]))


def chosen(columns: Sequence[str], readings: Readings, notes: list[str], path: str) -> dict[str, Column]:
    """The accelerations with gravity, and the angular rates of the same sensor; `notes` gets the alternatives.

    Of several triples of one sensor, the least processed one with the size of gravity is used.

    **Raises:** `InputError` with the candidates and an option for each, if names do not give one triple.
    """
    triples = triples_of(columns, readings)
    named = [triple for triple in triples if triple.name.quantity == "acceleration"]
    axes_only = [triple for triple in triples if triple.name.quantity in ("", "letter")]
    body = [one for one in named or axes_only if one.with_gravity and one.name.state not in ("free", "world")]
    if len(named) == 1 and named[0].name.state in ("raw", "", "processed"):
        # Readings far from the size of gravity may be of any unit, but not without gravity.
        with_gravity = not named[0].size < _LEAST_GRAVITY * PER_G.get(named[0].name.unit, 1.0)
        body = named if with_gravity else body
    if len({triple.name.sensor for triple in body}) != 1 or (not named and len(body) > 1):
        raise _question(columns, readings, named, body, axes_only, path)
    force = min(body, key=lambda triple: STATES.index(triple.name.state))
    names = ", ".join(force.columns)
    if others := [triple for triple in named if triple is not force]:
        listed = "; ".join(", ".join(triple.columns) for triple in others[:_MOST_SHOWN])
        notes.append(f"accelerations: {names}, not {listed}; to override: {others[0].option(columns)}")
    elif not named:
        notes.append(f"accelerations: {names}, axes by their names, size {force.size:.5g}; to override: {COLUMNS_OPTION}")
    rates = [one for one in triples if one.name.quantity == "rate"] or [
        one for one in triples if one.name.quantity == "letter" and one.name.stem[:1] == ("g",) and one is not force
    ]
    # The rates with most words in common with the accelerations, the least processed.
    common = {one: len({*one.name.stem} & {*force.name.stem}) for one in rates}
    rates.sort(key=lambda one: (-common[one], STATES.index(one.name.state)))
    found = dict(zip((*FORCE, *RATE), [*force.columns, *(rates[0].columns if rates else ())], strict=False))
    return {role: Column(name, parsed(name).unit, "name") for role, name in found.items()}


def _question(
    columns: Sequence[str],
    readings: Readings,
    named: Sequence[Triple],
    body: Sequence[Triple],
    axes_only: Sequence[Triple],
    path: str,
) -> InputError:
    """The question which columns are the accelerations, with the options that can be pasted."""
    single = [column for column in columns if parsed(column).quantity == "acceleration"]
    values = readings(columns[:_MOST_COLUMNS])
    found, more = body or named or axes_only, ""
    if body:
        words = f"{len(body)} triples of columns with the size of gravity; choose one"
    elif named:
        words = (
            f"{', '.join(named[0].columns)} are accelerations along axes of the Earth, or without the size of gravity: no "
            "calibration is possible from them. Record the sensor's readings, or use these all the same"
        )
    elif single:
        words = f"only {', '.join(single)} among the columns {shown(', '.join(columns))}; name the three"
    else:
        words = f"the columns' names do not state the accelerations: {shown(', '.join(columns))}; give them"
        found = axes_only or proposals(columns, values)
        rising = np.flatnonzero((np.diff(values, axis=0) > 0).all(0) & (np.diff(values, axis=0) != 1).any(0))
        if len(rising) and not axes_only and not any(parsed(column).quantity == "time" for column in columns):
            more = f",time={rising[0] + 1}"
    return question(path, words, [one.option(columns, more) for one in found[:_MOST_SHOWN]] or [COLUMNS_OPTION])


def proposals(columns: Sequence[str], values: NDArray[np.float64]) -> list[Triple]:
    """Neighbouring columns whose values (n, k) may be accelerations, most likely first: constant lengths of about gravity."""
    falling = (np.diff(values, axis=0) < 0).any(0)
    found = [
        Triple(tuple(columns[first : first + 3]), Name(), *size_of(values[:, first : first + 3]))
        for first in range(values.shape[1] - 2)
        if falling[first : first + 3].all()
    ]
    return sorted(found, key=lambda triple: (not triple.with_gravity, triple.dispersion))
