"""Soaks: the separate temperatures of measurements at nearly constant temperatures."""

import numpy as np
from jaxtyping import Float


# Temperatures within so much (degC) are one temperature: usual thermometers are in error by as much.
ONE_TEMPERATURE_DEGC = 0.5
# Soaks are separated by steps above this many times the width of the soaks on both sides; a smaller step may be drift.
_STEP_IN_WIDTHS = 10.0
# More soaks than any order of a polynomial, or knots of a spline, needs.
_MANY = 50


def soaks(degc: Float[np.ndarray, " positions"]) -> list[float]:
    """The mean temperature of each soak, increasing.

    Temperatures form soaks if every step between groups exceeds ten times the width of the groups on both sides; the largest
    such groups count. If there are no such groups, as on a ramp, each different temperature counts. Temperatures within
    0.5 degC are one soak.

    Examples:
        >>> soaks(np.array([0.0, 0.2, 25.1, 24.9, 60.0]))
        [0.1, 25.0, 60.0]
        >>> len(soaks(np.linspace(0.0, 60.0, 24)))
        24
    """
    ordered = np.sort(np.asarray(degc, float))
    if np.ptp(ordered) <= ONE_TEMPERATURE_DEGC:
        return [float(np.mean(ordered))]
    steps = np.diff(ordered)
    for threshold in np.unique(steps[steps > 0])[::-1]:
        cuts = np.flatnonzero(steps >= threshold)
        if len(cuts) >= _MANY:
            break
        groups = np.split(ordered, cuts + 1)
        width = np.array([np.ptp(group) for group in groups])
        if np.all(steps[cuts] > _STEP_IN_WIDTHS * np.maximum(width[:-1], width[1:])):
            return [float(np.mean(group)) for group in groups]
    return np.unique(ordered).tolist()
