"""Sizes of what is not the same in all units: means and spreads over the batch, levels from some unit on; as shown."""

from collections.abc import Mapping, Sequence

import numpy as np

from tumblecal.diagnosis.head import Together
from tumblecal.diagnosis.head.unit import SharedSignal
from tumblecal.effects import Catalogue
from tumblecal.ground.units import factor


# Folder and line of the summary of every unit, in the order of the files.
UnitRows = Sequence[tuple[str, Mapping]]


def spread_sizes(found: Together, entries: Catalogue) -> dict[str, dict]:
    """Of each effect that differs from unit to unit: the mean of every coefficient over these units, its sd by their noise, and
    the sd between units; both null of a coefficient that they do not determine by itself."""
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
    """Of each effect that differs from unit to unit: numbers of the units that show it clearly by themselves."""
    return {spread.signal.label: found.amounts(spread.signal).shown_in for spread in found.joint.best.weighed.spreads}


def level_sizes(found: Together, entries: Catalogue) -> list[dict]:
    """Of each error of the head with two levels: its p-value and, of each part, the numbers of the first and last unit and
    every coefficient that the units determine by itself, with its sd."""
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


def _names_and_scales(signal: SharedSignal, entries: Catalogue) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of an effect's coefficients, and what a scaled one is as shown."""
    names, bases = zip(*signal.names_and_units, strict=True)
    return names, np.array(signal.scales) / [factor(entries[signal.label].unit, base) for base in bases]
