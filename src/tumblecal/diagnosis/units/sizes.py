"""Sizes of the errors of units in display units: of the head, of each unit, mean and dispersion over the units, two levels."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tumblecal.diagnosis.units.batch import SharedSignal
from tumblecal.diagnosis.units.joint import JointDiagnosis
from tumblecal.effects import Catalogue
from tumblecal.effects.catalogue import belongs_to
from tumblecal.ground.units import factor, shown


# Folder and summary line of each unit, in the order of the files.
UnitRows = Sequence[tuple[str, Mapping[str, Any]]]
# A value and its standard uncertainty (`sd`) with their unit, by the name of the coefficient.
Sizes = dict[str, dict[str, Any]]
# An origin of a smaller probability is not listed.
_LEAST_LISTED = 1e-3


def head_sizes(found: JointDiagnosis, entries: Catalogue, unit: int | None = None) -> Sizes:
    """The errors of the head: by all units, or the estimate of one unit, without those that it does not determine."""
    fit = found.fit
    if (head := fit.head) is None:
        return {}
    display = {name: entries[signal.label].unit for signal in found.shared for name in signal.slot.names}
    values, sds = (head.values, head.sd) if unit is None else (fit.unit_values[unit], fit.unit_sd[unit])
    sizes: Sizes = {}
    # The estimates of a unit do not include pitch settings, which are last.
    for name, base, value, sd in zip(head.names, head.units, values.tolist(), sds.tolist(), strict=False):
        if np.isfinite(sd):
            words = display.get(name, shown(base)[0])
            scale = factor(words, base)
            sizes[name] = {"value": value / scale, "sd": sd / scale, "unit": words}
    return sizes


def spread_sizes(found: JointDiagnosis, entries: Catalogue) -> dict[str, Sizes]:
    """For each effect that differs between units: the mean of every coefficient, its standard uncertainty by the noise, and the
    standard deviation between units. Mean and uncertainty are None for a coefficient that is not determined separately."""
    listed: dict[str, Sizes] = {}
    for id in found.joint.best.by_unit:
        amounts = found.amounts[id]
        names, scales = _names_and_scales(amounts.signal, entries)
        columns = (*(part * scales for part in amounts.mean), amounts.tau * scales, amounts.determined)
        listed[id] = {
            name: {
                "mean": mean if alone else None,
                "mean_sd": sd if alone else None,
                "sd_between_units": between,
                "unit": entries[id].unit,
            }
            for name, mean, sd, between, alone in zip(names, *(column.tolist() for column in columns), strict=True)
        }
    return listed


def level_sizes(found: JointDiagnosis, entries: Catalogue, units: UnitRows) -> list[dict[str, Any]]:
    """For each error of the head with two levels: its p-value and, for each part, the first and last unit and every
    coefficient that is determined separately."""
    listed = []
    for levels in found.levels:
        id = levels.signal.label
        names, scales = _names_and_scales(levels.signal, entries)
        alone, bounds = found.amounts[id].determined, ((0, levels.first - 1), (levels.first, len(units) - 1))
        parts = [
            {
                "first": units[first][0],
                "last": units[last][0],
                "coefficients": {
                    names[k]: {"value": float(values[k]), "sd": float(sds[k]), "unit": entries[id].unit}
                    for k in np.flatnonzero(alone)
                },
            }
            for (first, last), values, sds in zip(bounds, levels.values * scales, levels.sd * scales, strict=True)
        ]
        listed.append({"effect": id, "p_value": levels.p_value, "parts": parts})
    return listed


def _names_and_scales(signal: SharedSignal, entries: Catalogue) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the coefficients of an effect, and the scales to display units."""
    names, bases = zip(*signal.names_and_units, strict=True)
    return names, np.array(signal.scales) / [factor(entries[signal.label].unit, base) for base in bases]


def origins(found: JointDiagnosis, entries: Catalogue) -> dict[str, dict[str, Any]]:
    """Head or sensor: for every effect, the part that it belongs to, and the probabilities that all units share it and that it
    differs between units."""
    ids = dict.fromkeys(slot.id for unit in found.batch.units for slot in unit.at.model.slots if slot.id in entries)
    listed = {
        id: {
            "belongs_to": belongs_to(entries[id]),
            "shared": found.joint.shared_probability(id),
            "by_unit": found.joint.by_unit_probability(id),
        }
        for id in ids
    }
    return {id: one for id, one in listed.items() if max(one["shared"], one["by_unit"]) > _LEAST_LISTED}
