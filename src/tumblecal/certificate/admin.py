"""What a laboratory states on a certificate, and limits of a data sheet: TOML files."""

import re
from datetime import date
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import Line, Strict, checked, read_toml
from tumblecal.ground.toml_faults import located
from tumblecal.ground.units import quantity


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

    **Raises:** `InputError` with every fault and its dotted path.
    """
    return checked(path, read_toml(path), Admin)


def read_limits(path: Path) -> tuple[str, dict[str, float]]:
    """Where the limits are from, and the largest size of each of the sensor's parameters that has one, base units.

    **Raises:** `InputError` with every fault and its dotted path.
    """
    table, faults, limits = checked(path, read_toml(path), LimitsTable), [], {}
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
            limits |= dict.fromkeys(names, size)
        except InputError as error:
            faults.append(f"{path}: limits.{key}: {error}")
    if faults:
        raise InputError(located(path, faults))
    return table.source, limits
