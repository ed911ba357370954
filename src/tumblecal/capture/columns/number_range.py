"""Numbers outside the range of their type: negative numbers written as unsigned, and overflowed values.

A type of n bits is a circle of 2^n steps, cut at the ends of its range. If the readings of an axis cross this cut, the numbers
jump by nearly the full range although the reading changes little. Two ways to read such numbers are tried: as signed (the
upper half of the range is negative), and, for each axis, with every step the shorter one around the circle. A way is used only
if it removes at least nine tenths of the jumps of more than half a range, and the readings then fit gravity at least twice as
well (their distance from a sphere, or the dispersion of their size). If nothing jumps (one attitude), integers are read as
signed only if their size is then one g in a usual unit, and as written is not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import polars as pl
from numpy.typing import NDArray

from tumblecal.capture.recordings.damage import DamageRecord
from tumblecal.ground.counted import counted
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2, UNITS_PER_G


if TYPE_CHECKING:
    from tumblecal.capture.columns.units import Column

# Bits of the types of sensors and loggers.
_BITS = (8, 10, 12, 13, 14, 16, 18, 20, 24, 32)
# Number of rows for the fit, and of rows from which the step is estimated.
_FITTED_ROWS, _STEP_ROWS = 20_000, 50_000
# Overflowed numbers come this close to the ends of the range, as a share of it.
_END = 1 / 16
_BETTER = 0.5
_USUAL = 1.3
# Full scales of accelerometers, g, and the units in which they are written.
_FULL_SCALES_G = np.array([1, 1.5, 2, 3, 4, 6, 8, 12, 16, 24, 30, 32, 48, 50, 64, 100, 200, 400])
_WRITTEN_UNITS = np.array([1.0, 1000.0, STANDARD_GRAVITY_MS2, 9.8, 9.81])


Numbers = TypeVar("Numbers", NDArray, pl.Expr)


@dataclass(frozen=True)
class Wrap:
    """Correction of the numbers of a column into the range: a negative `shift` is added to numbers from `cut` on, a positive
    `shift` to numbers below it."""

    cut: float
    shift: float

    def concerns(self, numbers: Numbers) -> Numbers:
        """Mask of the numbers that change, of an array or an expression of polars."""
        return numbers >= self.cut if self.shift < 0 else numbers < self.cut

    def corrected(self, numbers: Numbers) -> Numbers:
        """The numbers within the range."""
        return numbers + self.shift * self.concerns(numbers)


Wraps = tuple[Wrap | None, ...]


def wraps_of_force(
    numbers: NDArray[np.float64], scale: NDArray[np.float64], per_g: float | None = None
) -> Wraps | None:
    """Corrections of accelerations as written (n, 3) into the range of their type; None if they are in it.

    **Arguments:**

    - `numbers`: numbers of the source, in the order of its rows. `scale` (3): a reading is `scale` times a number.
    - `per_g`: how many units of a reading are one g, if known.
    """
    numbers = numbers[np.isfinite(numbers).all(1)]
    # Equal numbers on all axes are not a reading but erased memory, or a sensor that does not answer.
    numbers = numbers[~((numbers[:, 0] == numbers[:, 1]) & (numbers[:, 0] == numbers[:, 2]))]
    if len(numbers) < 3:
        return None
    before = _jumps(numbers)
    if before.max() <= _top(numbers) / 2:
        return _of_one_attitude(numbers, scale, per_g)
    misfit = _misfit(numbers, scale)
    best: Wraps | None = None
    least = np.inf
    for full in _full_ranges(numbers, nominal=True):
        if not (before > full / 2).any():
            continue
        for wraps in _ways(numbers, full):
            corrected = _corrected(numbers, wraps)
            after = _jumps(corrected)
            if np.count_nonzero(after > full / 2) > 0.1 * np.count_nonzero(before > full / 2):
                continue
            new_misfit = _misfit(corrected, scale)
            if (new_misfit < _BETTER * misfit).any():
                # The range that follows from the step of the numbers comes first: others must be clearly better.
                best, least = (wraps, new_misfit.prod()) if new_misfit.prod() < 0.7 * least else (best, least)
                break
    return best


def wraps_of_rates(numbers: NDArray[np.float64]) -> Wraps | None:
    """Corrections of angular rates (n, k), which are near zero at rest, by their jumps alone."""
    numbers = numbers[np.isfinite(numbers).all(1)]
    if len(numbers) < 3 or (numbers < 0).any():
        return None
    before = _jumps(numbers)
    for full in _full_ranges(numbers, nominal=False):
        wraps = _signed(full, numbers.shape[1])
        jumping = np.count_nonzero(before > full / 2)
        if jumping >= 3 and np.count_nonzero(_jumps(_corrected(numbers, wraps)) > full / 2) <= 0.1 * jumping:
            return wraps
    return None


def wrapped_record(columns: Sequence["Column"], rows: int, first: int) -> DamageRecord:
    """The damage record of corrected numbers in columns."""
    names, wraps = [column.name for column in columns], [column.wrap for column in columns if column.wrap]
    signed = all(wrap.shift < 0 and wrap.cut == -wrap.shift / 2 for wrap in wraps)
    shifts = sorted({f"{abs(wrap.shift):.9g}" for wrap in wraps})
    where = f"{', '.join(names)}: {counted(rows, 'row')}, first row {first}"
    words = (
        f"{where}: negative numbers written as unsigned ones; {' or '.join(shifts)} subtracted from the upper half of the range"
        if signed
        else f"{where}: numbers outside the range of their type; corrected by {' or '.join(shifts)}, one full range"
    )
    kind, largest = "unsigned" if signed else "overflow", max(abs(wrap.shift) for wrap in wraps)
    return DamageRecord(kind, words, "", "corrected", rows, first, largest, "number of the source")


def _corrected(numbers: NDArray[np.float64], wraps: Wraps) -> NDArray[np.float64]:
    columns = [wrap.corrected(column) if wrap else column for wrap, column in zip(wraps, numbers.T, strict=True)]
    return np.stack(columns, axis=1)


def _jumps(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest step from row to row of any axis."""
    return np.abs(np.diff(numbers, axis=0)).max(1, initial=0.0)


