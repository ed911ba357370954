"""Which positions stand at one setting of an angle: as commanded, or as an encoder read it, somewhat otherwise every time."""

import numpy as np
from jaxtyping import Float, Int


Angles = Float[np.ndarray, " positions"]
Index = Int[np.ndarray, " positions"]

# Angles are the same to this many decimals of a radian.
_DECIMALS = 9
# Angles that were read at one setting stay within this spread; settings stand this far apart, and so many times the spread.
_WIDEST, _APART, _TIMES = np.radians(0.5), np.radians(1.0), 5.0
# An angle that stands in so many rows, one after another where it is held, was commanded, however near the next.
_COMMANDED_ROWS = 3
# Angles are taken for read only where they leave settings of so many rows each; a plan of scattered attitudes has none.
_ROWS_OF_READ = 2
# A setting whose angles were read is called by their median to this many decimals of a degree.
_DECIMALS_CALLED = 1


def distinct(angle: Angles) -> Index:
    """A number for each position by its angle, rad, increasing with it: the same for equal angles alone."""
    return np.unique(np.round(angle, _DECIMALS), return_inverse=True)[1].ravel()


def setting_index(angle: Angles, *, held: bool) -> Index:
    """The setting of every position, numbered by increasing angle.

    Equal angles are one setting. So are angles that keep within half a degree, where other settings are a degree away and five
    times as far as that, unless each was commanded: it stands in three rows or more. Where that leaves settings of less than
    two rows each, every angle is one.

    **Arguments:**

    - `angle`: of each position, rad.
    - `held`: whether the angle is set and kept over rows that follow one another (the pitch): a commanded one then stands in
      three rows one after another.
    """
    own = distinct(angle)
    first = np.unique(own, return_index=True)[1]
    values = np.asarray(angle)[first]
    if len(values) < 2:
        return own
    groups = np.split(np.arange(len(values)), np.flatnonzero(np.diff(values) >= _APART) + 1)
    number, settings = 0, np.zeros(len(values), np.int64)
    for group in groups:
        spread = values[group[-1]] - values[group[0]]
        below = values[group[0]] - values[group[0] - 1] if group[0] else np.inf
        above = values[group[-1] + 1] - values[group[-1]] if group[-1] + 1 < len(values) else np.inf
        clear = len(group) > 1 and spread <= _WIDEST and min(below, above) >= _TIMES * spread
        if clear and not _commanded(own[np.isin(own, group)], held):
            settings[group] = number
            number += 1
        else:
            settings[group] = number + np.arange(len(group))
            number += len(group)
    if number * _ROWS_OF_READ > len(own):
        return own
    if not held and 2 < number < len(values) and values[-1] - values[0] > 2.0 * np.pi - _WIDEST:
        # A spindle that came round to zero was read at either side of it.
        settings[settings == number - 1] = 0
    return settings[own]


def setting_angle(angle: Angles, index: Index) -> Angles:
    """The angle that each position's setting is called by, rad: its own where all of the setting are the same, else the median
    of those that were read there, to a tenth of a degree."""
    called = np.array(angle, float)
    for setting in np.unique(index):
        here = index == setting
        if np.ptp(called[here]) > 10.0**-_DECIMALS:
            called[here] = np.radians(round(float(np.degrees(np.median(called[here]))), _DECIMALS_CALLED) + 0.0)
    return called


def _commanded(values: Index, held: bool) -> bool:
    """Whether every value of some rows, in their order, was commanded."""
    own = np.unique(values, return_inverse=True)[1].ravel()
    rows = np.bincount(own)
    begun = np.flatnonzero(np.diff(own, prepend=-1)) if held else np.zeros(0, np.int64)
    stays = np.maximum(1, np.bincount(own[begun], minlength=len(rows)))
    return bool(np.all(rows >= _COMMANDED_ROWS * stays))
