"""The noise models that are alternatives to equal, white, Gaussian noise: unequal axes or settings, more noise for large
inputs, a wrong level, noise coloured in time, scatter of the attitude, heavy tails.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import log, sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tumblecal.chain import Where
from tumblecal.diagnosis.priors import (
    ATTITUDE_SCATTERS,
    AXIS_RATIOS,
    CORRELATIONS,
    GROUP_RATIOS,
    GROUP_SHARE,
    LARGEST_FACTOR,
    LEAST_IN_GROUP,
    LEVEL_WEIGHT,
    MOST_GROUPS,
    NOISE_WEIGHT,
    PER_INPUT,
    PER_INPUT_SHARE,
    SMALLEST_FACTOR,
    TAILS,
)
from tumblecal.effects import AXES
from tumblecal.estimation.problem import Problem
from tumblecal.full_model.tangent import Tangent
from tumblecal.noise.covariance import Covariance


# Kinds of alternatives, which share the weight of all: unequal axes, colour, tails, attitude.
_WEIGHT = log(NOISE_WEIGHT / 4)
LEVEL = "level"
# Noise that is larger in a part of the readings: by the columns that define the part, in words, or by the input.
_PARTS, _BY_INPUT = {"pitch": "at beta", "run": "in run", "mount": "in mounting"}, "input"
NOISIER = (*_PARTS, _BY_INPUT)


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

    def compared(self, relative: Float[np.ndarray, " groups"]) -> str:
        """By how much their sd differ."""
        if self.part:
            return f"{self.names[0]} {relative[0] / relative[1]:.2g} times that {self.names[1]}"
        return f"of the axes as {self.listed(relative)}"


class Family(NamedTuple):
    """Noise models that differ by a number, which may be refined: the covariance of the weighted rows at a level, the `levels`
    tried, and `words` for a level and the sd of the weighted rows."""

    covariance: Callable[[float], Covariance]
    levels: tuple[float, ...]
    words: Callable[[float, float], str]


@dataclass(frozen=True)
class NoiseModel:
    """A different distribution of the noise.

    - `label`: catalogue id; `words`: which one; `log_weight`: prior.
    - `covariance`: of the readings' white rows; if `of_means`, of their means over repeats and differences
      (`repeats.Repeats`).
    - `family`: for a member of a continuous family, the covariance by `level`.
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
    where, positions = at.problem.where, len(at.problem.readings)
    listed = [*_of_groups(positions, _parts(where)), *_coloured(tuple(where.measuring_order.tolist()))]
    if not at.model.hand_held:
        # Free tilts take up any error of a position's attitude.
        listed += _attitude(at)
    return listed + _with_inputs(at.evaluation.inputs.ravel()) + _of_all_readings(positions, at.problem.known)


def _of_family(label: str, family: Family, share: float, kind: str = "") -> list[NoiseModel]:
    """The members of a family, which divide its share of the prior."""
    return [
        NoiseModel(
            label,
            family.words(level, 1.0),
            _WEIGHT + log(share / len(family.levels)),
            family.covariance(level),
            family=family,
            level=level,
            kind=kind,
        )
        for level in family.levels
    ]


def _parts(where: Where) -> tuple[tuple[str, tuple[int, ...], tuple[str, ...]], ...]:
    """The columns that divide the positions into pitch settings, runs or mountings: the part of each position and the names."""
    parts = []
    for column in _PARTS:
        index, names = np.asarray(where.index(column)), [name.partition("=")[2] for name in where.names(column)]
        if len(names) < 2:
            continue
        if column == "pitch":
            first = np.unique(index, return_index=True)[1]
            names = [f"{np.round(angle, 3):g} deg" for angle in np.degrees(np.asarray(where.pitch_angle)[first])]
        parts.append((column, tuple(index.tolist()), tuple(names)))
    return tuple(parts)


@lru_cache(maxsize=64)
def _of_groups(
    positions: int, parts: tuple[tuple[str, tuple[int, ...], tuple[str, ...]], ...]
) -> tuple[NoiseModel, ...]:
    """One axis noisier or less noisy than the others; one pitch setting, run or mounting noisier than the others."""
    axes = NoiseGroups(np.tile(np.arange(3), positions), tuple(AXES))
    made = [
        _of_ratio(axes, axis, ratio, 1.0 / (len(AXES) * len(AXIS_RATIOS)), f"of axis {AXES[axis]}")
        for ratio in AXIS_RATIOS
        for axis in range(len(AXES))
    ]
    for column, index, names in parts:
        several = np.flatnonzero(np.bincount(index) >= LEAST_IN_GROUP).tolist()
        for number in several if len(several) <= MOST_GROUPS else ():
            words = f"{_PARTS[column]} {names[number]}"
            groups = NoiseGroups(np.repeat(np.array(index) != number, 3).astype(int), (words, "elsewhere"), part=True)
            share = GROUP_SHARE / (len(several) * len(GROUP_RATIOS))
            made += [_of_ratio(groups, 0, ratio, share, words, column) for ratio in GROUP_RATIOS]
    return tuple(made)


