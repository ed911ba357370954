"""Which columns of a table are the accelerations and the rates, and why: by their names; by their values only where these
say nothing.

A triple is three columns whose names have one stem and three axes. The accelerations are the triple that is named so and has
the size of gravity in the still stretches. Between several of one sensor the least processed counts; between several sensors,
and wherever the evidence is not enough, the user is asked.
"""

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.protocols.text_layout import UNITS_PER_G
from tumblecal.capture.recordings.column_names import ColumnName
from tumblecal.capture.recordings.still_size import FEWEST_ATTITUDES, Ellipsoid, ellipsoid, still_means
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


_PER_G = {"g": UNITS_PER_G["g"], "mg": UNITS_PER_G["mg"], "ms2": UNITS_PER_G["m/s2"]}
# Gravity's size with offsets to 0.6 g, over it; below the least, gravity has been removed.
_LEAST, _SMALLEST, _LARGEST = 0.25, 0.35, 1.9
# Of a fitted ellipsoid the size is that of gravity to within a scale factor; so is that of a length without a fit, with offsets.
_ALIKE_FITTED, _ALIKE = 1.15, 1.3
_FEWEST_ALIKE = 3
# While nothing moves, rates keep to their bias: their means spread by less than this share of all readings.
_STILL_SHARE = 0.25
_MOST_COLUMNS, _MOST_NAMED = 14, 4
_AS_WELL = 4.0
_STATE_ORDER = ("raw", "", "processed", "linear", "world", "free")


@dataclass(frozen=True)
class Triple:
    """Three columns, of the axes x, y, z; `name` is what that of the first says."""

    columns: tuple[str, str, str]
    name: ColumnName = ColumnName()

    def __str__(self) -> str:
        return ", ".join(self.columns)

    @property
    def state(self) -> str:
        """What was done to its readings, of several states the one that counts most."""
        return max(self.name.states, key=_STATE_ORDER.index, default="")


@dataclass(frozen=True)
class Choice:
    """The columns of accelerations and rates.

    **Arguments:**

    - `force`: the accelerations; `rate`: the rates, None for none. `why`: the reasons, in words.
    - `size`: of gravity in the readings, where enough attitudes show it. `said`: what was guessed, with the option that overrides it.
    """

    force: Triple
    rate: Triple | None
    why: str
    rate_why: str
    size: float | None = None
    said: tuple[str, ...] = ()


@dataclass
class Columns:
    """The columns among which is chosen.

    **Arguments:**

    - `all`: names of all columns of the table, in order. `names`: what those say that may be chosen.
    - `values`: the readings (n,) of one, taken for an axis (0 to 2). `per_g`: how many make one g, where the user says it.
    """

    all: Sequence[str]
    names: Mapping[str, ColumnName]
    values: Callable[[str, int], NDArray[np.float64]]
    per_g: float | None = None
    _sizes: dict[tuple[str, ...], "Size"] = field(default_factory=dict)

    def size(self, triple: Triple) -> "Size":
        """How large the readings of a triple are while nothing moves."""
        if triple.columns not in self._sizes:
            values = np.stack([self.values(name, k) for k, name in enumerate(triple.columns)], axis=1)
            lengths = np.linalg.norm(values, axis=1)
            lengths = lengths[np.isfinite(lengths)]
            means = still_means(values)
            attitudes = means.attitudes([0, 1, 2])
            self._sizes[triple.columns] = Size(
                float(np.median(lengths)) if len(lengths) else np.nan,
                np.linalg.norm(attitudes, axis=1),
                ellipsoid(attitudes),
                _spread(means.means[means.calm([0, 1, 2])], means.means),
            )
        return self._sizes[triple.columns]

    def unit(self, triple: Triple) -> float | None:
        """How many of a triple's unit make one g, if the user or its name says it."""
        units = {self.names[name].unit for name in triple.columns} - {""}
        return self.per_g or (_PER_G.get(units.pop()) if len(units) == 1 else None)

    def is_gravity(self, triple: Triple) -> bool:
        """Whether a triple has the size of gravity."""
        return self.size(triple).is_gravity(self.unit(triple))

    def is_without_gravity(self, triple: Triple) -> bool:
        """Whether gravity has been removed from a triple."""
        return self.size(triple).is_without_gravity(self.unit(triple))

    def option(self, triple: Triple) -> str:
        """The option that names a triple, to be pasted."""
        names = triple.columns
        if any(re.search(r"[^\w.\[\]/]", name) or name.isdecimal() for name in names):
            names = tuple(str(self.all.index(name) + 1) for name in names)
        pairs = ",".join(f"a{axis}={name}" for axis, name in zip(AXES, names, strict=True))
        return f"--columns {shlex.quote(pairs)}"


