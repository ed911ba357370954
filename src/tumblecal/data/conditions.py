"""Temperatures and times that no measurement at rest has: raw counts, or another unit than the column says."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from tumblecal.ground.counted import counted


# What a triad is measured at, degC, and what kelvin look like: a column of these is put in degC later.
_OF_A_TRIAD_DEGC, _KELVIN = (-100.0, 250.0), (200.0, 450.0)
# Seconds since 1970 are less for three thousand years; the units that computers count in, each how many a second.
_MOST_S = 1e11
_PER_SECOND = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
# No head goes from position to position in less, s; nor where the numbers are those that a spreadsheet has for the days from
# 1982 to 2119, and a day has 86400 s.
_FASTEST_S, _FASTEST_OF_DATES_S, _DATES = 0.05, 0.3, (30_000.0, 80_000.0)
_FEWEST = 3


def are_kelvin(temperature: Float[np.ndarray, " rows"]) -> bool:
    """Whether all numbers of a column of degC are kelvin."""
    return bool(_KELVIN[0] < np.min(temperature) and np.max(temperature) < _KELVIN[1])


def temperature_faults(temperature: Float[np.ndarray, " rows"]) -> Iterator[tuple[int, str]]:
    """Rows whose temperature no triad was measured at, and what is wrong with each; none where all are kelvin."""
    if not len(temperature) or are_kelvin(temperature):
        return
    low, high = _OF_A_TRIAD_DEGC
    for row in np.flatnonzero((temperature < low) | (temperature > high)).tolist():
        yield (
            row,
            f"{temperature[row]:.7g} degC is no temperature that a triad is measured at ({low:g} to {high:g} degC); if these "
            "are raw counts or another unit, write degC; else correct it, or leave the whole column out",
        )


def time_fault(time: Float[np.ndarray, " rows"], positions: Sequence[str]) -> str:
    """What is wrong with times in s of rows by the positions they are of; "" where nothing is."""
    if not len(time):
        return ""
    if np.min(time) > _MOST_S:
        unit = next((name for name, many in _PER_SECOND.items() if np.max(time) < _MOST_S * many), "nanoseconds")
        return f"{time[0]:.4g} s, and so on: these look like {unit} since 1970; write seconds, which may begin anywhere"
    moves = sum(one != other for one, other in pairwise(positions))
    lasted = float(np.sum(np.maximum(np.diff(time), 0.0)))
    if moves + 1 < _FEWEST or lasted == 0.0:
        return ""
    dates = _DATES[0] < np.min(time) and np.max(time) < _DATES[1]
    if lasted / moves >= (_FASTEST_OF_DATES_S if dates else _FASTEST_S):
        return ""
    like = "days, as a spreadsheet counts dates" if dates else "hours or days"
    return (
        f"{time[0]:.7g} to {time[-1]:.7g} s, {counted(moves + 1, 'position')}: no head is set in {lasted / moves:.2g} s; these "
        f"look like {like}: write seconds, which may begin anywhere, or leave the whole column out"
    )
