"""Triples of columns, with one quantity and one stem in their names and three axes, and the size of their readings at rest."""

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.columns.column_names import ColumnName
from tumblecal.capture.columns.still_size import Ellipsoid, ellipsoid, still_means
from tumblecal.ground.axes import AXES
from tumblecal.ground.gravity import UNITS_PER_G


_PER_G = {"g": UNITS_PER_G["g"], "mg": UNITS_PER_G["mg"], "ms2": UNITS_PER_G["m/s2"]}
# Size of readings with offsets to 0.6 g, relative to gravity; below the smallest size, gravity was removed.
_LEAST, _SMALLEST, _LARGEST = 0.25, 0.35, 1.9
# A fitted ellipsoid has the size of gravity to within a scale factor; a length without a fit also includes offsets.
ALIKE_FITTED, ALIKE = 1.15, 1.3
_FEWEST_ALIKE = 3
# Noise and errors of a sensor change the length of its readings by more than this share; a unit vector has a constant length.
_LEAST_NOISE = 1e-4
# For a single attitude: the length changes by less than this share, and is one g to within this factor.
_AT_REST, _ALIKE_ONE = 0.1, 1.2
STATE_ORDER = ("raw", "", "processed", "linear", "world", "free")


@dataclass(frozen=True)
class Triple:
    """Three columns for the axes x, y, z; `name` is the meaning of the first column's name."""

    columns: tuple[str, str, str]
    name: ColumnName

    def __str__(self) -> str:
        return ", ".join(self.columns)

    @property
    def state(self) -> str:
        """The processing state of its readings; of several states, the decisive one."""
        return max(self.name.states, key=STATE_ORDER.index, default="")


@dataclass
class Columns:
    """The columns that are candidates.

    **Arguments:**

    - `all`: names of all columns of the table, in order. `names`: meanings of the candidates' names.
    - `values`: the readings (n,) of a column as an axis (0 to 2). `per_g`: units for one g, if an option gives it.
    """

    all: Sequence[str]
    names: Mapping[str, ColumnName]
    values: Callable[[str, int], NDArray[np.float64]]
    per_g: float | None = None
    _sizes: dict[tuple[str, ...], "Size"] = field(default_factory=dict)

    def size(self, triple: Triple) -> "Size":
        """The size of a triple's readings at rest."""
        if triple.columns not in self._sizes:
            values = np.stack([self.values(name, k) for k, name in enumerate(triple.columns)], axis=1)
            lengths = np.linalg.norm(values, axis=1)
            lengths = lengths[np.isfinite(lengths)]
            means = still_means(values)
            attitudes = means.attitudes([0, 1, 2])
            self._sizes[triple.columns] = Size(
                float(np.median(lengths)) if len(lengths) else np.nan,
                _changes(lengths),
                np.linalg.norm(attitudes, axis=1),
                ellipsoid(attitudes),
                _spread(means.means[means.calm([0, 1, 2])], means.means),
                self._unit(triple),
            )
        return self._sizes[triple.columns]

    def _unit(self, triple: Triple) -> float | None:
        """Units for one g of a triple, if an option or its name gives it."""
        units = {self.names[name].unit for name in triple.columns} - {""}
        return self.per_g or (_PER_G.get(units.pop()) if len(units) == 1 else None)

    def option(self, triple: Triple) -> str:
        """The option that selects a triple."""
        names = triple.columns
        if any(re.search(r"[^\w.\[\]/]", name) or name.isdecimal() for name in names):
            names = tuple(str(self.all.index(name) + 1) for name in names)
        pairs = ",".join(f"a{axis}={name}" for axis, name in zip(AXES, names, strict=True))
        return f"--columns {shlex.quote(pairs)}"


@dataclass(frozen=True)
class Size:
    """The size of three columns' readings.

    **Arguments:**

    - `usual`: median length of all rows; `changes`: largest relative difference of nine tenths of them from it.
    - `lengths` (m,): lengths of the attitudes at rest; `fit`: the ellipsoid through them.
    - `spread`: range of the means at rest as a share of the range of all readings. `per_g`: units for one g, if known.
    """

    usual: float
    changes: float
    lengths: NDArray[np.float64]
    fit: Ellipsoid | None
    spread: float
    per_g: float | None

    @property
    def middle(self) -> float:
        """The size of gravity, in the readings' unit."""
        return self.fit.size if self.fit is not None and self.fit.fits else self.usual

    @property
    def is_gravity(self) -> bool:
        """Whether the readings have the size of gravity: in their unit, or in a usual unit if it is unknown."""
        if self.per_g is not None:
            return _SMALLEST < self.middle / self.per_g < _LARGEST
        if self.fit is not None and self.fit.fits and self.fit.usual:
            return usual_unit(self.fit.size, ALIKE_FITTED) is not None
        units = {usual_unit(length, ALIKE) for length in self.lengths}
        return len(self.lengths) >= _FEWEST_ALIKE and len(units) == 1 and None not in units

    @property
    def may_be_gravity(self) -> bool:
        """Whether the usual length is gravity with offsets, in their unit or in any usual unit."""
        units = UNITS_PER_G.values() if self.per_g is None else [self.per_g]
        return any(_SMALLEST < self.usual / unit < _LARGEST for unit in units)

    @property
    def is_computed(self) -> bool:
        """Whether the lengths are constant, as only for a vector from a filter."""
        return self.changes < _LEAST_NOISE

    @property
    def rests_at_gravity(self) -> bool:
        """Whether all rows are at rest, and their length is one g in g, mg or m/s^2."""
        return _LEAST_NOISE <= self.changes < _AT_REST and usual_unit(self.usual, _ALIKE_ONE) in ("g", "mg", "m/s2")

    @property
    def is_without_gravity(self) -> bool:
        """Whether gravity was removed: in their unit, or in any usual unit, the readings are near zero, and of no one size."""
        small = self.usual / (self.per_g or min(UNITS_PER_G.values())) < _LEAST
        return small and not (self.fit is not None and self.fit.fits)


def usual_unit(size: float, factor: float) -> str | None:
    """The usual unit in which a size is one g, to within a factor; None for none."""
    if not size > 0:
        return None
    near = min(UNITS_PER_G, key=lambda unit: abs(np.log(size / UNITS_PER_G[unit])))
    return near if 1 / factor < size / UNITS_PER_G[near] < factor else None


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


def _changes(lengths: NDArray[np.float64]) -> float:
    """Largest relative difference of nine tenths of the lengths from the usual one."""
    middle = float(np.median(lengths)) if len(lengths) else 0.0
    return float(np.quantile(np.abs(lengths / middle - 1), 0.9)) if middle > 0 else np.inf


def _spread(still: NDArray[np.float64], every: NDArray[np.float64]) -> float:
    """The range of the means at rest over that of all readings, on the axis with the largest ratio; 0 for constant columns."""
    if not len(still):
        return 0.0
    whole = np.ptp(every, axis=0)
    return float((np.ptp(still, axis=0) / np.where(whole > 0, whole, 1.0)).max())
