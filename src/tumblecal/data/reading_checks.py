"""Checks of readings that a calibration at rest corrects, piece by piece."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from tumblecal.ground.axes import AXES
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


# A calibration at rest covers 1 g: beyond this (g) nonlinear terms are extrapolated.
FAR_G = 2.0
# If most rows are beyond this (g), the unit in the column names is wrong.
_NO_UNIT_G = 10.0
# Relative range of the size of readings at rest in a unit.
_LIKE = (0.816, 1.183)
_ONE_G = {"g": 1.0, "mg": 1e3, "ms2": STANDARD_GRAVITY_MS2}
_NAMES = {"g": "g", "mg": "mg", "ms2": "m/s^2"}
# Largest reading at rest, g, with a bias of 0.6 g and a scale factor error of 10 %. This many consecutive equal readings at
# the end of the range occur by chance only with coarse numbers.
_RESTING_G = 1.75
_FEWEST_AT_END = 3


@dataclass
class Occurrences:
    """Number of rows, and the first one."""

    count: int = 0
    first: int = 0

    def add(self, rows: np.ndarray) -> None:
        """Count numbers of rows, in order."""
        if len(rows):
            self.first = self.first or int(rows[0])
            self.count += len(rows)


@dataclass
class _End:
    """The readings at the largest value of an axis: their index and row number, piece by piece."""

    value: float = _RESTING_G
    places: list[np.ndarray] = field(default_factory=list)

    def add(self, values: np.ndarray, rows: np.ndarray, first: int) -> None:
        largest = float(values.max())
        if largest > self.value:
            self.value, self.places = largest, []
        if largest == self.value:
            index = np.flatnonzero(values == largest)
            self.places.append(np.stack([first + index, rows[index]]))

    @property
    def saturated(self) -> Occurrences:
        """Consecutive ones of these readings."""
        found = Occurrences()
        if self.places:
            index, rows = np.concatenate(self.places, axis=1)
            for run in np.split(rows, np.flatnonzero(np.diff(index) > 1) + 1):
                found.add(run if len(run) >= _FEWEST_AT_END else run[:0])
        return found


class ReadingChecks:
    """Rows beyond the calibrated range, saturated rows, and rows that look like a different unit.

    **Arguments:**

    - `columns`: of the readings, with the unit after the last `_`. `row_word`: word for a row in messages.
    - `range_degc`: temperature range of the calibration, if known; `margin_degc`: tolerance at both ends.
    """

    def __init__(
        self, columns: Sequence[str], row_word: str = "line", range_degc: Sequence[float] = (), margin_degc: float = 0.0
    ):
        self.columns, self.row_word = columns, row_word
        self.range_degc, self.margin_degc = range_degc, margin_degc
        self.rows, self.largest = 0, 0.0
        self.far, self.no_unit, self.other_degc = Occurrences(), Occurrences(), Occurrences()
        unit = columns[0].rpartition("_")[2]
        # The size of 1 g of other units, in the unit of the columns.
        self.sizes = {other: one_g / _ONE_G[unit] for other, one_g in _ONE_G.items() if other != unit}
        self.like = {other: Occurrences() for other in self.sizes}
        self.ends = {(axis, sign): _End() for axis in AXES for sign in (1, -1)}

    def add(self, readings: Float[np.ndarray, "rows 3"], rows: Int[np.ndarray, " rows"]) -> None:
        """Check a piece of readings, in g; `rows`: the number of each row."""
        if not len(readings):
            return
        size = float(max(readings.max(), -readings.min()))
        self.largest = max(self.largest, size)
        for limit, found in ((FAR_G, self.far), (_NO_UNIT_G, self.no_unit)):
            if size > limit:
                found.add(rows[(np.abs(readings) > limit).any(1)])
        for unit, one_g in self.sizes.items():
            # The largest reading of most pieces excludes such a size.
            if size > _LIKE[0] * one_g / 2 and (one_g > 1 or size < 0.5):
                sizes = np.linalg.norm(readings, axis=1)
                self.like[unit].add(rows[(sizes > _LIKE[0] * one_g) & (sizes < _LIKE[1] * one_g)])
        if size > _RESTING_G:
            for (axis, sign), end in self.ends.items():
                end.add(sign * readings[:, AXES.index(axis)], rows, self.rows)
        self.rows += len(readings)

    def add_temperatures(self, degc: Float[np.ndarray, " rows"], rows: Int[np.ndarray, " rows"]) -> None:
        """Check the temperatures of a piece; NaN is ignored."""
        if self.range_degc:
            low, high = self.range_degc
            self.other_degc.add(rows[(degc < low - self.margin_degc) | (degc > high + self.margin_degc)])

    def words(self) -> Iterator[str]:
        """Warnings, one line each; a different unit explains all others."""
        columns = f"columns {', '.join(self.columns)}"
        for unit, at in self.like.items():
            if 2 * at.count > self.rows:
                renamed = ", ".join(f"a{axis}_{unit}" for axis in AXES)
                size = f"{self.sizes[unit]:.3g} g{self._in(at)}"
                yield f"{columns}: their norm is about {size}, so they look like {_NAMES[unit]}; name them {renamed}"
                return
        if 2 * self.no_unit.count > self.rows:
            yield (
                f"{columns}: beyond {_NO_UNIT_G:g} g{self._in(self.no_unit)}, up to {self.largest:.3g} g, so they look like "
                "counts or another unit; state it: --unit 16384/g (counts for one g), --unit mg, --unit m/s2"
            )
            return
        if self.far.count:
            yield (
                f"{self.far.count} of {self.rows} rows (the first: {self.row_word} {self.far.first}) are beyond {FAR_G:g} g, "
                f"up to {self.largest:.3g} g; the calibration was measured within 1 g, so nonlinear errors beyond are unknown"
            )
        for (axis, sign), end in self.ends.items():
            if (at := end.saturated).count:
                reading = f"{'largest' if sign > 0 else 'smallest'} reading, {sign * end.value:.6g} g"
                yield f"axis {axis} stays at its {reading}{self._in(at)}: saturated; these readings are not measurements"
        if self.other_degc.count:
            low, high = (f"{end:.4g}" for end in self.range_degc)
            measured = f"{low} degC" if low == high else f"{low} to {high} degC"
            yield (
                f"temperatures{self._in(self.other_degc)} are beyond the {measured} of the calibration; it was not measured "
                "there"
            )

    def _in(self, at: Occurrences) -> str:
        return f" in {at.count} of {self.rows} rows (the first: {self.row_word} {at.first})"
