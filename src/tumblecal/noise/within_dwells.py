"""Changes within dwells that are common to all dwells: with the temperature, or with the time since the start of the dwell.

Such a change is not noise, because it is repeated in every dwell. It is estimated before the noise, with the dwell as the unit.
Each dwell gives one number for each axis: its block means projected on the course of the temperature (or time) in the dwell, at
unit norm. With a common change these numbers are proportional to the size of the course, with one coefficient for the bias and
one, times the reading, for the scale factor. The test is the F statistic of the regression through the origin. Its
residuals are the dispersion between dwells, so the test is valid for noise of any colour that dwells do not share.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import fdtrc

from tumblecal.data.position_comments import WITHIN_DWELLS
from tumblecal.ground.axes import AXES
from tumblecal.words import sentence


# A change is reported if it occurs by chance less often than this on an axis, for one variable: three axes and two variables
# are tried (benchmarks/within_dwells.py of commit 6ecf2b25 counted the false ones).
_P_VALUE = 5e-4
# Block means of a dwell, and the fewest samples in each.
_BLOCKS, _FEWEST = 16, 4
# Dwells in which a variable changes by less than this share of its largest change are not used for its coefficient.
_LEAST_COURSE = 0.2
# Smallest number of dwells with a change; from the second number on, a change of the scale factor is also fitted.
_LEAST_DWELLS, _WITH_SCALE = 3, 8
# A course of the temperature of less than this, degC from the first to the last block, is that of its sensor's noise.
_LEAST_DEGC = 0.05
# Two courses count as equal if the cosine between them exceeds this.
_SAME_COURSE = 0.95

# A part proportional to the reading is reported if it exceeds this share of the rest at 1 g.
_LEAST_SHARE = 0.02
TEMPERATURE, TIME = "temperature", "time"
_UNITS = {TEMPERATURE: ("mg/degC", 1e3), TIME: ("mg/min", 6e4)}


@dataclass(frozen=True)
class WithinDwells:
    """A change within dwells that is common to them.

    - `variable`: `temperature` (degC) or `time` (s) that it follows. `axes`: which axes show it.
    - `bias` (3): g per unit of the variable; `scale` (3): the same per g of the dwell's mean reading. Zero for other axes.
    - `p_value` (3): of so large a change by noise. `change` (3): by how much a dwell changes at most, g.
    - `dwells`: how many show it. `course`: the largest course of the variable in a dwell, in its unit.
    - `confounded`: whether time and temperature have the same course in the dwells, so that it may follow the other one.
    """

    variable: str
    axes: Bool[np.ndarray, "3"]
    bias: Float[np.ndarray, "3"]
    scale: Float[np.ndarray, "3"]
    p_value: Float[np.ndarray, "3"]
    change: Float[np.ndarray, "3"]
    dwells: int
    course: float
    confounded: bool

    def words(self) -> str:
        """The change with its size, and its consequence."""
        unit, factor = _UNITS[self.variable]
        axes = [
            {
                "axis": AXES[k],
                "bias": self.bias[k] * factor,
                "scale": self.scale[k] * factor * (abs(self.scale[k]) > _LEAST_SHARE * abs(self.bias[k])),
                "change_mg": self.change[k] * 1e3,
            }
            for k in np.flatnonzero(self.axes)
        ]
        least = max(float(np.min(self.p_value[self.axes])), 1e-99)
        return sentence("noise/within_dwells", n=self, axes=axes, unit=unit, p_value=least)


def within_dwells_comments(within: Sequence[WithinDwells]) -> dict[str, str]:
    """Comments of a position file on changes within dwells: in words, and the largest change (mg) by variable."""
    if not within:
        return {}
    sizes = {_size_key(change.variable): f"{1e3 * float(np.max(change.change)):.4g}" for change in within}
    return {WITHIN_DWELLS: " ".join(change.words() for change in within), **sizes}


def changes_within_dwells(comments: Mapping[str, str]) -> Iterator[tuple[str, float | None]]:
    """The changes within dwells that comments state: the variable and the largest change, g; "" and None for a file that states
    no sizes, as those of earlier versions."""
    stated = [(variable, comments[_size_key(variable)]) for variable in _UNITS if _size_key(variable) in comments]
    for variable, text in stated:
        try:
            yield variable, 1e-3 * float(text)
        except ValueError:
            yield variable, None
    if not stated and comments.get(WITHIN_DWELLS):
        yield "", None


def _size_key(variable: str) -> str:
    return f"{WITHIN_DWELLS}_{variable}_mg"


def without_common_change(
    dwells: Sequence[Float[np.ndarray, "samples 3"]],
    rate_hz: float,
    temperatures: Sequence[Float[np.ndarray, " samples"]] | None = None,
) -> tuple[list[Float[np.ndarray, "samples 3"]], tuple[WithinDwells, ...]]:
    """The samples of dwells without their common change, with the mean of each dwell unchanged; and that change.

    **Arguments:**

    - `dwells`: samples of each, g; `temperatures`: of each sample, degC, nan where unknown.
    """
    samples, found = [np.asarray(dwell, float) for dwell in dwells], []
    courses = {TIME: [_centred(np.arange(len(dwell)) / rate_hz) for dwell in dwells]}
    if temperatures is not None and all(np.isfinite(course).any() for course in temperatures):
        courses[TEMPERATURE] = [_smooth(course) for course in temperatures]
    while courses:
        tried = {name: _Scores.of(samples, course).change(name) for name, course in courses.items()}
        shown = {name: change for name, change in tried.items() if change is not None}
        if not shown:
            break
        # The one with the smaller residuals, and the temperature if both have the same course; then the other one as well.
        same_course = len(courses) > 1 and _agree(*courses.values())
        best = min(shown, key=lambda name: float(np.sum(np.log(shown[name].residual_square))))
        best = TEMPERATURE if same_course and TEMPERATURE in shown else best
        change, course = shown[best].change, courses.pop(best)
        found.append(replace(change, confounded=same_course))
        for number, part in enumerate(course):
            slopes = change.bias + change.scale * dwells[number].mean(axis=0)
            samples[number] = samples[number] - part[:, None] * slopes
    return samples, tuple(found)


def _centred(values: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " samples"]:
    return values - values.mean()


def _smooth(temperature: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " samples"]:
    """The course of the temperature about its mean, without its sensor's noise: straight lines through block means."""
    known = np.isfinite(temperature)
    filled = np.interp(np.arange(len(temperature)), np.flatnonzero(known), np.asarray(temperature, float)[known])
    size = _block_size(len(filled))
    count = len(filled) // size
    means = filled[: count * size].reshape(count, size).mean(axis=1)
    if count < 2:
        return np.zeros(len(filled))
    at = (np.arange(len(filled)) - (size - 1) / 2) / size
    piece = np.clip(np.floor(at).astype(int), 0, count - 2)
    return _centred(means[piece] + (at - piece) * (means[piece + 1] - means[piece]))