@dataclass(frozen=True)
class Size:
    """The size of three columns' readings.

    **Arguments:**

    - `usual`: median length of all rows. `lengths` (m,): of the attitudes while nothing moves; `fit`: the ellipsoid through them.
    - `spread`: how far the still means spread as a share of all readings.
    """

    usual: float
    lengths: NDArray[np.float64]
    fit: Ellipsoid | None
    spread: float

    @property
    def middle(self) -> float:
        """The size of gravity, in the readings' unit."""
        return self.fit.size if self.fit is not None and self.fit.fits else self.usual

    def is_gravity(self, per_g: float | None) -> bool:
        """Whether the readings have the size of gravity: in their own unit, or if that is not known in a usual one."""
        if per_g is not None:
            return _SMALLEST < self.middle / per_g < _LARGEST
        if self.fit is not None and self.fit.fits and self.fit.usual:
            return usual_unit(self.fit.size, _ALIKE_FITTED) is not None
        alike = {usual_unit(length, _ALIKE) for length in self.lengths}
        return len(self.lengths) >= _FEWEST_ALIKE and len(alike) == 1 and None not in alike

    def is_without_gravity(self, per_g: float | None) -> bool:
        """Whether gravity has been removed: in a known unit, the readings are near zero."""
        return per_g is not None and self.usual / per_g < _LEAST


def usual_unit(size: float, alike: float) -> str | None:
    """The unit in which a size is one g, to within a factor; None for no usual one."""
    if not size > 0:
        return None
    near = min(UNITS_PER_G, key=lambda unit: abs(np.log(size / UNITS_PER_G[unit])))
    return near if 1 / alike < size / UNITS_PER_G[near] < alike else None


def triples_of(names: Mapping[str, ColumnName]) -> list[Triple]:
    """The triples among columns, in their order: one quantity and one stem, axes x, y, z, or the numbers 0 to 2 or 1 to 3."""
    groups: dict[tuple, dict[str, str]] = {}
    for column, name in names.items():
        if name.axis and (name.stem or name.axis in AXES):
            groups.setdefault((name.quantity, name.stem, name.axis in AXES), {}).setdefault(name.axis, column)
    triples = [
        Triple(tuple(group[axis] for axis in axes), names[group[axes[0]]])  # type: ignore[arg-type]
        for group in groups.values()
        for axes in (AXES, "012", "123")
        if set(group) == set(axes)
    ]
    return sorted(triples, key=lambda triple: list(names).index(triple.columns[0]))


def chosen(columns: Columns, path: str) -> Choice | None:
    """The accelerations and the rates; None where names and values show none, so that nothing can be asked about.

    **Raises:** `InputError` that names the candidates, with the option for each.
    """
    triples = triples_of(columns.names)
    named = [triple for triple in triples if triple.name.quantity == "acceleration"]
    if named:
        force, why, said = _named(columns, named, path)
    elif any(name.quantity == "acceleration" and name.axis for name in columns.names.values()):
        return None
    else:
        unnamed = [triple for triple in triples if triple.name.quantity in ("", "letter")]
        found = _by_axes(columns, unnamed, path) if unnamed else _by_values(columns, path)
        if found is None:
            return None
        force, why, said = found
    rate, rate_why, more = _rate(columns, triples, force)
    fit = columns.size(force).fit if force.columns in columns._sizes else None
    return Choice(force, rate, why, rate_why, fit.size if fit is not None and fit.fits else None, (*said, *more))


