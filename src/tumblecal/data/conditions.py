"""Temperatures and times that are impossible at rest: raw counts, or a unit that contradicts the column name."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from tumblecal.ground.numbers_shown import counted


# Possible temperatures of a triad, degC, and of a column in kelvin, which is converted to degC later.
_OF_A_TRIAD_DEGC, _KELVIN = (-100.0, 250.0), (200.0, 450.0)
# Seconds since 1970 remain below this for three thousand years; other units of computer clocks are above it.
_MOST_S = 1e11
# Shortest mean time between positions, s; and for numbers that may be the days of a spreadsheet, from 1982 to 2119.
_FASTEST_S, _FASTEST_OF_DATES_S, _DATES = 0.05, 0.3, (30_000.0, 80_000.0)
_FEWEST = 3


def are_kelvin(temperature: Float[np.ndarray, " rows"]) -> bool:
    """Whether all numbers of a column of degC are kelvin."""
    return bool(_KELVIN[0] < np.min(temperature) and np.max(temperature) < _KELVIN[1])


def temperature_faults(temperature: Float[np.ndarray, " rows"]) -> Iterator[tuple[int, str]]:
    """Rows with an impossible temperature, and the fault of each; none if all are kelvin."""
    if not len(temperature) or are_kelvin(temperature):
        return
    low, high = _OF_A_TRIAD_DEGC
    for row in np.flatnonzero((temperature < low) | (temperature > high)).tolist():
        yield (
            row,
            f"{temperature[row]:.7g} degC is not a possible temperature of a triad ({low:g} to {high:g} degC). If these are "
            "raw counts or a different unit, write degC; otherwise correct it, or remove the whole column",
        )


def time_fault(time: Float[np.ndarray, " rows"], positions: Sequence[str]) -> str:
    """Fault of the times (s) of rows with these positions; "" if there is none."""
    if not len(time):
        return ""
    if np.min(time) > _MOST_S:
        unit = ("milliseconds", "microseconds", "nanoseconds")[int(np.clip(np.log10(np.max(time)) - 11, 0, 8)) // 3]
        return f"{time[0]:.4g} s, and so on: these look like {unit} since 1970; write seconds, from any origin"
    moves = sum(one != other for one, other in pairwise(positions))
    lasted = float(np.sum(np.maximum(np.diff(time), 0.0)))
    dates = _DATES[0] < np.min(time) and np.max(time) < _DATES[1]
    fastest = _FASTEST_OF_DATES_S if dates else _FASTEST_S
    if moves + 1 < _FEWEST or lasted == 0.0 or lasted / moves >= fastest:
        return ""
    like = "days, as a spreadsheet counts dates" if dates else "hours or days"
    return (
        f"{time[0]:.7g} to {time[-1]:.7g} s, {counted(moves + 1, 'position')}: a head cannot be set in {lasted / moves:.2g} s, "
        f"so these look like {like}; write seconds, from any origin, or remove the whole column"
    )
