"""Settings of an angle: positions with one commanded angle, or with slightly different readings of an encoder."""

import numpy as np
from jaxtyping import Float, Int


Angles = Float[np.ndarray, " positions"]
Index = Int[np.ndarray, " positions"]

# Angles are equal if they agree to this many decimals of a radian.
_DECIMALS = 9
# Largest spread of angles read at one setting; smallest distance of settings, also in multiples of the spread.
_WIDEST, _SEPARATION, _TIMES = np.radians(0.5), np.radians(1.0), 5.0
# An angle in this many rows (consecutive rows if it is held) was commanded, however small the distance to the next.
_COMMANDED_ROWS = 3
# Angles are treated as read only if settings have this many rows on average; a plan of scattered attitudes has none.
_ROWS_OF_READ = 2
# Decimals of a degree of the median angle that names a setting of read angles.
_DECIMALS_OF_NAME = 1


def distinct(angle: Angles) -> Index:
    """An index for each position by its angle (rad), in increasing order; equal only for equal angles."""
    return np.unique(np.round(angle, _DECIMALS), return_inverse=True)[1].ravel()


def setting_index(angle: Angles, *, held: bool) -> Index:
    """The setting of each position, numbered by increasing angle.

    Equal angles are one setting. Angles within half a degree are also one setting if other settings are at least one degree
    and five times their spread away, unless each angle was commanded: it is in three rows or more. If settings then have less
    than two rows on average, each angle is a setting.

    **Arguments:**

    - `angle`: of each position, rad.
    - `held`: whether the angle is kept over consecutive rows (the pitch): a commanded angle is then in three consecutive
      rows.
    """
    index = distinct(angle)
    first = np.unique(index, return_index=True)[1]
    values = np.asarray(angle)[first]
    if len(values) < 2:
        return index
    groups = np.split(np.arange(len(values)), np.flatnonzero(np.diff(values) >= _SEPARATION) + 1)
    number, settings = 0, np.zeros(len(values), np.int64)
    for group in groups:
        spread = values[group[-1]] - values[group[0]]
        below = values[group[0]] - values[group[0] - 1] if group[0] else np.inf
        above = values[group[-1] + 1] - values[group[-1]] if group[-1] + 1 < len(values) else np.inf
        clear = len(group) > 1 and spread <= _WIDEST and min(below, above) >= _TIMES * spread
        if clear and not _commanded(index[np.isin(index, group)], held):
            settings[group] = number
            number += 1
        else:
            settings[group] = number + np.arange(len(group))
            number += len(group)
    if number * _ROWS_OF_READ > len(index):
        return index
    if not held and 2 < number < len(values) and values[-1] - values[0] > 2.0 * np.pi - _WIDEST:
        # A spindle that returned to zero has readings on both sides of it.
        settings[settings == number - 1] = 0
    return settings[index]


def setting_angle(angle: Angles, index: Index) -> Angles:
    """The angle that names the setting of each position, rad: the common angle of its positions, or, if they differ, the
    median of the read angles to a tenth of a degree."""
    named = np.array(angle, float)
    for setting in np.unique(index):
        here = index == setting
        if np.ptp(named[here]) > 10.0**-_DECIMALS:
            named[here] = np.radians(round(float(np.degrees(np.median(named[here]))), _DECIMALS_OF_NAME) + 0.0)
    return named


def _commanded(values: Index, held: bool) -> bool:
    """Whether each value of these rows, in order, was commanded."""
    index = np.unique(values, return_inverse=True)[1].ravel()
    rows = np.bincount(index)
    starts = np.flatnonzero(np.diff(index, prepend=-1)) if held else np.zeros(0, np.int64)
    dwells = np.maximum(1, np.bincount(index[starts], minlength=len(rows)))
    return bool(np.all(rows >= _COMMANDED_ROWS * dwells))


def look_like_radians(degrees: Angles) -> bool:
    """Whether angles that should be degrees are radians: multiples of pi/24 below about a turn that are not integers."""
    steps = degrees / (np.pi / 24)
    small, whole = np.max(np.abs(degrees), initial=0.0) < 7, np.all(degrees == np.round(degrees))
    return bool(small and not whole and np.allclose(steps, np.round(steps), atol=0.01))