def _named(columns: Columns, named: list[Triple], path: str) -> tuple[Triple, str, list[str]]:
    """The accelerations among triples that are named so."""
    if len(named) == 1:
        return *_only(columns, named[0], path), []
    body = [triple for triple in named if triple.state not in ("free", "world")] or named
    others = _but(named, body)
    if len(body) == 1:
        return *_only(columns, body[0], path), [f"accelerations: {body[0]}, not {others} (without gravity, by name)"]
    heavy = [triple for triple in body if columns.is_gravity(triple)]
    left = heavy or body
    if not heavy and all(columns.is_without_gravity(t) for t in left):
        raise InputError(f"{path}: {_without_gravity(columns, left)}")
    if len({_sensor(triple) for triple in left}) > 1:
        raise InputError(f"{path}: {len(left)} accelerometers; choose one: {_options(columns, left)}")
    force = min(left, key=lambda triple: (_unit_unknown(columns, triple), _STATE_ORDER.index(triple.state)))
    if force.state in ("linear", "free", "world"):
        return *_only(columns, force, path), []
    others = _but(named, [force])
    why = "name" if len(left) > 1 else "name and size"
    because = "the least processed" if len(left) > 1 else "the size of gravity while still"
    other = next(triple for triple in named if triple is not force)
    return force, why, [f"accelerations: {force} ({because}), not {others}; to override: {columns.option(other)}"]


def _but(named: list[Triple], these: list[Triple]) -> str:
    """The other triples, in words."""
    others = [str(triple) for triple in named if triple not in these]
    return "; ".join(others[:_MOST_NAMED]) + ("; ..." if len(others) > _MOST_NAMED else "")


def _sensor(triple: Triple) -> tuple[str, ...]:
    return triple.name.sensor


def _unit_unknown(columns: Columns, triple: Triple) -> bool:
    return not triple.name.unit and usual_unit(columns.size(triple).middle, _ALIKE) is None


def _only(columns: Columns, triple: Triple, path: str) -> tuple[Triple, str]:
    """The one triple of accelerations, which must not be without gravity.

    **Raises:** `InputError` for one that is, or whose axes are those of the Earth.
    """
    if triple.state == "world":
        words = f"{triple}: accelerations along axes of the Earth, not of the sensor; no calibration is possible from them"
        raise InputError(f"{path}: {words}. Record those of the sensor, or to take them all the same: {columns.option(triple)}")
    if columns.is_without_gravity(triple):
        raise InputError(f"{path}: {_without_gravity(columns, [triple])}")
    if triple.state in ("linear", "free"):
        if not columns.is_gravity(triple):
            raise InputError(f"{path}: {_without_gravity(columns, [triple])}")
        return triple, "name and size"
    return triple, "name, unit" if triple.name.unit else "name"


def _without_gravity(columns: Columns, triples: list[Triple]) -> str:
    triple = triples[0]
    size = columns.size(triple).middle
    return (
        f"{triple}: accelerations without gravity (size {size:.3g} while still, by their names or values); no calibration is "
        f"possible from them. Record the accelerometer's own readings, or to take them all the same: {columns.option(triple)}"
    )


def _by_axes(columns: Columns, unnamed: list[Triple], path: str) -> tuple[Triple, str, list[str]] | None:
    """The accelerations among triples whose names give the axes, and no quantity: those that have the size of gravity."""
    heavy = [triple for triple in unnamed if columns.is_gravity(triple)]
    if len(heavy) == 1:
        triple = heavy[0]
        said = f"accelerations: {triple}, axes by their names, quantity by the size {columns.size(triple).middle:.5g} while still"
        return triple, "axes by name, quantity by value", [f"{said}; to override: {columns.option(triple)}"]
    words = "the names of no columns say acceleration, and several triples" if heavy else (
        "the names of no columns say acceleration, and the values do not show which are (too few attitudes, or gravity removed); if they"
    )  # fmt: skip
    raise InputError(f"{path}: {words} may be it: {_options(columns, heavy or unnamed)}")


