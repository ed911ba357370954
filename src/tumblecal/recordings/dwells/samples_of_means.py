"""The samples of positions, checked against their means."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.data.positions import PositionSet
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import shortened


if TYPE_CHECKING:
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples

# Means that differ more from those of the samples (standard deviations of the mean, and g) are not of these samples.
_FAR_SD, _FAR_G = 30.0, 2e-3
_SHOWN = 4


def samples_of(dwells: "DwellSamples", data: PositionSet) -> "DwellSamples":
    """The dwells of these positions, in their order.

    **Raises:** `InputError` if a position has no samples, or their mean is different.
    """
    names, source = list(dwells.positions.names), dwells.positions.source
    if wrong := [name for name in data.names if name not in names or data.names.count(name) > 1]:
        raise InputError(
            f"{source}: no samples of position {shortened(wrong, _SHOWN)} of {data.source}; it has "
            f"{shortened(names, _SHOWN)}; give each position one name, in both"
        )
    rows = [names.index(name) for name in data.names]
    found = replace(dwells, positions=dwells.positions.chosen(rows), force=[dwells.force[row] for row in rows])
    for name, mean, force in zip(data.names, data.readings, found.force, strict=True):
        of_samples, sd = force.mean(0), force.std(0, ddof=1) / np.sqrt(len(force))
        excess = np.abs(of_samples - mean) - _FAR_SD * sd - _FAR_G
        axis = int(np.argmax(excess))
        if excess[axis] > 0:
            raise InputError(
                f"{source}: position {name}: the samples' mean of axis {AXES[axis]} is {of_samples[axis]:.6g} g, but "
                f"{data.source} has {mean[axis]:.6g} g; give the samples that the means were made of, and for readings in "
                "m/s^2 a comment `# gravity_ms2: 9.8123` with local gravity"
            )
    return found
