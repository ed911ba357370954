"""Soaks: the separate temperatures of measurements at nearly constant temperatures."""

from math import lgamma

import numpy as np
from jaxtyping import Float, Int


# Temperatures within so much (degC) are one temperature: usual thermometers are in error by as much.
ONE_TEMPERATURE_DEGC = 0.5
# Soaks are separated by steps above this many times the width of the soaks on both sides.
_STEP_IN_WIDTHS = 2.0
# Groups wider than one temperature are soaks if a ramp at random times forms such groups with a smaller probability.
_BY_CHANCE, _ALMOST = 1e-3, 0.75
# More soaks than any order of a polynomial, or knots of a spline, needs.
_MANY = 50


def soaks(degc: Float[np.ndarray, " positions"]) -> list[float]:
    """The mean temperature of each soak, increasing; on a ramp, each different temperature.

    Examples:
        >>> soaks(np.array([0.0, 0.2, 25.1, 24.9, 60.0]))
        [0.1, 25.0, 60.0]
        >>> len(soaks(np.linspace(0.0, 60.0, 24)))
        24
    """
    degc = np.asarray(degc, float)
    number = soak_numbers(degc)
    if number is None:
        return np.unique(degc).tolist()
    return [float(np.mean(degc[number == k])) for k in range(int(number.max()) + 1)]


def soak_numbers(degc: Float[np.ndarray, " positions"]) -> Int[np.ndarray, " positions"] | None:
    """The soak of each position, numbered by increasing temperature; None on a ramp.

    Temperatures form soaks if every step between groups exceeds twice the width of the groups on both sides, and the groups
    are no wider than 0.5 degC or improbable on a ramp. Of the groups that are almost as improbable as the most improbable
    ones (three quarters of the logarithm), the smallest count: pairs of soaks are no soaks, and a split soak is no two.

    For n temperatures at random times on a ramp, steps are independent and exponential. A step exceeds c times a width of
    m steps with probability (1 + c)^-m, so K groups whose steps are c times their widths or more have a probability below
    (n - 1 over K - 1) (1 + c)^-(n - K).
    """
    degc = np.asarray(degc, float)
    order = np.argsort(degc, kind="stable")
    ordered = degc[order]
    if np.ptp(ordered) <= ONE_TEMPERATURE_DEGC:
        return np.zeros(len(degc), int)
    steps = np.diff(ordered)
    found = list[tuple[float, np.ndarray]]()
    for threshold in np.unique(steps[steps > 0])[::-1]:
        cuts = np.flatnonzero(steps >= threshold)
        if len(cuts) >= _MANY:
            break
        width = ordered[np.append(cuts, len(steps))] - ordered[np.append(0, cuts + 1)]
        wide = np.maximum(width, ONE_TEMPERATURE_DEGC)
        ratio = float(np.min(steps[cuts] / np.maximum(wide[:-1], wide[1:])))
        count, groups = len(degc), len(width)
        ways = lgamma(count) - lgamma(groups) - lgamma(count - groups + 1)
        chance = float(ways - (count - groups) * np.log1p(ratio))
        certain = np.max(width) <= ONE_TEMPERATURE_DEGC or chance < np.log(_BY_CHANCE)
        if ratio > _STEP_IN_WIDTHS and certain:
            found.append((chance, cuts))
    if not found:
        return None
    best = min(chance for chance, _ in found)
    limit = best + (1 - _ALMOST) * abs(best)
    cuts = next(cuts for chance, cuts in reversed(found) if chance <= limit)
    number = np.empty(len(degc), int)
    number[order] = np.searchsorted(cuts, np.arange(len(degc)), side="left")
    return number
