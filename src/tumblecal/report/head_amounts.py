"""Amounts of effects of units: of the head, of each unit, mean and dispersion over the batch, levels; in display units."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from tumblecal.diagnosis.units import Together
from tumblecal.diagnosis.units.unit import SharedSignal
from tumblecal.effects import Catalogue
from tumblecal.effects.catalogue import belongs_to
from tumblecal.ground.numbers_shown import rounded_together
from tumblecal.ground.units import factor, shown


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


def shared_coefficients(found: Together, entries: Catalogue) -> dict[str, dict]:
    """Coefficients of the errors of the head: value, standard uncertainty (`sd`) and unit in display units."""
    listed, head = {}, found.fit.head
    if head is None:
        return listed
    units = {name: entries[signal.label].unit for signal in found.shared for name in signal.slot.names}
    for name, base, value, sd in zip(head.names, head.units, head.values, head.sd, strict=True):
        display = units.get(name, shown(base)[0])
        scale = factor(display, base)
        listed[name] = {"value": float(value / scale), "sd": float(sd / scale), "unit": display}
    return listed


def own_estimates(found: Together, number: int, entries: Catalogue) -> dict[str, dict]:
    """Estimate of each shared coefficient by one unit, in display units, without those that it does not determine."""
    listed, head = {}, found.fit.head
    sizes = shared_coefficients(found, entries) if found.shared else {}
    for k, name in enumerate(name for signal in found.shared for name in signal.slot.names):
        assert head is not None
        # The uncertainties in base and display units give the scale.
        scale = sizes[name]["sd"] / float(head.sd[k])
        value, sd = float(found.fit.own_values[number, k] * scale), float(found.fit.own_sd[number, k] * scale)
        if np.isfinite(sd):
            listed[name] = {"value": value, "sd": sd, "unit": sizes[name]["unit"]}
    return listed


def origins(found: Together, entries: Catalogue) -> dict[str, dict]:
    """Head or sensor: for every effect, the part that it belongs to, and the probabilities that all units share it and that it
    differs between units."""
    joint, listed = found.joint, {}
    for id in dict.fromkeys(slot.id for unit in found.units for slot in unit.at.model.slots):
        shared, by_unit = joint.shared_probability(id), joint.spread_probability(id)
        if max(shared, by_unit) > 1e-3 and id in entries:
            listed[id] = {
                "belongs_to": belongs_to(entries[id]),
                "shared": shared,
                "by_unit": by_unit,
            }
    return listed


def origins_by_class(found: Together, entries: Catalogue) -> Iterator[tuple[list[str], dict]]:
    """The origins of the effects, those of one class of indistinguishable explanations together, as the probability is that of
    the class. The most probable first."""
    listed = origins(found, entries)
    classes = [
        {labels[0] for labels in (explanation.told.labels, *explanation.told.equivalents) if len(labels) == 1}
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
