"""`diagnosis.json` of units on one head: the schema of one diagnosis, with `units` and more; and sizes in display units."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator

from tumblecal.diagnosis.units.joint import JointDiagnosis
from tumblecal.diagnosis.units.unit import SharedSignal
from tumblecal.effects import Catalogue
from tumblecal.effects.catalogue import belongs_to
from tumblecal.estimation.plausibility import Implausible
from tumblecal.ground.record import Estimate, ResultRecord, TextOrNull, at
from tumblecal.ground.units import factor, shown


# Folder and summary line of each unit, in the order of the files.
UnitRows = Sequence[tuple[str, Mapping[str, Any]]]
# By the name of the coefficient.
Sizes = dict[str, Estimate]
# An origin, and an explanation, of a smaller probability is not listed.
_LEAST_ORIGIN, _MOST_EXPLANATIONS, _LEAST_PROBABLE = 1e-3, 10, 1e-4


class SpreadRecord(ResultRecord):
    """Mean of a coefficient over the units with its standard uncertainty by the noise, and the standard deviation between
    units. Mean and uncertainty are None for a coefficient that is not determined separately."""

    mean: float | None
    mean_sd: float | None
    sd_between_units: float
    unit: str


class PartRecord(ResultRecord):
    """A level of an error of the head: its first and last unit, and every coefficient that is determined separately."""

    first: str
    last: str
    coefficients: Sizes


class LevelRecord(ResultRecord):
    """An error of the head with two levels."""

    effect: str
    p_value: float
    parts: list[PartRecord]


class OriginRecord(ResultRecord):
    """The part that an effect belongs to, and the probabilities that all units share it and that it differs between units."""

    belongs_to: str
    shared: float
    by_unit: float


class DetectionRecord(ResultRecord):
    """The joint test of the units."""

    statistic: float = at("joint.statistic")
    threshold: float = at("joint.threshold")
    dof: int = at("joint.dof")
    p_value: float = at("joint.p_value")
    noise: Annotated[str, BeforeValidator(lambda known: "stated" if known else "estimated")] = at("batch.noise_known")


class ExplanationRecord(ResultRecord):
    """An explanation of the errors that the units share."""

    effects: list[str] = at("shared.labels")
    equivalents: list[list[str]] = at("shared.equivalents")
    by_unit: list[str]
    probability: float
    chosen: bool
    coefficients: Sizes


class PitchRecord(ResultRecord):
    """`PitchSettings`, with the names of the units."""

    p_value: float | None
    common: bool
    other_in: list[str]
    changed_at: str | None


class UnitRecord(ResultRecord):
    """A unit: its diagnosis given the common errors, and its part in them."""

    source: str = at("row.file")
    folder: str
    verdict: str = at("row.verdict")
    effects: list[str]
    causes: list[str]
    probability: float | None = at("row.probability", None)
    p_value: float | None = at("row.p_value", None)
    outlying: bool
    left_out: bool
    same_as_shared: bool
    agrees_p_value: float
    shared: Sizes
    fault: str | None = at("row.fault", None)


class UnitsRecord(ResultRecord):
    """`diagnosis.json`: a `JointDiagnosis`; `source`: the batch in words, `text`: the verdict."""

    schema_: Literal["tumblecal.diagnosis/1"] = "tumblecal.diagnosis/1"
    source: str
    verdict: str
    text: str
    implausible: list[Implausible]
    causes: list[str] = at("joint.best.shared.labels")
    detection: DetectionRecord = at("result")
    explanations: list[ExplanationRecord]
    unexplained: Annotated[TextOrNull, BeforeValidator("; ".join)]
    origins: dict[str, OriginRecord]
    by_unit: dict[str, dict[str, SpreadRecord]]
    shown_in: dict[str, list[str]]
    levels: list[LevelRecord]
    pitch_settings: PitchRecord
    units: list[UnitRecord]


def head_sizes(found: JointDiagnosis, entries: Catalogue, unit: int | None = None) -> Sizes:
    """The errors of the head: by all units, or the estimate of one unit, without those that it does not determine."""
    fit, sizes = found.fit, Sizes()
    if (head := fit.head) is None:
        return {}
    display = {name: entries[signal.label].unit for signal in found.shared for name in signal.slot.names}
    values, sds = (head.values, head.sd) if unit is None else (fit.unit_values[unit], fit.unit_sd[unit])
    # The estimates of a unit do not include pitch settings, which are last.
    for name, base, value, sd in zip(head.names, head.units, values.tolist(), sds.tolist(), strict=False):
        if np.isfinite(sd):
            words = display.get(name, shown(base)[0])
            scale = factor(words, base)
            sizes[name] = Estimate(value=value / scale, sd=sd / scale, unit=words)
    return sizes


def spread_sizes(found: JointDiagnosis, entries: Catalogue) -> dict[str, dict[str, SpreadRecord]]:
    """The coefficients of each effect that differs between units."""
    listed = {}
    for id in found.joint.best.by_unit:
        amounts, unit = found.amounts[id], entries[id].unit
        names, scales = _names_and_scales(amounts.signal, entries)
        columns = (*(part * scales for part in amounts.mean), amounts.tau * scales, amounts.determined)
        listed[id] = {
            name: SpreadRecord(
                mean=mean if alone else None, mean_sd=sd if alone else None, sd_between_units=between, unit=unit
            )
            for name, mean, sd, between, alone in zip(names, *(column.tolist() for column in columns), strict=True)
        }
    return listed


def level_sizes(found: JointDiagnosis, entries: Catalogue, units: UnitRows) -> list[LevelRecord]:
    """The errors of the head with two levels."""
    listed = []
    for levels in found.levels:
        id = levels.signal.label
        names, scales = _names_and_scales(levels.signal, entries)
        alone, unit, parts = found.amounts[id].determined, entries[id].unit, []
        bounds = (0, levels.first - 1), (levels.first, len(units) - 1)
        for (first, last), values, sds in zip(bounds, levels.values * scales, levels.sd * scales, strict=True):
            sizes = zip(names, values.tolist(), sds.tolist(), alone, strict=True)
            known = {name: Estimate(value=value, sd=sd, unit=unit) for name, value, sd, known in sizes if known}
            parts.append(PartRecord(first=units[first][0], last=units[last][0], coefficients=known))
        listed.append(LevelRecord(effect=id, p_value=levels.p_value, parts=parts))
    return listed


def _names_and_scales(signal: SharedSignal, entries: Catalogue) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the coefficients of an effect, and the scales to display units."""
    names, bases = zip(*signal.names_and_units, strict=True)
    return names, np.array(signal.scales) / [factor(entries[signal.label].unit, base) for base in bases]


