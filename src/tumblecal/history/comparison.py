"""Two calibrations of a unit: changes in standard uncertainties, with joint tests for their possible causes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, SensorParameters, leaf_of
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.history.few_dof import joint_dof, no_change


# Significance level: with a smaller p-value, no change is rejected.
UNLIKELY = 0.01
_SCALES = tuple(f"dK_{axis}" for axis in AXES)
# Combinations of scale factors that one cause changes: their mean, and their differences.
_COMMON = np.ones(3) / 3
_DIFFERENCES = np.array([[1.0, -1.0, 0.0], [0.5, 0.5, -1.0]])


def common_temperature(old: Calibration, new: Calibration) -> float | None:
    """The temperature (degC) at which two calibrations are compared; None if the parameters of neither follow temperature.

    It is the temperature of the one whose parameters do not follow temperature, if stated, otherwise a reference temperature.

    **Raises:** `InputError` if it is outside a measured range.
    """
    pair = (old, new)
    curves = [each.temperature for each in pair if each.temperature is not None]
    if not curves:
        return None
    of_constant = [each.temperature_degc for each in pair if each.temperature is None]
    candidates = [degc for degc in of_constant if degc is not None] or [each.reference_degc for each in curves]
    for degc in candidates:
        if not any(each.beyond(np.array([degc]))[0] for each in curves):
            return degc
    given, ranges = (
        " and ".join(f"{degc:.4g}" for degc in candidates),
        " and ".join(each.range_words for each in curves),
    )
    raise InputError(
        f"no common temperature: the values of one calibration are for {given} degC, the measured range of the other is "
        f"{ranges}; compare calibrations that were measured at one temperature"
    )


@dataclass(frozen=True)
class Moved:
    """One parameter: change (new minus old) and its standard uncertainty, base units; 0 if neither file states one."""

    name: str
    unit: str
    old: float
    new: float
    sd: float

    @property
    def change(self) -> float:
        """New minus old."""
        return self.new - self.old

    @property
    def in_sd(self) -> float:
        """The change in standard uncertainties; NaN if they are not stated."""
        return self.change / self.sd if self.sd > 0 else float("nan")


@dataclass(frozen=True)
class Joint:
    """A joint test of no change: chi-square (Hotelling's T^2 for estimated noise) with `dof` numbers, and its `p_value` (None
    without a covariance); `means`: possible cause of a change."""

    what: str
    means: str
    size: float
    unit: str
    chi2: float
    dof: int
    p_value: float | None

    @property
    def moved(self) -> bool:
        """Whether the change is significant."""
        return self.p_value is not None and self.p_value < UNLIKELY


@dataclass(frozen=True)
class Comparison:
    """Changes between two calibrations: by parameter, by cause, and for the whole sensor."""

    moved: tuple[Moved, ...]
    joint: tuple[Joint, ...]


def compare(old: SensorParameters, new: SensorParameters) -> Comparison:
    """Compare two calibrations with independent errors, by the parameters that both state.

    A different value of gravity (the reference) changes the common scale of the three axes. Differences between axes,
    non-orthogonality and bias belong to the sensor. Mount angles change with each mounting of the triad. Tests are those of
    `few_dof.no_change`, with the degrees of freedom of the noise of each calibration.
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
            "sensor as a whole" if len(sensor) == len(SENSOR) else "all common parameters",
            "the triad itself, or the reference",
            pair,
            np.eye(len(sensor)),
            sensor,
        ),
        _joint("common scale", "the reference: the gravity value, or temperature", pair, _COMMON[None, :], _SCALES),
        _joint("scale differences", "the triad", pair, _DIFFERENCES, _SCALES),
        *(
            _joint(GROUPS[leaf][0], means, pair, np.eye(len(of_leaf)), of_leaf)
            for leaf, means in _MEANS.items()
            if (of_leaf := [name for name in names if leaf_of(name) == leaf])
        ),
    ]
    return Comparison(moved, tuple(joint))


_MEANS = {
    "bias": "the triad: ageing, temperature, power",
    "gamma": "the triad: its input axes",
    "dtheta": "the mounting, not the sensor",
}


def _joint(
    what: str,
    means: str,
    pair: tuple[SensorParameters, SensorParameters],
    rows: Float[np.ndarray, "k n"],
    names: Sequence[str],
) -> Joint:
    first, second = parts = [part.of(names) for part in pair]
    change = rows @ (second.values - first.values)
    covariances = [rows @ part.covariance @ rows.T for part in parts]
    chi2, dof, tail = no_change(change, covariances, [joint_dof(part, rows) for part in parts])
    leaves = {leaf_of(name) for name in names}
    unit = GROUPS[leaves.pop()][1] if len(leaves) == 1 else ""
    return Joint(what, means, float(np.max(np.abs(change))), unit, chi2, dof, tail)
