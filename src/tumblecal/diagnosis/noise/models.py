"""The noise models that are tried against equal, white, Gaussian noise: unequal axes or settings, more for large inputs, a
wrong level, coloured in time, scatter of the attitude, heavy tails.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import log, sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.diagnosis.model.tangent import Tangent
from tumblecal.diagnosis.noise.covariances import across, attitude, coloured
from tumblecal.diagnosis.priors import LEVEL_WEIGHT, NOISE_WEIGHT
from tumblecal.effects import AXES
from tumblecal.noise.covariance import Covariance


_RATIOS = (0.25, 0.5, 2.0, 3.0, 5.0, 9.0)
# By how much noisier a pitch setting, run or mounting is, and, for an input of 1 g, what comes with the input than the rest.
_GROUP_RATIOS, _PER_INPUT = (2.0, 4.0, 9.0), (1.5, 4.0, 12.0)
# What fewer positions have in common is no noise, and of more groups none is looked at.
_LEAST_IN_GROUP, _MOST_GROUPS = 4, 12
# Prior frequency of these, relative to unequal axes.
_GROUP_SHARE, _PER_INPUT_SHARE = 0.5, 0.25
# By how much a stated sd may be wrong: any factor between these, its logarithm uniform.
_LEAST_FACTOR, _MOST_FACTOR = 0.1, 100.0
_CORRELATIONS = (0.3, 0.5, 0.7, 0.85, 0.95)
_TAILS = (2.0, 4.0)
# Scatter of the attitude from position to position, in noise standard deviations of a reading, for 1 g.
_ATTITUDES = (2.0, 5.0, 15.0, 50.0, 200.0)
# Kinds of alternatives, which share the weight of all: unequal axes, colour, tails, attitude.
_KINDS = 4
_WEIGHT = log(NOISE_WEIGHT / _KINDS)
LEVEL = "level"
# Noise that is larger in a part of the readings: by the columns that define the part, in words, or by the input.
_PARTS, _BY_INPUT = {"pitch": "at beta", "run": "in run", "mount": "in mounting"}, "input"
NOISIER = (*_PARTS, _BY_INPUT)


@dataclass(frozen=True)
class Family:
    """Noise models that differ by a number.

    `covariance` of the weighted rows at a level; the `levels` tried; `words` for a level and the sd of the weighted rows.
    """

    covariance: Callable[[float], Covariance]
    levels: tuple[float, ...]
    words: Callable[[float, float], str]


class NoiseGroups(NamedTuple):
    """Groups of readings with different standard deviations: group of each row, and names of the groups (the axes, or a part
    of the readings (`part`) and the others)."""

    of_rows: Int[np.ndarray, " rows"]
    names: tuple[str, ...]
    part: bool = False

    def listed(self, sd: Float[np.ndarray, " groups"]) -> str:
        """A number for each group in words."""
        pairs = zip(self.names, sd, strict=True)
        return ", ".join(f"{own:.2g} {name}" if self.part else f"{name} {own:.2g}" for name, own in pairs)

    def told(self, relative: Float[np.ndarray, " groups"]) -> str:
        """By how much their sd differ."""
        if self.part:
            return f"{self.names[0]} {relative[0] / relative[1]:.2g} times that {self.names[1]}"
        return f"of the axes as {self.listed(relative)}"


@dataclass(frozen=True)
class NoiseModel:
    """A different distribution of the noise.

    - `label`: catalogue id; `words`: which one; `log_weight`: prior.
    - `covariance`: of the readings' white rows; if `of_means`, of their means over repeats and differences
      (`repeats.Repeats`).
    - `family`: for a member of a continuous family, the covariance by `level`, which may be refined.
    - `groups`: if groups of readings have different standard deviations.
    - `recorded`: whether a recording suggests it as the noise, so that it is no fault of the noise.
    - `tail`: degrees of freedom of Student's t, if single readings have heavy tails.
    - `kind`: distinguishes models with the same label. `LEVEL`: the standard deviation of all readings is in error by one
      factor of any size, and the noise counts as unknown.
    """

    label: str
    words: str
    log_weight: float
    covariance: Covariance
    tail: float | None = None
    family: Family | None = None
    level: float = 1.0
    kind: str = ""
    groups: NoiseGroups | None = None
    of_means: bool = False
    recorded: bool = False


def noise_models(at: Tangent) -> list[NoiseModel]:
    """The noise models that are tried for one problem."""
    positions = len(at.problem.readings)
    listed = [*_unequal(positions), *_by_group(at), *([_level(positions)] if at.problem.known else [])]
    for label, family in _families(at).items():
        share = _WEIGHT - log(len(family.levels))
        for level in family.levels:
            words, covariance = family.words(level, 1.0), family.covariance(level)
            listed.append(NoiseModel(label, words, share, covariance, family=family, level=level))
    listed += _with_inputs(at)
    return [*listed, *_heavy_tails(positions)]


@lru_cache(maxsize=64)
def _unequal(positions: int) -> list[NoiseModel]:
    """One axis noisier or less noisy than the others."""
    listed, share = [], _WEIGHT - log(3 * len(_RATIOS))
    for ratio in _RATIOS:
        for axis in range(3):
            spread = np.ones((positions, 3))
            spread[:, axis] = ratio
            words = f"sd of axis {AXES[axis]} times {ratio:g}"
            covariance = Covariance(spread.ravel() ** 2, "rows")
            listed.append(NoiseModel("noise_unequal", words, share, covariance, groups=_of_axes(positions)))
    return listed


def _of_axes(positions: int) -> NoiseGroups:
    return NoiseGroups(np.tile(np.arange(3), positions), tuple(AXES))


def _by_group(at: Tangent) -> list[NoiseModel]:
    """One pitch setting, run or mounting noisier than the others."""
    where, listed = at.problem.where, list[NoiseModel]()
    for column, words in _PARTS.items():
        own, names = np.asarray(where.index(column)), [name.partition("=")[2] for name in where.names(column)]
        several = np.flatnonzero(np.bincount(own) >= _LEAST_IN_GROUP).tolist()
        if len(names) < 2 or not 0 < len(several) <= _MOST_GROUPS:
            continue
        if column == "pitch":
            angles = [np.degrees(where.pitch_angle[own == number][0]) for number in range(len(names))]
            names = [f"{np.round(angle, 3):g} deg" for angle in angles]
        share = _WEIGHT + log(_GROUP_SHARE / (len(several) * len(_GROUP_RATIOS)))
        for number in several:
            name, here = names[number], np.repeat(own == number, 3)
            groups = NoiseGroups(np.where(here, 0, 1), (f"{words} {name}", "elsewhere"), part=True)
            for ratio in _GROUP_RATIOS:
                covariance = Covariance(np.where(here, ratio**2, 1.0), "rows")
                told = f"sd {words} {name} times {ratio:g}"
                listed.append(NoiseModel("noise_unequal", told, share, covariance, kind=column, groups=groups))
    return listed


def _with_inputs(at: Tangent) -> list[NoiseModel]:
    """The noise of every reading grows with its input, as that of a scale factor does, or of a table that shakes."""
    inputs = at.evaluation.inputs.ravel()
    family = Family(
        lambda level: Covariance(1.0 + (level * inputs) ** 2, "rows"),
        _PER_INPUT,
        lambda level, sigma: f"sd for an input of 1 g {sqrt(1 + level**2):.2g} times that for none",
    )
    share = _WEIGHT + log(_PER_INPUT_SHARE / len(_PER_INPUT))
    return [
        NoiseModel(
            "noise_unequal", family.words(level, 1.0), share, family.covariance(level), None, family, level, _BY_INPUT
        )
        for level in _PER_INPUT
    ]


@lru_cache(maxsize=64)
def _level(positions: int) -> NoiseModel:
    """All sd wrong by one factor."""
    share = log(LEVEL_WEIGHT) - log(log(_MOST_FACTOR / _LEAST_FACTOR))
    equal = Covariance(np.ones(3 * positions), "rows")
    return NoiseModel("noise_level", "every sd times one factor", share, equal, kind=LEVEL)


@lru_cache(maxsize=64)
def _heavy_tails(positions: int) -> list[NoiseModel]:
    equal, share = Covariance(np.ones(3 * positions), "rows"), _WEIGHT - log(len(_TAILS))
    return [
        NoiseModel("noise_heavy_tail", f"Student's t with {tail:g} degrees of freedom", share, equal, tail=tail)
        for tail in _TAILS
    ]


@lru_cache(maxsize=64)
def _coloured(order: tuple[float, ...]) -> dict[float, Covariance]:
    """Noise coloured in time by its correlation between neighbours, positions measured in this order."""
    return {correlation: coloured(np.array(order), correlation) for correlation in _CORRELATIONS}


def _families(at: Tangent) -> dict[str, Family]:
    unit, order = float(np.median(1.0 / at.problem.sd)), at.problem.where.measuring_order
    in_time, of_attitude = _coloured(tuple(order.tolist())), across(at)
    families = {
        "noise_coloured": Family(
            lambda level: in_time[level] if level in in_time else coloured(order, level),
            _CORRELATIONS,
            lambda level, sigma: f"correlation {level:.2g} between neighbouring positions",
        ),
        "noise_attitude": Family(
            lambda level: attitude(of_attitude, at.problem, level / unit),
            _ATTITUDES,
            lambda level, sigma: (
                f"the attitude scatters by {level * sigma / unit * 1e3:.2g} mrad from position to position"
            ),
        ),
    }
    if at.model.hand_held:
        # Its own tilts take up whatever a position's attitude does.
        del families["noise_attitude"]
    return families