def origins(found: JointDiagnosis, entries: Catalogue) -> dict[str, OriginRecord]:
    """Head or sensor, for every effect that is not improbable."""
    ids = dict.fromkeys(slot.id for unit in found.batch.units for slot in unit.at.model.slots if slot.id in entries)
    odds = {id: (found.joint.shared_probability(id), found.joint.by_unit_probability(id)) for id in ids}
    return {
        id: OriginRecord(belongs_to=belongs_to(entries[id]), shared=shared, by_unit=by_unit)
        for id, (shared, by_unit) in odds.items()
        if max(shared, by_unit) > _LEAST_ORIGIN
    }


def units_record(found: JointDiagnosis, units: UnitRows, entries: Catalogue, source: str, text: str) -> UnitsRecord:
    """The record of the units together; `source`, `text`: as of `UnitsRecord`."""
    joint, pitch, best, names = found.joint, found.fit.pitch, found.joint.best, [name for name, _ in units]
    probable = [one for one in joint.explanations if one.probability > _LEAST_PROBABLE or one is best]
    explanations = sorted(probable[:_MOST_EXPLANATIONS], key=lambda one: one is not best)
    sizes = {True: head_sizes(found, entries), False: {}}
    return UnitsRecord.of(
        found,
        source=source,
        text=text,
        explanations=[
            ExplanationRecord.of(one, chosen=one is best, coefficients=sizes[one is best]) for one in explanations
        ],
        origins=origins(found, entries),
        by_unit=spread_sizes(found, entries),
        shown_in={id: [names[k] for k in found.amounts[id].shown_in] for id in best.by_unit},
        levels=level_sizes(found, entries, units),
        pitch_settings=PitchRecord.of(
            pitch,
            other_in=[names[k] for k in pitch.alone],
            changed_at=None if pitch.changed is None else names[pitch.changed],
        ),
        units=[_unit(found, number, name, row, entries) for number, (name, row) in enumerate(units)],
    )


def _unit(found: JointDiagnosis, number: int, name: str, row: Mapping[str, Any], entries: Catalogue) -> UnitRecord:
    causes = row["causes"].split(" + ") if row.get("causes") else []
    return UnitRecord.of(
        found.fit,
        row=row,
        folder=name,
        effects=[cause.partition(":")[0] for cause in causes],
        causes=causes,
        outlying=number in found.outlying,
        left_out=number in found.fit.excluded,
        same_as_shared=bool(causes) and number in found.nothing_of_their_own,
        agrees_p_value=found.fit.consistent[number],
        shared=head_sizes(found, entries, number),
    )
