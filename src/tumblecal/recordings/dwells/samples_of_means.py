"""The samples of positions, checked against their means."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tumblecal.data.positions import PositionSet
from tumblecal.ground.axes import AXES
from tumblecal.ground.counted import shortened
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples

# Means that differ more from those of the samples (standard deviations of the mean, and g) are not of these samples.
_FAR_SD, _FAR_G = 30.0, 2e-3
_SHOWN = 4


def samples_of(dwells: "DwellSamples", data: PositionSet) -> list[NDArray[np.float64]]:
    """The samples of each of these positions.

    **Raises:** `InputError` if a position has no samples, or their mean is different.
    """
    force, source = dict(zip(dwells.positions.names, dwells.force, strict=True)), dwells.positions.source
    if wrong := [name for name in data.names if name not in force or data.names.count(name) > 1]:
        raise InputError(
            f"{source}: no samples of position {shortened(wrong, _SHOWN)} of {data.source}; it has "
            f"{shortened(list(force), _SHOWN)}; give each position one name, in both"
        )
    for name, mean in zip(data.names, data.readings, strict=True):
        of_samples, limit = force[name].mean(0), _FAR_SD * force[name].std(0, ddof=1) / np.sqrt(len(force[name]))
        excess = np.abs(of_samples - mean) - limit - _FAR_G
        axis = int(np.argmax(excess))
        if excess[axis] > 0:
            raise InputError(
                f"{source}: position {name}: the samples' mean of axis {AXES[axis]} is {of_samples[axis]:.6g} g, but "
                f"{data.source} has {mean[axis]:.6g} g; give the samples that the means were made of, and for readings in "
                "m/s^2 a comment `# gravity_ms2: 9.8123` with local gravity"
            )
    return [force[name] for name in data.names]


def middles_of(dwells: "DwellSamples", data: PositionSet) -> NDArray[np.float64] | None:
    """The middle of the samples of each of these positions, s; None if they have no times."""
    if dwells.positions.time_s is None:
        return None
    middle_s = dict(zip(dwells.positions.names, dwells.positions.time_s, strict=True))
    return np.array([middle_s[name] for name in data.names])


def dwell_s(dwells: "DwellSamples") -> float:
    """Length of the median dwell, s."""
    return float(np.median([len(force) for force in dwells.force])) / dwells.rate_hz
