"""Amounts of effects of units: of the head, of each unit, mean and dispersion over the batch, levels; in display units."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.diagnosis.units import JointDiagnosis
from tumblecal.diagnosis.units.batch import SharedSignal
from tumblecal.effects import Catalogue
from tumblecal.effects.catalogue import belongs_to
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.units import factor, shown


# Folder and summary line of every unit, in the order of the files.
UnitRows = Sequence[tuple[str, Mapping]]


def spread_sizes(found: JointDiagnosis, entries: Catalogue) -> dict[str, dict[str, Any]]:
    """For each effect that differs between units: the mean of every coefficient, its standard uncertainty by the noise, and the
    standard deviation between units. Mean and uncertainty are None for a coefficient that is not determined separately."""
    listed = {}
    for id in found.joint.best.by_unit:
        amounts = found.amounts[id]
        names, scales = _names_and_scales(amounts.signal, entries)
        means, sds = amounts.mean
        sizes = zip(names, means * scales, sds * scales, amounts.tau * scales, amounts.determined.tolist(), strict=True)
        listed[id] = {
            name: {
                "mean": float(mean) if alone else None,
                "mean_sd": float(sd) if alone else None,
                "sd_between_units": float(between),
                "unit": entries[id].unit,
            }
            for name, mean, sd, between, alone in sizes
        }
    return listed


def shown_in(found: JointDiagnosis) -> dict[str, tuple[int, ...]]:
    """For each effect that differs between units: numbers of the units in which it is significant alone."""
    return {id: found.amounts[id].shown_in for id in found.joint.best.by_unit}


def level_sizes(found: JointDiagnosis, entries: Catalogue) -> list[dict[str, Any]]:
    """For each error of the head with two levels: its p-value and, for each part, the numbers of the first and last unit and
    every coefficient that is determined separately, with its standard uncertainty."""
    listed = []
    for levels in found.levels:
        names, scales = _names_and_scales(levels.signal, entries)
        alone, unit = found.amounts[levels.signal.label].determined, entries[levels.signal.label].unit
        bounds = (0, levels.first - 1), (levels.first, len(found.batch.units) - 1)
        parts = []
        for (first, last), values, sds in zip(bounds, levels.values * scales, levels.sd * scales, strict=True):
            sizes = {
                names[k]: {"value": float(values[k]), "sd": float(sds[k]), "unit": unit} for k in np.flatnonzero(alone)
            }
            parts.append({"first": first, "last": last, "coefficients": sizes})
        listed.append({"effect": levels.signal.label, "p_value": levels.p_value, "parts": parts})
    return listed


def between_units_words(name: str, size: dict[str, Any]) -> str:
    """Mean and standard deviation over the units of a coefficient that differs between them."""
    mean = "undetermined" if size["mean"] is None else rounded_together(size["mean"], size["mean_sd"])
    return f"{name}: mean {mean}, standard deviation between units {size['sd_between_units']:.2g} {size['unit']}"


def _names_and_scales(signal: SharedSignal, entries: Catalogue) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the coefficients of an effect, and the scales to display units."""
    names, bases = zip(*signal.names_and_units, strict=True)
    return names, np.array(signal.scales) / [factor(entries[signal.label].unit, base) for base in bases]


def coefficients_of(found: JointDiagnosis, entries: Catalogue) -> list[tuple[str, str, float]]:
    """Of the errors of the head: name, display unit, and its size in the base unit; none if there are none."""
    if (head := found.fit.head) is None:
        return []
    units = {name: entries[signal.label].unit for signal in found.shared for name in signal.slot.names}
    displays = [units.get(name, shown(base)[0]) for name, base in zip(head.names, head.units, strict=True)]
    scales = [factor(display, base) for display, base in zip(displays, head.units, strict=True)]
    return list(zip(head.names, displays, scales, strict=True))


def shared_coefficients(found: JointDiagnosis, entries: Catalogue) -> dict[str, dict[str, Any]]:
    """Coefficients of the errors of the head: value, standard uncertainty (`sd`) and unit in display units."""
    head = found.fit.head
    return {} if head is None else _in_display_units(coefficients_of(found, entries), head.values, head.sd)


def own_estimates(found: JointDiagnosis, number: int, entries: Catalogue) -> dict[str, dict[str, Any]]:
    """Estimate of each shared coefficient by one unit, in display units, without those that it does not determine."""
    fit = found.fit
    return _in_display_units(coefficients_of(found, entries), fit.unit_values[number], fit.unit_sd[number])


def _in_display_units(
    coefficients: list[tuple[str, str, float]], values: Float[np.ndarray, " some"], sds: Float[np.ndarray, " some"]
) -> dict[str, dict]:
    """Of the first coefficients, without those of no finite uncertainty."""
    return {
        name: {"value": value / scale, "sd": sd / scale, "unit": display}
        for (name, display, scale), value, sd in zip(coefficients, values.tolist(), sds.tolist(), strict=False)
        if np.isfinite(sd)
    }


def origins(found: JointDiagnosis, entries: Catalogue) -> dict[str, dict[str, Any]]:
    """Head or sensor: for every effect, the part that it belongs to, and the probabilities that all units share it and that it
    differs between units."""
    joint, listed = found.joint, {}
    for id in dict.fromkeys(slot.id for unit in found.batch.units for slot in unit.at.model.slots):
        shared, by_unit = joint.shared_probability(id), joint.by_unit_probability(id)
        if max(shared, by_unit) > 1e-3 and id in entries:
            listed[id] = {
                "belongs_to": belongs_to(entries[id]),
                "shared": shared,
                "by_unit": by_unit,
            }
    return listed


def origins_by_class(found: JointDiagnosis, entries: Catalogue) -> Iterator[tuple[list[str], dict[str, Any]]]:
    """The origins of the effects, those of one class of indistinguishable explanations together, as the probability is that of
    the class. The most probable first."""
    listed = origins(found, entries)
    classes = [
        {labels[0] for labels in (explanation.shared.labels, *explanation.shared.equivalents) if len(labels) == 1}
        for explanation in found.joint.explanations
    ]
    done = set[str]()
    for id in sorted(listed, key=lambda id: -listed[id]["shared"] - listed[id]["by_unit"]):
        if id in done:
            continue
        members = next((members for members in classes if id in members), {id}) - {id}
        same = [other for other in listed if other in members and _same_origin(listed[other], listed[id])]
        done |= {id, *same}
        yield [other for other in listed if other == id or other in same], listed[id]


def _same_origin(one: dict, other: dict) -> bool:
    """Whether the origins of two effects are equal in a table."""
    close = all(abs(one[name] - other[name]) < 5e-3 for name in ("shared", "by_unit"))
    return close and one["belongs_to"] == other["belongs_to"]