def _signed(full: float, count: int) -> Wraps:
    return (Wrap(full / 2, -full),) * count


def _ways(numbers: NDArray[np.float64], full: float) -> list[Wraps]:
    """The ways to read numbers of a type with this full range."""
    ways = [_signed(full, numbers.shape[1])] if (numbers >= 0).all() else []
    by_axis = tuple(_around_the_circle(column, full) for column in numbers.T)
    return [*ways, by_axis] if any(by_axis) else ways


def _around_the_circle(numbers: NDArray[np.float64], full: float) -> Wrap | None:
    """Changes of the numbers if every step is the shorter one around the circle and the range is the one nearest to zero."""
    lowest = 0.0 if numbers.min() >= 0 else -full / 2
    ends = numbers.min() - lowest, lowest + full - numbers.max()
    if max(ends) > _END * full:
        return None
    along = np.unwrap(numbers, period=full)
    along -= full * np.round((along.max() + along.min()) / (2 * full))
    moved = np.round((along - numbers) / full)
    shifts = np.unique(moved)
    if np.ptp(along) >= full or len(shifts) != 2 or 0 not in shifts:
        return None
    shift = float(shifts[shifts != 0][0])
    other, unmoved = (numbers[moved != 0], numbers[moved == 0])[:: 1 if shift > 0 else -1]
    # Numbers below the cut are moved up, or numbers above it down.
    return Wrap((other.max() + unmoved.min()) / 2, shift * full) if other.max() < unmoved.min() else None


def _top(numbers: NDArray[np.float64]) -> float:
    """Lower limit of a full range."""
    return float(numbers.max()) if numbers.min() >= 0 else 2 * float(np.abs(numbers).max())