def _block_size(samples: int) -> int:
    return max(samples // _BLOCKS, min(_FEWEST, samples // 2), 1)


def _blocks(values: np.ndarray) -> np.ndarray:
    """Block means of a dwell, about their mean."""
    size = _block_size(len(values))
    count = len(values) // size
    means = values[: count * size].reshape(count, size, *values.shape[1:]).mean(axis=1)
    return means - means.mean(axis=0)


def _agree(first: Sequence[np.ndarray], second: Sequence[np.ndarray]) -> bool:
    """Whether two courses are the same up to one factor."""
    one, other = (np.concatenate([_blocks(part) for part in course]) for course in (first, second))
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return size > 0 and abs(float(one @ other)) > _SAME_COURSE * size


@dataclass(frozen=True)
class _Shown:
    """A reported change, and the residual mean square of the dwells' numbers, by axis."""

    change: WithinDwells
    residual_square: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class _Scores:
    """The projections of each dwell on a course.

    - `along` (dwells, 3): block means along the course at unit norm, g. `size`: norm of the course; `range`: from its first to
      its last sample. `reading` (dwells, 3): mean readings, g.
    """

    along: Float[np.ndarray, "dwells 3"]
    size: Float[np.ndarray, " dwells"]
    range: Float[np.ndarray, " dwells"]
    reading: Float[np.ndarray, "dwells 3"]

    @classmethod
    def of(cls, dwells: Sequence[np.ndarray], courses: Sequence[np.ndarray]) -> "_Scores":
        """Of the samples of dwells and the course in each."""
        along, size, extent = [], [], []
        for dwell, course in zip(dwells, courses, strict=True):
            blocks, means = _blocks(course), _blocks(dwell)
            norm = float(np.linalg.norm(blocks))
            along.append(blocks @ means / norm if norm > 0 else np.zeros(3))
            size.append(norm)
            extent.append(float(np.ptp(course)))
        return cls(
            np.array(along), np.array(size), np.array(extent), np.array([dwell.mean(axis=0) for dwell in dwells])
        )

    def change(self, variable: str) -> _Shown | None:
        """The change with this variable; None where no axis shows one."""
        used = self.size > _LEAST_COURSE * np.max(self.size, initial=0.0)
        if variable == TEMPERATURE:
            used &= self.range > _LEAST_DEGC
        count = int(np.sum(used))
        if count < _LEAST_DWELLS:
            return None
        size, bias, scale, p_value, residual_square = self.size[used], np.zeros(3), np.zeros(3), np.ones(3), np.zeros(3)
        for axis in range(3):
            # All dwells have equal weight; the length of the course is in its size.
            along, reading = self.along[used, axis], self.reading[used, axis]
            # A scale factor only where the readings differ.
            several = count >= _WITH_SCALE and np.ptp(reading) > 0.5
            regressors = np.column_stack([size, size * reading] if several else [size])
            values = np.linalg.lstsq(regressors, along, rcond=None)[0]
            rest = along - regressors @ values
            terms = regressors.shape[1]
            explained = float(along @ along - rest @ rest) / terms
            residual_square[axis] = max(float(rest @ rest) / (count - terms), 1e-300)
            f = explained / residual_square[axis]
            p_value[axis] = float(fdtrc(terms, count - terms, f))
            bias[axis] = values[0]
            scale[axis] = values[1] if several else 0.0
        axes = p_value < _P_VALUE
        if not axes.any():
            return None
        bias, scale = np.where(axes, bias, 0.0), np.where(axes, scale, 0.0)
        change = np.max(np.abs(bias + scale * self.reading[used]) * self.range[used, None], axis=0)
        found = WithinDwells(variable, axes, bias, scale, p_value, change, count, float(np.max(self.range)), False)
        return _Shown(found, residual_square)
