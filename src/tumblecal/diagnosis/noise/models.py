"""The noise models that are alternatives to equal, white, Gaussian noise, as covariances with a level that is tried in steps:
unequal axes or settings, more noise for large inputs, a wrong level, noise coloured in time, scatter of the attitude, heavy
tails.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from math import log, sqrt

import numpy as np
from jaxtyping import Float, Int

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


@dataclass(frozen=True)
class NoiseModel:
    """A different distribution of the noise.

    - `label`: catalogue id; `words`: which one; `log_weight`: prior.
    - `covariance`: of the readings' white rows; if `of_means`, of their means over repeats and differences
      (`repeats.Repeats`).
    - `kind`: distinguishes models with the same label. `LEVEL`: the standard deviation of all readings is in error by one
      factor of any size, and the noise counts as unknown.
    - `tail`: degrees of freedom of Student's t, if single readings have heavy tails.
    - `groups`: if groups of readings have different standard deviations, the group of each row; `names`: of the groups.
    - `at_level`: the covariance by its level, for a member of a continuous family, with the `levels` tried, the own one
      first; `described`: words for a level and the sd of the weighted rows.
    - `recorded`: whether a recording suggests it as the noise, so that it is no fault of the noise.
    """

    label: str
    words: str
    log_weight: float
    covariance: Covariance
    kind: str = ""
    tail: float | None = None
    groups: Int[np.ndarray, " rows"] | None = None
    names: tuple[str, ...] = ()
    at_level: Callable[[float], Covariance] | None = None
    levels: tuple[float, ...] = ()
    described: Callable[[float, float], str] | None = None
    of_means: bool = False
    recorded: bool = False


def noise_models(at: Tangent) -> list[NoiseModel]:
    """The noise models that are tried for one problem."""
    problem, inputs = at.problem, at.evaluation.inputs
    count, equal = problem.readings.size, Covariance(np.ones(problem.readings.size), "rows")
    listed = _of_groups(problem)
    order = tuple(problem.where.measuring_order.tolist())
    listed += _of_family(
        "noise_coloured",
        CORRELATIONS,
        1.0,
        partial(coloured, order),
        lambda level, _: f"correlation {level:.2g} between neighbouring positions",
    )
    if not at.model.hand_held:
        # Free tilts take up any error of a position's attitude. A small rotation w moves the reading by w x f: for any
        # distribution about the vertical the error is perpendicular to f, of the same variance in both directions.
        unit = float(np.median(1.0 / problem.sd))
        across = np.vecdot(inputs, inputs)[:, None, None] * np.eye(3) - inputs[:, :, None] * inputs[:, None, :]
        listed += _of_family(
            "noise_attitude",
            ATTITUDE_SCATTERS,
            1.0,
            lambda level: _scattered(across * (level / unit) ** 2, problem),
            lambda level, sigma: (
                f"the attitude scatters by {level * sigma / unit * 1e3:.2g} mrad from position to position"
            ),
        )
    # The noise of every reading grows with its input, as that of a scale factor does, or of a table that shakes.
    listed += _of_family(
        "noise_unequal",
        PER_INPUT,
        PER_INPUT_SHARE,
        lambda level: Covariance(1.0 + (level * inputs.ravel()) ** 2, "rows"),
        lambda level, _: f"sd for an input of 1 g {sqrt(1 + level**2):.2g} times that for none",
        _BY_INPUT,
    )
    if problem.known:
        weight, every = log(LEVEL_WEIGHT) - log(log(LARGEST_FACTOR / SMALLEST_FACTOR)), np.zeros(count, int)
        listed.append(
            NoiseModel("noise_level", "every sd times one factor", weight, equal, LEVEL, groups=every, names=("",))
        )
    for tail in TAILS:
        words = f"Student's t with {tail:g} degrees of freedom"
        listed.append(NoiseModel("noise_heavy_tail", words, _WEIGHT - log(len(TAILS)), equal, tail=tail))
    return listed


def _of_family(
    label: str,
    levels: tuple[float, ...],
    share: float,
    at_level: Callable[[float], Covariance],
    described: Callable[[float, float], str],
    kind: str = "",
) -> list[NoiseModel]:
    """The members of a family, which divide its share of the prior."""
    made = partial(NoiseModel, label, log_weight=_WEIGHT + log(share / len(levels)), kind=kind)
    return [
        made(
            words=described(level, 1.0),
            covariance=at_level(level),
            at_level=at_level,
            levels=(level, *levels),
            described=described,
        )
        for level in levels
    ]


def _of_groups(problem: Problem) -> list[NoiseModel]:
    """One axis noisier or less noisy than the others; one pitch setting, run or mounting noisier than the others."""
    where, positions = problem.where, len(problem.readings)
    by_axis, share = np.tile(np.arange(3), positions), 1.0 / (len(AXES) * len(AXIS_RATIOS))
    # Rows of each group, which of them is noisier, names of the groups, words, ratios, share of each, kind.
    tried = list[tuple[np.ndarray, int, tuple[str, ...], str, tuple[float, ...], float, str]]()
    tried += [(by_axis, k, tuple(AXES), f"of axis {axis}", AXIS_RATIOS, share, "") for k, axis in enumerate(AXES)]
    for column, words in _PARTS.items():
        index, names = np.asarray(where.index(column)), [name.partition("=")[2] for name in where.names(column)]
        if column == "pitch" and len(names) > 1:
            first = np.unique(index, return_index=True)[1]
            names = [f"{np.round(angle, 3):g} deg" for angle in np.degrees(np.asarray(where.pitch_angle)[first])]
        several = np.flatnonzero(np.bincount(index) >= LEAST_IN_GROUP).tolist()
        for number in several if len(names) > 1 and len(several) <= MOST_GROUPS else ():
            name, rows = f"{words} {names[number]}", np.repeat(index != number, 3).astype(int)
            share = GROUP_SHARE / (len(several) * len(GROUP_RATIOS))
            tried.append((rows, 0, (name, "elsewhere"), name, GROUP_RATIOS, share, column))
    return [
        NoiseModel(
            "noise_unequal",
            f"sd {words} times {ratio:g}",
            _WEIGHT + log(share),
            Covariance(np.where(rows == noisier, ratio**2, 1.0), "rows"),
            kind,
            groups=rows,
            names=names,
        )
        for rows, noisier, names, words, ratios, share, kind in tried
        for ratio in ratios
    ]


# Few plans: of a thousand positions each covariance needs 8 MB.
@lru_cache(maxsize=16)
def coloured(order: tuple[float, ...], correlation: float) -> Covariance:
    """Exponentially correlated noise of positions measured in this order, the same for each axis, variance one."""
    time = np.array(order)
    return Covariance(np.exp(np.log(correlation) * np.abs(time[:, None] - time)), "between")


def _scattered(blocks: Float[np.ndarray, "positions 3 3"], problem: Problem) -> Covariance:
    """Covariance of the white rows where every position's reading has an error of this covariance, and white noise of
    variance one."""
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
