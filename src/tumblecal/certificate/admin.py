"""What a laboratory states on a certificate, and limits of a data sheet: TOML files."""

import re
from datetime import date, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from tumblecal.data.calibration import Calibration
from tumblecal.data.measured import MEASURED, measured_at
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import Line, Strict, checked, read_toml
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import quantity


# How far clocks of laboratories are ahead of UTC and behind it, at most.
_ZONES = (timedelta(hours=14), timedelta(hours=12))


def _text(text: str) -> str:
    if not text or text != text.strip():
        raise ValueError("must be some words, without blanks before and behind")
    return text


def _country(text: str) -> str:
    if not re.fullmatch("[A-Z]{2}", text):
        raise ValueError("must be the country's code of two capital letters, such as AT")
    return text


# Words that XML schemas take for a text.
Text = Annotated[Line, AfterValidator(_text)]
Country = Annotated[str, AfterValidator(_country)]


class Address(Strict):
    """A laboratory or customer."""

    name: Text
    street: Text | None = None
    post_code: Text | None = None
    city: Text
    country: Country
    email: Text | None = None


class Laboratory(Address):
    """The laboratory; `accreditation` is its code."""

    accreditation: Text | None = None


class Item(Strict):
    """What was calibrated; its serial number where the data say none."""

    name: Text
    manufacturer: Text | None = None
    model: Text | None = None
    serial_number: Text | None = None
    condition: Text = "as received, no adjustment"


class Performance(Strict):
    """When, where and how it was calibrated; how in our words where the laboratory says none."""

    received: date | None = None
    begin: date
    end: date
    location: Literal["laboratory", "customer", "laboratoryBranch", "customerBranch", "other"] = "laboratory"
    method: Text | None = None


class Condition(Strict):
    """An ambient condition."""

    name: Text
    value: Text


class Equipment(Strict):
    """Measuring equipment, and the certificate that makes it traceable."""

    name: Text
    serial_number: Text
    certificate: Text


class Person(Strict):
    """Who authorises the certificate."""

    name: Text
    role: Text


class Admin(Strict):
    """All of it."""

    schema_: Annotated[Literal["tumblecal.certificate/1"], Field(alias="schema")]
    id: Text
    issued: date
    laboratory: Laboratory
    customer: Address
    item: Item
    performance: Performance
    traceability: Text
    authorised_by: Person
    conditions: list[Condition] = Field(default_factory=list)
    equipment: list[Equipment] = Field(default_factory=list)
    remarks: list[Text] = Field(default_factory=list)


class LimitsTable(Strict):
    """Limits of the size of parameters, by leaf (all of its axes) or parameter."""

    schema_: Annotated[Literal["tumblecal.limits/1"], Field(alias="schema")]
    source: Text
    limits: Annotated[dict[str, str], Field(min_length=1)]


def read_admin(path: Path) -> Admin:
    """What the laboratory states.

    **Raises:** `InputError` with every fault, its line and its dotted path; of dates that cannot follow each other as well.
    """
    admin = checked(path, read_toml(path), Admin)
    own = admin.performance
    # In the order in which they must follow each other; each is compared with the one before that is stated.
    dates = {"performance.received": own.received, "performance.begin": own.begin, "performance.end": own.end}
    stated = [(key, day) for key, day in (dates | {"issued": admin.issued}).items() if day]
    faults = [
        f"{path}: {key}: {day} is before {earlier} {before}; received, begin, end and issued must follow each other"
        for (earlier, before), (key, day) in pairwise(stated)
        if day < before
    ]
    if faults:
        raise InputError(located(path, faults))
    return admin


def measured_elsewhen(performance: Performance, calibration: Calibration, named: str) -> str:
    """Words on data that state another date than begin to end; "" where they fit, or state none.

    **Raises:** `InputError` that begins with `named` where they state what is no date.
    """
    stated = calibration.provenance.get(MEASURED)
    if stated is None:
        return ""
    instant = measured_at(str(stated), f"{named}: provenance.{MEASURED}")
    # A time in UTC may be of the day before or after where the laboratory is.
    ahead, behind = (timedelta(0),) * 2 if len(str(stated)) <= len("2026-03-31") else _ZONES
    if (instant + ahead).date() >= performance.begin and (instant - behind).date() <= performance.end:
        return ""
    return f"the data were measured at {stated}, not from {performance.begin} to {performance.end}"


def read_limits(path: Path) -> tuple[str, dict[str, float]]:
    """Where the limits are from, and the largest size of each of the sensor's parameters that has one, base units: its own,
    else that of its leaf, in whatever order they stand.

    **Raises:** `InputError` with every fault and its dotted path.
    """
    table, faults = checked(path, read_toml(path), LimitsTable), []
    of_leaves, single = dict[str, float](), dict[str, float]()
    for key, text in table.limits.items():
        names = [name for name in SENSOR if key in (name, leaf_of(name))]
        if not names:
            faults.append(
                f"{path}: limits.{key}: no parameter of the sensor; there are dK, bias, gamma, {', '.join(SENSOR)}"
            )
            continue
        try:
            size = quantity(text, GROUPS[leaf_of(names[0])][1])
            if not size > 0:
                raise InputError(f"{text!r} must be above 0")
            (single if key in SENSOR else of_leaves).update(dict.fromkeys(names, size))
        except InputError as error:
            faults.append(f"{path}: limits.{key}: {error}")
    if faults:
        raise InputError(located(path, faults))
    return table.source, of_leaves | single
