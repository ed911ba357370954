"""Effects that differ between units: mean and dispersion over the batch, levels from some unit on; in display units."""

from collections.abc import Mapping, Sequence

import numpy as np

from tumblecal.diagnosis.head import Together
from tumblecal.diagnosis.head.unit import SharedSignal
from tumblecal.effects import Catalogue
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.units import factor


# Folder and summary line of every unit, in the order of the files.
UnitRows = Sequence[tuple[str, Mapping]]


def spread_sizes(found: Together, entries: Catalogue) -> dict[str, dict]:
    """For each effect that differs between units: the mean of every coefficient, its standard uncertainty by the noise, and the
    standard deviation between units. Mean and uncertainty are None for a coefficient that is not determined separately."""
    listed = {}
    for spread in found.joint.best.weighed.spreads:
        signal, amounts = spread.signal, found.amounts(spread.signal)
        names, scales = _names_and_scales(signal, entries)
        means, sds = amounts.mean
        sizes = zip(names, means * scales, sds * scales, amounts.tau * scales, amounts.determined.tolist(), strict=True)
        listed[signal.label] = {
            name: {
                "mean": float(mean) if alone else None,
                "mean_sd": float(sd) if alone else None,
                "sd_between_units": float(between),
                "unit": entries[signal.label].unit,
            }
            for name, mean, sd, between, alone in sizes
        }
    return listed


def shown_in(found: Together) -> dict[str, tuple[int, ...]]:
    """For each effect that differs between units: numbers of the units in which it is significant alone."""
    return {spread.signal.label: found.amounts(spread.signal).shown_in for spread in found.joint.best.weighed.spreads}


def level_sizes(found: Together, entries: Catalogue) -> list[dict]:
    """For each error of the head with two levels: its p-value and, for each part, the numbers of the first and last unit and
    every coefficient that is determined separately, with its standard uncertainty."""
    listed = []
    for levels in found.levels:
        names, scales = _names_and_scales(levels.signal, entries)
        alone, unit = found.amounts(levels.signal).determined, entries[levels.signal.label].unit
        bounds = (0, levels.first - 1), (levels.first, len(found.units) - 1)
        parts = []
        for (first, last), values, sds in zip(bounds, levels.values * scales, levels.sd * scales, strict=True):
            sizes = {
                names[k]: {"value": float(values[k]), "sd": float(sds[k]), "unit": unit} for k in np.flatnonzero(alone)
            }
            parts.append({"first": first, "last": last, "coefficients": sizes})
        listed.append({"effect": levels.signal.label, "p_value": levels.p_value, "parts": parts})
    return listed


def between_units_words(name: str, size: dict) -> str:
    """Mean and standard deviation over the units of a coefficient that differs between them."""
    mean = "undetermined" if size["mean"] is None else rounded_together(size["mean"], size["mean_sd"])
    return f"{name}: mean {mean}, standard deviation between units {size['sd_between_units']:.2g} {size['unit']}"


def _names_and_scales(signal: SharedSignal, entries: Catalogue) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the coefficients of an effect, and the scales to display units."""
    names, bases = zip(*signal.names_and_units, strict=True)
    return names, np.array(signal.scales) / [factor(entries[signal.label].unit, base) for base in bases]
