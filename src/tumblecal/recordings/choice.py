"""The columns of accelerations and angular rates, by their names; values check a choice and order proposals."""

import re
import shlex
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.column_names import FORCE, RATE, STATES, Name, parsed
from tumblecal.ground.text_file import shown
from tumblecal.recordings.columns import COLUMNS_OPTION, Column
from tumblecal.recordings.guesses import question
from tumblecal.recordings.units import PER_G, may_be_gravity, size_of


# Lengths that change less are computed (a unit vector); sizes below this share of gravity have none.
_LEAST_NOISE, _LEAST_GRAVITY = 1e-4, 0.25
_MOST_SHOWN, _MOST_COLUMNS, _MOST_DISPERSION = 4, 40, 0.05
_WITHOUT = (
    "accelerations along axes of the Earth, or without the size of gravity: no calibration is possible from them. Record the "
    "sensor's readings, or use these all the same"
)


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
        """Whether the readings may have the size of gravity, with offsets and noise: in m/s^2 for a linear acceleration (ROS).

        A name that does not state an acceleration with gravity needs a rest at which the readings have this size."""
        linear = self.name.state == "linear"
        stated = self.name.quantity == "acceleration" and not linear
        size = may_be_gravity(self.size, self.name.unit or "ms2" * linear)
        return self.changes > _LEAST_NOISE and size and (stated or np.isfinite(self.dispersion))

    def option(self, columns: Sequence[str], more: str = "") -> str:
        """The option that selects it among all columns of a table, by number if a name needs quotation marks."""
        names = self.columns
        if any(re.search(r"[^\w.\[\]/]", name) or name.isdecimal() for name in names):
            names = tuple(str(columns.index(name) + 1) for name in names)
        pairs = ",".join(f"{axis}={name}" for axis, name in zip(FORCE, names, strict=True))
        return f"--columns {shlex.quote(pairs + more)}"


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


def chosen(
    columns: Sequence[str], used: Collection[str], readings: Readings, notes: list[str], path: str
) -> dict[str, Column]:
    """The accelerations with gravity, and the angular rates of the same sensor.

    Of several triples of one sensor, the least processed one with the size of gravity is used.

    **Arguments:**

    - `columns`: of the table, except `used`. `notes`: gets the alternatives.

    **Raises:** `InputError` with the candidates and an option for each, if names do not give one triple.
    """
    free = [name for name in columns if name not in used]
    triples = triples_of(free, readings)
    named = [one for one in triples if one.name.quantity == "acceleration"]
    axes_only = [one for one in triples if one.name.quantity in ("", "letter")]
    # A letter g is a rate or a multiple of g.
    plain = [one for one in axes_only if "g" not in one.name.stem]
    body = [one for one in named or plain if one.with_gravity and one.name.state not in ("free", "world")]
    if len(named) == 1 and named[0].name.state in ("raw", "", "processed"):
        # Readings far from the size of gravity may be of any unit, but not without gravity.
        body = body if named[0].size < _LEAST_GRAVITY * PER_G.get(named[0].name.unit, 1.0) else named
    # A linear acceleration is without gravity if there is another one; alone it is the name of the readings (ROS).
    body = [one for one in body if one.name.state != "linear"] or body
    several = len({one.name.sensor for one in body}) > 1 or (not named and len(body) > 1)
    if several or not body:
        found, more = body or [one for one in axes_only if one.with_gravity] + named or axes_only, ""
        words = f"name the accelerations among the columns {shown(', '.join(columns))}"
        if several:
            words = f"{len(body)} triples of columns with the size of gravity; choose one"
        elif named:
            words = f"{', '.join(named[0].columns)}: {_WITHOUT}"
        elif not axes_only:
            values = readings(free[:_MOST_COLUMNS])
            found, steps = proposals(free, values), np.diff(values, axis=0)
            rising = np.flatnonzero((steps > 0).all(0) & (steps != 1).any(0))
            if len(rising) and all(parsed(name).quantity != "time" for name in free):
                more = f",time={columns.index(free[rising[0]]) + 1}"
        options = [f"{one.option(columns, more)} (size {one.size:.4g})" for one in found[:_MOST_SHOWN]]
        raise question(path, words, options or [COLUMNS_OPTION])
    force = min(body, key=lambda one: STATES.index(one.name.state))
    if others := [one for one in named if one is not force]:
        listed = "; ".join(", ".join(one.columns) for one in others[:_MOST_SHOWN])
        notes.append(
            f"accelerations: {', '.join(force.columns)}, not {listed}; to override: {others[0].option(columns)}"
        )
    elif not named:
        notes.append(f"accelerations: {', '.join(force.columns)}, axes by their names; to override: {COLUMNS_OPTION}")
    rates = [one for one in triples if one.name.quantity == "rate"] or [
        one for one in axes_only if (*one.name.stem[:1], *force.name.stem[:1]) == ("g", "a")
    ]
    # The rates with most words in common with the accelerations, the least processed.
    rates.sort(key=lambda one: (-len({*one.name.stem} & {*force.name.stem}), STATES.index(one.name.state)))
    names = [*force.columns, *(rates[0].columns if rates else ())]
    return {role: Column(name, parsed(name).unit, "name") for role, name in zip((*FORCE, *RATE), names, strict=False)}


def proposals(columns: Sequence[str], values: NDArray[np.float64]) -> list[Triple]:
    """Neighbouring columns whose values (n, k) may be accelerations, most likely first: constant lengths of about gravity."""
    falling = np.any(np.diff(values, axis=0) < 0, axis=0)
    found = [
        Triple(tuple(columns[first : first + 3]), Name(), *size_of(values[:, first : first + 3]))
        for first in range(values.shape[1] - 2)
        if falling[first : first + 3].all()
    ]
    return sorted(found, key=lambda one: (not one.with_gravity, one.dispersion > _MOST_DISPERSION))
