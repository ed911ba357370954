"""Orders of the dependence on temperature that data at few temperatures cannot determine.

A polynomial that is zero at every temperature measured changes no reading of the data: one of second order with two
temperatures, one of third order with three. The usual model of an accelerometer over temperature is of third order.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from tumblecal.data.calibration_terms import Term
from tumblecal.data.not_applied import NotApplied
from tumblecal.ground.axes import AXES


# Order of the usual model; temperatures that differ by less than this share of their range count as one.
_USUAL_ORDER, _SAME_SHARE = 3, 0.1
_WORDS = {2: "second", 3: "third"}
_GRID = 401


def temperature_levels(temperature_degc: Float[np.ndarray, " positions"]) -> list[float]:
    """The separate temperatures of some positions, degC, each the mean of those that count as one."""
    degc = np.sort(np.asarray(temperature_degc, float))
    width, levels = _SAME_SHARE * float(np.ptp(degc)), list[list[float]]()
    for value in degc.tolist():
        if levels and value <= levels[-1][0] + width:
            levels[-1].append(value)
        else:
            levels.append([value])
    return [float(np.mean(level)) for level in levels]


def undetermined_order(
    terms: Sequence[Term], temperature_degc: Float[np.ndarray, " positions"] | None
) -> NotApplied | None:
    """The order of the dependence on temperature that is not determined, with the size (mg) that it has between the
    measured temperatures if it changes the readings over their range as much as the terms do; None if third order is
    determined.
    """
    thermal = [term for term in terms if term.thermal]
    if temperature_degc is None or not thermal:
        return None
    levels = np.array(temperature_levels(temperature_degc))
    order = len(levels)
    if not 1 < order <= _USUAL_ORDER:
        return None
    half, middle = np.ptp(levels) / 2, (levels[0] + levels[-1]) / 2
    grid = np.linspace(-1, 1, _GRID)
    hidden = np.prod(grid[:, None] - (levels - middle) / half, axis=1)
    size = 1e3 * _change(thermal, middle + half * grid)
    at = ", ".join(f"{level:.3g}" for level in levels)
    return NotApplied(
        f"temperature^{order}",
        f"not determined: a {_WORDS[order]}-order dependence of the same size as the terms of temperature would be zero at the "
        f"{order} temperatures measured ({at} degC) and act between them",
        float(size * np.max(np.abs(hidden))),
        float(size * np.sqrt(np.mean(hidden**2))),
    )


def _change(thermal: Sequence[Term], degc: Float[np.ndarray, " grid"]) -> float:
    """Half of the change of a reading at 1 g over the temperatures, of the axis on which it is largest, g."""
    inputs = np.ones((len(degc), 3))
    along = np.zeros((3, len(degc)))
    for term in thermal:
        along[AXES.index(term.axis)] += term.factor(degc, None) * term.of_inputs(inputs)
    return float(np.max(np.ptp(along, axis=1))) / 2