def _by_values(columns: Columns, path: str) -> tuple[Triple, str, list[str]] | None:
    """The accelerations among columns whose names say nothing: the one triple whose still means lie on an ellipsoid of
    gravity's size, if no other lies on one as well.

    A second ellipsoid of another size is a magnetic field if it comes behind; before the accelerations, nobody knows.
    """
    free = [name for name, own in columns.names.items() if not own.quantity][:_MOST_COLUMNS]
    data = np.stack([columns.values(name, 0) for name in free], axis=1) if free else np.zeros((0, 0))
    data = data[np.isfinite(data).all(1)]
    varied = [k for k in range(len(free)) if len(data) and not _is_clock(data[:, k]) and np.ptp(data[:, k]) > 0]
    if len(varied) < len(AXES):
        return None
    means = still_means(data)
    fits = dict[tuple[int, ...], Ellipsoid]()
    for three in combinations(varied, 3):
        fit = ellipsoid(means.attitudes(list(three)))
        if fit is not None and fit.fits:
            fits[three] = fit
    heavy = [three for three, fit in fits.items() if fit.usual and usual_unit(fit.size, _ALIKE_FITTED)]
    best = min(heavy, key=lambda three: fits[three].dispersion, default=())
    # Two columns of a triad and a third one may fit by chance, but not so well.
    heavy = [t for t in heavy if fits[t].dispersion <= _AS_WELL * fits[best].dispersion or len({*t, *best}) == 6]
    named = {three: Triple(tuple(free[k] for k in three)) for three in fits}  # type: ignore[misc]
    if len(heavy) == 1 and not any(three[0] < heavy[0][0] for three in fits):
        (three,) = heavy
        fit, triple = fits[three], named[three]
        said = (
            f"accelerations: columns {triple} as x, y, z, by their values (one ellipsoid of size {fit.size:.5g} in {fit.attitudes} "
            f"attitudes, {100 * fit.dispersion:.1f} % dispersion); to override: {columns.option(triple)}"
        )
        return triple, "values", [said]
    likely = [named[three] for three in fits] or [
        Triple((free[k], free[k + 1], free[k + 2])) for k in varied if {k + 1, k + 2} <= set(varied)
    ]
    if not likely:
        return None
    because = "several fit gravity" if len(fits) > 1 else f"needed are {FEWEST_ATTITUDES} attitudes at rest, and one triple that fits gravity"
    raise InputError(
        f"{path}: no names of columns, and the values do not show which are the accelerations ({because}); candidates: "
        f"{_options(columns, likely)}"
    )


def _options(columns: Columns, triples: list[Triple]) -> str:
    """Candidates, each with its size and the option to paste."""
    shown = [f"{columns.option(t)} (size {columns.size(t).middle:.4g})" for t in triples[:_MOST_NAMED]]
    more = len(triples) - _MOST_NAMED
    return " or ".join(shown) + (f", or {more} more" if more > 0 else "")


def _is_clock(values: NDArray[np.float64]) -> bool:
    """Whether a column only rises, as a time or a counter does."""
    return bool((np.diff(values) >= 0).all())


def _spread(still: NDArray[np.float64], every: NDArray[np.float64]) -> float:
    """The range of means while still as a share of all, on the axis where it is largest; 0 for columns that do not change."""
    if not len(still):
        return 0.0
    whole = np.ptp(every, axis=0)
    return float((np.ptp(still, axis=0) / np.where(whole > 0, whole, 1.0)).max())


def _rate(columns: Columns, triples: list[Triple], force: Triple) -> tuple[Triple | None, str, list[str]]:
    """The rates: of the triples that are named so the one with most words in common with the accelerations; without names,
    three columns next to these whose readings keep to one value while nothing moves."""
    named = [triple for triple in triples if triple.name.quantity == "rate"]
    if not named:
        letters = [t for t in triples if t.name.quantity == "letter" and t.name.stem[:1] == ("g",) and t != force]
        named = [triple for triple in letters if columns.size(triple).spread < _STILL_SHARE]
    if named:
        common = [len(set(triple.name.stem) & set(force.name.stem)) for triple in named]
        order = [(-common[k], _STATE_ORDER.index(triple.state), k) for k, triple in enumerate(named)]
        return named[min(order)[-1]], "name", []
    free = [name for name, own in columns.names.items() if not own.quantity]
    if force.name.quantity or any(own.axis for own in columns.names.values()):
        return None, "", []
    at = free.index(force.columns[2])
    for three in (free[at + 1 : at + 4], free[max(0, at - 5) : at - 2]):
        if len(three) == len(AXES):
            triple = Triple(tuple(three))  # type: ignore[arg-type]
            data = [columns.values(name, 0) for name in three]
            moving = all(np.nanmax(own) > np.nanmin(own) and not _is_clock(own) for own in data)
            if moving and columns.size(force).spread > _STILL_SHARE > columns.size(triple).spread:
                return triple, "values", [f"angular rates: columns {triple}, by their values (still while the accelerations are)"]
    return None, "", []