def _of_ratio(groups: NoiseGroups, group: int, ratio: float, share: float, words: str, kind: str = "") -> NoiseModel:
    """One group's sd times a ratio."""
    covariance = Covariance(np.where(groups.of_rows == group, ratio**2, 1.0), "rows")
    words = f"sd {words} times {ratio:g}"
    return NoiseModel("noise_unequal", words, _WEIGHT + log(share), covariance, kind=kind, groups=groups)


def _with_inputs(inputs: Float[np.ndarray, " rows"]) -> list[NoiseModel]:
    """The noise of every reading grows with its input, as that of a scale factor does, or of a table that shakes."""
    family = Family(
        lambda level: Covariance(1.0 + (level * inputs) ** 2, "rows"),
        PER_INPUT,
        lambda level, _: f"sd for an input of 1 g {sqrt(1 + level**2):.2g} times that for none",
    )
    return _of_family("noise_unequal", family, PER_INPUT_SHARE, _BY_INPUT)


@lru_cache(maxsize=64)
def _of_all_readings(positions: int, known: bool) -> list[NoiseModel]:
    """All sd wrong by one factor, if they are stated; heavy tails."""
    equal, share = Covariance(np.ones(3 * positions), "rows"), _WEIGHT - log(len(TAILS))
    level = log(LEVEL_WEIGHT) - log(log(LARGEST_FACTOR / SMALLEST_FACTOR))
    levels = [NoiseModel("noise_level", "every sd times one factor", level, equal, kind=LEVEL)] if known else []
    return levels + [
        NoiseModel("noise_heavy_tail", f"Student's t with {tail:g} degrees of freedom", share, equal, tail=tail)
        for tail in TAILS
    ]


# Few plans: of a thousand positions each covariance needs 8 MB.
@lru_cache(maxsize=4)
def _coloured(order: tuple[float, ...]) -> list[NoiseModel]:
    """Noise coloured in time, positions measured in this order."""
    family = Family(
        lambda level: coloured(np.array(order), level),
        CORRELATIONS,
        lambda level, _: f"correlation {level:.2g} between neighbouring positions",
    )
    return _of_family("noise_coloured", family, 1.0)


def coloured(time: Float[np.ndarray, " positions"], correlation: float) -> Covariance:
    """Exponentially correlated noise, the same for each axis, variance one; time in steps."""
    return Covariance(np.exp(np.log(correlation) * np.abs(time[:, None] - time[None, :])), "between")


def _attitude(at: Tangent) -> list[NoiseModel]:
    """Scatter of the attitude from position to position.

    A small rotation w moves the reading by w x f: for any distribution about the vertical, the error is perpendicular to f, of
    the same variance in both directions.
    """
    f, unit = at.evaluation.inputs, float(np.median(1.0 / at.problem.sd))
    across = np.vecdot(f, f)[:, None, None] * np.eye(3) - f[:, :, None] * f[:, None, :]
    family = Family(
        lambda level: _attitude_covariance(across, at.problem, level / unit),
        ATTITUDE_SCATTERS,
        lambda level, sigma: (
            f"the attitude scatters by {level * sigma / unit * 1e3:.2g} mrad from position to position"
        ),
    )
    return _of_family("noise_attitude", family, 1.0)


def _attitude_covariance(across: Float[np.ndarray, "positions 3 3"], problem: Problem, scatter: float) -> Covariance:
    """Covariance of the white rows where every position's attitude is in error by a random rotation of this sd (rad, for g =
    1), and white noise of variance one."""
    blocks = across * scatter**2
    if problem.correlated:
        whitening, count = problem.whitening_matrix, problem.readings.size
        return Covariance(whitening @ Covariance(blocks, "blocks").matrix @ whitening.T + np.eye(count), "full")
    weights = 1.0 / problem.sd
    return Covariance(blocks * weights[:, :, None] * weights[:, None, :] + np.eye(3), "blocks")


def noisier_readings(models: Sequence[NoiseModel]) -> list[NoiseModel]:
    """Those that make some readings noisier than the noise as assumed and none less noisy, without correlation in time."""

    def noisier(model: NoiseModel) -> bool:
        values, form = model.covariance.values, model.covariance.form
        unequal = form == "rows" and np.min(values) >= 1.0 and (np.ptp(values) > 0.0 or model.tail is not None)
        return form == "blocks" or bool(unequal)

    return [model for model in models if noisier(model)]
