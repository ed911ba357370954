"""Checks of readings that a calibration at rest corrects, piece by piece."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from tumblecal.ground.axes import AXES
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2, UNITS


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
    """Readings at the largest value of an axis; the last `run` of them end the previous piece, with the rows `last`."""

    value: float = _RESTING_G
    at: Occurrences = field(default_factory=Occurrences)
    run: int = 0
    last: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    def add(self, values: np.ndarray, rows: np.ndarray) -> None:
        largest = float(values.max())
        if largest > self.value:
            self.value, self.at, self.run = largest, Occurrences(), 0
        if largest < self.value or largest <= _RESTING_G:
            self.run = 0
            return
        edges = np.flatnonzero(np.diff(np.concatenate([[False], values == largest, [False]]).astype(np.int8)))
        for start, stop in edges.reshape(-1, 2):
            before = self.run if start == 0 else 0
            if before + stop - start >= _FEWEST_AT_END:
                earlier = 0 if before >= _FEWEST_AT_END else before
                self.at.add(np.append(self.last[len(self.last) - earlier :], rows[start:stop]))
        self.last = np.append(self.last, rows)[-_FEWEST_AT_END:]
        self.run = int(edges[-1] - edges[-2] + (self.run if edges[-2] == 0 else 0)) if edges[-1] == len(values) else 0


class ReadingChecks:
    """Rows beyond the calibrated range, saturated rows, and rows that look like a different unit.

    **Arguments:**

    - `columns`: of the readings, with the unit after the last `_`. `row_word`: word for a row in messages.
    - `range_degc`: temperature range of the calibration, if known; `margin_degc`: tolerance at both ends.
    """

    columns: Sequence[str]
    row_word: str
    range_degc: Sequence[float]
    other_degc: Occurrences
    margin_degc: float
    rows: int
    largest: float
    far: Occurrences
    no_unit: Occurrences
    like: dict[str, Occurrences]
    ends: dict[tuple[str, int], _End]

    def __init__(
        self,
        columns: Sequence[str],
        row_word: str = "line",
        range_degc: Sequence[float] = (),
        margin_degc: float = 0.0,
    ):
        self.columns, self.row_word, self.range_degc = columns, row_word, range_degc
        self.other_degc, self.margin_degc = Occurrences(), margin_degc
        self.rows, self.largest = 0, 0.0
        self.far, self.no_unit = Occurrences(), Occurrences()
        self.like = {unit: Occurrences() for unit in UNITS if unit != self.unit}
        self.ends = {(axis, sign): _End() for axis in AXES for sign in (1, -1)}

    @property
    def unit(self) -> str:
        """Unit in the names of the columns."""
        return self.columns[0].rpartition("_")[2]

    def add(self, readings: Float[np.ndarray, "rows 3"], rows: Int[np.ndarray, " rows"]) -> None:
        """Check a piece of readings, in g; `rows`: the number of each row."""
        if not len(readings):
            return
        self.rows += len(readings)
        most, least = readings.max(0), readings.min(0)
        size = float(max(most.max(), -least.min()))
        self.largest = max(self.largest, size)
        if size > FAR_G:
            self.far.add(rows[(np.abs(readings) > FAR_G).any(1)])
        if size > _NO_UNIT_G:
            self.no_unit.add(rows[(np.abs(readings) > _NO_UNIT_G).any(1)])
        bands = {unit: _ONE_G[unit] / _ONE_G[self.unit] for unit in self.like}
        # The largest reading of most pieces excludes such a size.
        bands = {
            unit: one_g for unit, one_g in bands.items() if size > _LIKE[0] * one_g / 2 and (one_g > 1 or size < 0.5)
        }
        if bands:
            sizes = np.linalg.norm(readings, axis=1)
            for unit, one_g in bands.items():
                near = (sizes > _LIKE[0] * one_g) & (sizes < _LIKE[1] * one_g)
                self.like[unit].add(rows[near])
        if size > _RESTING_G:
            for k, axis in enumerate(AXES):
                self.ends[axis, 1].add(readings[:, k], rows)
                self.ends[axis, -1].add(-readings[:, k], rows)
        else:
            for end in self.ends.values():
                end.run = 0

    def add_temperatures(self, degc: Float[np.ndarray, " rows"], rows: Int[np.ndarray, " rows"]) -> None:
        """Check the temperatures of a piece; NaN is ignored."""
        if self.range_degc:
            low, high = self.range_degc
            beyond = (degc < low - self.margin_degc) | (degc > high + self.margin_degc)
            self.other_degc.add(rows[beyond])

    def words(self) -> Iterator[str]:
        """Warnings, one line each; a different unit explains all others."""
        for unit, at in self.like.items():
            if 2 * at.count > self.rows:
                size = f"{_ONE_G[unit] / _ONE_G[self.unit]:.3g}"
                renamed = ", ".join(f"a{axis}_{unit}" for axis in AXES)
                yield (
                    f"columns {', '.join(self.columns)}: their norm is about {size} g{self._in(at)}, so they look like "
                    f"{_NAMES[unit]}; name them {renamed}"
                )
                return
        if 2 * self.no_unit.count > self.rows:
            yield (
                f"columns {', '.join(self.columns)}: beyond {_NO_UNIT_G:g} g{self._in(self.no_unit)}, up to {self.largest:.3g} "
                "g, so they look like counts or another unit; state it: --unit 16384/g (counts for one g), --unit mg, --unit "
                "m/s2"
            )
            return
        if self.far.count:
            yield (
                f"{self.far.count} of {self.rows} rows (the first: {self._place(self.far)}) are beyond {FAR_G:g} g, "
                f"up to {self.largest:.3g} g; the calibration was measured within 1 g, so nonlinear errors beyond are "
                "unknown"
            )
        for (axis, sign), end in self.ends.items():
            if end.at.count:
                reading = f"{'largest' if sign > 0 else 'smallest'} reading, {sign * end.value:.6g} g"
                yield (
                    f"axis {axis} stays at its {reading}{self._in(end.at)}: saturated; these readings are not measurements"
                )

        if self.other_degc.count:
            low, high = (f"{end:.4g}" for end in self.range_degc)
            measured = f"{low} degC" if low == high else f"{low} to {high} degC"
            yield (
                f"temperatures{self._in(self.other_degc)} are beyond the {measured} of the calibration; "
                "it was not measured there"
            )

    def _in(self, at: Occurrences) -> str:
        return f" in {at.count} of {self.rows} rows (the first: {self._place(at)})"

    def _place(self, at: Occurrences) -> str:
        return f"{self.row_word} {at.first}"