def _full_ranges(numbers: NDArray[np.float64], *, nominal: bool) -> list[float]:
    """Possible full ranges of the type of these numbers: a power of two of their step, then those of usual full scales."""
    top = _top(numbers)
    if top <= 0:
        return []
    integers = bool((numbers == np.round(numbers)).all())
    step = 1.0 if integers else step_of(numbers)
    ranges = []
    if step:
        # The largest number of 16 bits is 65535; with a sign, the largest is 32767 and the smallest -32768.
        bits = (round(top / step) - int(numbers.min() < 0)).bit_length()
        ranges += [step * 2.0**bit for bit in _BITS if bit >= bits][:1]
    if nominal and not integers:
        usual = np.unique(2 * np.outer(_FULL_SCALES_G, _WRITTEN_UNITS))
        # Across the empty stretch, the count of rounded steps may differ by one.
        ranges = [
            float(usual[np.argmin(np.abs(usual - value))]) for value in ranges if np.abs(usual - value).min() < 2 * step
        ] or ranges
        ranges += usual[(usual > top * (1 - 1e-9)) & (usual < 2 * top)].tolist()
    return ranges


def step_of(numbers: NDArray[np.float64]) -> float:
    """The step of which all numbers are multiples, to within their digits; 0 if there is none."""
    values = np.unique(numbers[:_STEP_ROWS])
    differences = np.diff(values)
    if not len(differences):
        return 0.0
    differences[differences < 1e-9 * (values[-1] - values[0])] = np.inf
    smallest = differences.min()
    # Truncated digits make equal steps differ.
    step = float(differences[differences < 1.6 * smallest].mean())
    away = np.sort(np.abs(values - values[int(np.argmin(differences))]))[1:]
    reach, residual = 4 * step, 0.0
    while True:
        near = away[away <= reach]
        multiple = np.round(near / step)
        step = float(near @ multiple / (multiple @ multiple)) if multiple.any() else step
        residual = float(np.sqrt(np.mean((near / step - multiple) ** 2))) if len(near) else 0.0
        if reach >= away[-1] or residual > 0.2:
            return step if residual <= 0.2 else 0.0
        reach *= 4


def _misfit(numbers: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Misfit of readings to gravity, in their unit: typical distance from a sphere of any centre, dispersion of the size."""
    force = (numbers * scale)[:: max(1, len(numbers) // _FITTED_ROWS)]
    squares = (force**2).sum(1)
    unit = float(np.abs(force).max()) or 1.0
    design = np.column_stack([force / unit, np.ones(len(force))])
    fitted = np.linalg.lstsq(design, squares / unit**2, rcond=None)[0]
    residual = np.abs(squares / unit**2 - design @ fitted)
    radius = float(np.sqrt(max(fitted[3] + (fitted[:3] ** 2).sum() / 4, 1e-12)))
    size = np.sqrt(squares)
    return np.array([unit * np.median(residual) / (2 * radius), np.quantile(size, 0.9) - np.quantile(size, 0.1)])


def _of_one_attitude(numbers: NDArray[np.float64], scale: NDArray[np.float64], per_g: float | None) -> Wraps | None:
    if (numbers < 0).any() or (numbers != np.round(numbers)).any():
        return None
    (full,) = _full_ranges(numbers, nominal=False) or [0.0]
    wraps = _signed(full, numbers.shape[1])
    corrected = _corrected(numbers, wraps)
    if not full or (_jumps(numbers) > full / 2).any() or np.abs(corrected).max() > 0.45 * full:
        return None
    usual = [per_g] if per_g else list(UNITS_PER_G.values())

    def one_g(values: NDArray[np.float64]) -> bool:
        size = float(np.median(np.linalg.norm(values * scale, axis=1)))
        return any(1 / _USUAL < size / unit < _USUAL for unit in usual)

    return wraps if one_g(corrected) and not one_g(numbers) else None
