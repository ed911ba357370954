"""Two calibrations of a unit: what moved, in standard deviations, tested jointly by what could have moved it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.data.sensor_parameters import GROUPS, SENSOR, SensorParameters, leaf_of
from tumblecal.ground.axes import AXES
from tumblecal.history.few_dof import joint_dof, no_change


# Below this chance under no change, something moved.
UNLIKELY = 0.01
_SCALES = tuple(f"dK_{axis}" for axis in AXES)
# Combinations of parameters that one cause moves together, in words: what a change of them means.
_COMMON = np.ones(3) / 3
_APART = np.array([[1.0, -1.0, 0.0], [0.5, 0.5, -1.0]])


@dataclass(frozen=True)
class Moved:
    """One parameter: change (new less old) and its sd, base units; sd 0 where neither file states one."""

    name: str
    unit: str
    old: float
    new: float
    sd: float

    @property
    def change(self) -> float:
        """New less old."""
        return self.new - self.old

    @property
    def in_sd(self) -> float:
        """The change in standard deviations; not a number where there are none."""
        return self.change / self.sd if self.sd > 0 else float("nan")


@dataclass(frozen=True)
class Joint:
    """A joint test of no change: chi-square (Hotelling's T^2 where the noise was estimated) with `dof` numbers, its tail
    `p_value` (None without a covariance); `means`: what would move it."""

    what: str
    means: str
    size: float
    unit: str
    chi2: float
    dof: int
    p_value: float | None

    @property
    def moved(self) -> bool:
        """Whether a change is more than uncertainty."""
        return self.p_value is not None and self.p_value < UNLIKELY


@dataclass(frozen=True)
class Comparison:
    """What moved between two calibrations: by parameter, by cause, and the sensor as a whole."""

    moved: tuple[Moved, ...]
    joint: tuple[Joint, ...]


def compare(old: SensorParameters, new: SensorParameters) -> Comparison:
    """Compare two calibrations whose errors are independent, by the parameters that both state.

    The common scale of the three axes is what another value of gravity moves (the reference); differences between axes,
    non-orthogonality and bias are the sensor's own; mount angles change whenever the triad is put into its fixture. Tests
    are those of `few_dof.no_change`, by the degrees of freedom from which each one's noise was estimated.
    """
    names = [name for name in old.names if name in new.names]
    first, second = old.of(names), new.of(names)
    pair = (first, second)
    sd = np.sqrt(np.diag(first.covariance + second.covariance))
    moved = tuple(
        Moved(name, GROUPS[leaf_of(name)][1], float(first.values[k]), float(second.values[k]), float(sd[k]))
        for k, name in enumerate(names)
    )
    sensor = [name for name in names if name in SENSOR]
    joint = [
        _joint(
            "sensor as a whole" if len(sensor) == len(SENSOR) else "all that both state",
            "the triad itself, or the reference",
            pair,
            np.eye(len(sensor)),
            sensor,
        ),
        _joint("common scale", "the reference: the gravity value, or temperature", pair, _COMMON[None, :], _SCALES),
        _joint("scales apart", "the triad", pair, _APART, _SCALES),
        *(
            _joint(GROUPS[leaf][0], means, pair, np.eye(len(own)), own)
            for leaf, means in _MEANS.items()
            if (own := [name for name in names if leaf_of(name) == leaf])
        ),
    ]
    return Comparison(moved, tuple(joint))


_MEANS = {
    "bias": "the triad: ageing, temperature, power",
    "gamma": "the triad: its input axes",
    "dtheta": "the mounting: no matter to the sensor",
}


def _joint(
    what: str,
    means: str,
    pair: tuple[SensorParameters, SensorParameters],
    rows: Float[np.ndarray, "k n"],
    names: Sequence[str],
) -> Joint:
    first, second = own = [part.of(names) for part in pair]
    change = rows @ (second.values - first.values)
    covariances = [rows @ part.covariance @ rows.T for part in own]
    chi2, dof, tail = no_change(change, covariances, [joint_dof(part, rows) for part in own])
    leaves = {leaf_of(name) for name in names}
    unit = GROUPS[leaves.pop()][1] if len(leaves) == 1 else ""
    return Joint(what, means, float(np.max(np.abs(change))), unit, chi2, dof, tail)
