"""Check that raw samples are those of the position means."""

import numpy as np

from tumblecal.capture.position_samples import PositionSamples
from tumblecal.data import PositionSet
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Means that differ more from those of the samples (standard deviations of the mean, and g) are not of these samples.
_FAR_SD, _FAR_G = 30.0, 2e-3
_SHOWN = 4
# Local gravity differs from standard gravity by less than this share.
_GRAVITY_SHARE = 6e-3


def require_samples_of(samples: PositionSamples, data: PositionSet) -> None:
    """Raise for samples of other positions.

    **Raises:** `InputError` if a position has no samples, or their mean is different.
    """
    absent = [name for name in data.names if name not in samples.force]
    # Joined files prefix a position's name with the name of the file if several files have it.
    names = [name.partition(":")[2] for name in absent]
    repeated = [name for name in names if name in samples.force] or [n for n in data.names if data.names.count(n) > 1]
    if repeated:
        raise InputError(
            f"{data.source}: several positions are named {repeated[0]}, so their samples are indistinguishable in "
            f"{samples.source}; give each position a name of its own in both"
        )
    if absent:
        more = f" and {len(absent) - _SHOWN} more" if len(absent) > _SHOWN else ""
        there = ", ".join(list(samples.force)[:_SHOWN])
        raise InputError(
            f"{samples.source}: no samples of position {', '.join(absent[:_SHOWN])}{more} of {data.source}; "
            f"it has {there}{' ...' if len(samples.force) > _SHOWN else ''}"
        )
    for name, mean in zip(data.names, data.readings, strict=True):
        force = samples.force[name]
        off = np.abs(force.mean(0) - mean)
        allowed = _FAR_SD * force.std(0, ddof=1) / np.sqrt(len(force)) + _FAR_G
        if np.any(off > allowed):
            axis = int(np.argmax(off - allowed))
            raise InputError(
                f"{samples.source}: position {name}: the samples' mean of axis {AXES[axis]} is {force[:, axis].mean():.6g} "
                f"g, but {data.source} has {mean[axis]:.6g} g; give the samples that the means were made of"
                + _gravity_words(force, mean)
            )


def _gravity_words(force: np.ndarray, mean: np.ndarray) -> str:
    """The remedy if a mean differs like local gravity from standard gravity."""
    ratio = float(np.linalg.norm(force.mean(0)) / np.linalg.norm(mean))
    like_gravity = abs(ratio - 1) < _GRAVITY_SHARE and np.linalg.norm(force.mean(0) - ratio * mean) < _FAR_G
    return ", and for readings in m/s^2 a comment `# gravity_ms2: 9.8123` with local gravity" if like_gravity else ""
