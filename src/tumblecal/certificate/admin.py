"""Statements of a laboratory on a certificate, and limits of a data sheet: TOML files."""

import re
from collections.abc import Sequence
from datetime import date, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from tumblecal.data.calibration import Calibration
from tumblecal.data.position_comments import MEASURED, measured_at
from tumblecal.data.sensor_parameters import SENSOR, UNITS, leaf_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import Line, Strict, checked, read_toml, sizes_by_name
from tumblecal.ground.toml_faults import located


# Largest time difference of a laboratory from UTC, ahead and behind.
_ZONES = (timedelta(hours=14), timedelta(hours=12))


def _text(text: str) -> str:
    if not text or text != text.strip():
        raise ValueError("must be a text without leading and trailing blanks")
    return text


def _country(text: str) -> str:
    if not re.fullmatch("[A-Z]{2}", text):
        raise ValueError("must be the country code of two capital letters, such as AT")
    return text


# A text that XML schemas accept.
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
    """The calibrated item; with its serial number if the data do not state it."""

    name: Text
    manufacturer: Text | None = None
    model: Text | None = None
    serial_number: Text | None = None
    condition: Text = "as received, no adjustment"


class Performance(Strict):
    """Date, location and method of the calibration; without a stated method a standard text is used."""

    received: date | None = None
    begin: date
    end: date
    location: Literal["laboratory", "customer", "laboratoryBranch", "customerBranch", "other"] = "laboratory"
    method: Text | None = None


# A condition that states the temperature of the room; its first number; heating of an item by itself that is ordinary.
_ROOM = re.compile(r"\b(room|ambient|air|laboratory)\b.*temperature|^temperature$", re.IGNORECASE)
_DEGC = re.compile(r"([-+]?\d+(?:[.,]\d+)?).*(?:°|deg) ?C")
_WARMER_DEGC = 5.0


class Condition(Strict):
    """An ambient condition."""

    name: Text
    value: Text


class Equipment(Strict):
    """Measuring equipment, and the certificate of its traceability."""

    name: Text
    serial_number: Text
    certificate: Text


class Person(Strict):
    """The person who authorises the certificate."""

    name: Text
    role: Text


class Admin(Strict):
    """All statements of a laboratory."""

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
    """Limits of the size of parameters, by leaf (all its axes) or by parameter."""

    schema_: Annotated[Literal["tumblecal.limits/1"], Field(alias="schema")]
    source: Text
    limits: Annotated[dict[str, float], Field(min_length=1), sizes_by_name(UNITS)]


def read_admin(path: Path) -> Admin:
    """Read the statements of the laboratory.

    **Raises:** `InputError` with all faults, lines and dotted paths; also for dates in a wrong order.
    """
    admin = checked(path, read_toml(path), Admin)
    performance = admin.performance
    # In the required order; each date is compared with the previous stated one.
    dates = {f"performance.{name}": getattr(performance, name) for name in ("received", "begin", "end")}
    stated = [(key, day) for key, day in (dates | {"issued": admin.issued}).items() if day]
    faults = [
        f"{path}: {key}: {day} is before {earlier} {before}; correct the dates, whose order must be received, begin, end, "
        "issued"
        for (earlier, before), (key, day) in pairwise(stated)
        if day < before
    ]
    if faults:
        raise InputError(located(path, faults))
    return admin


def require_unit(admin: Admin, source: Path, calibration: Calibration, folder: Path) -> None:
    """Check that the unit is stated: by the laboratory (file `source`), the calibration (of `folder`), or both with one number.

    **Raises:** `InputError`.
    """
    serial, measured = admin.item.serial_number, calibration.serial_number
    if not (measured or serial):
        raise InputError(
            f"{source}: no serial number. Add item.serial_number here, or `# serial_number: ...` to the data file"
        )
    if measured and serial and serial != measured:
        raise InputError(f"{source}: item.serial_number is {serial}, but {folder} is of unit {measured}")


def measured_elsewhen(performance: Performance, calibration: Calibration, named: str) -> str:
    """Words on data with a date outside begin to end; "" if the date is inside, or if none is stated.

    **Raises:** `InputError`, with `named` first, for a text that is not a date.
    """
    stated = calibration.provenance.get(MEASURED)
    if stated is None:
        return ""
    instant = measured_at(str(stated), f"{named}: provenance.{MEASURED}")
    # A time in UTC may be on the previous or next day at the laboratory.
    ahead, behind = (timedelta(0),) * 2 if len(str(stated)) <= len("2026-03-31") else _ZONES
    if (instant + ahead).date() >= performance.begin and (instant - behind).date() <= performance.end:
        return ""
    return f"the data were measured at {stated}, not from {performance.begin} to {performance.end}"


def item_elsewhere(conditions: Sequence[Condition], item_degc: float | None) -> str:
    """Words on a room temperature that the mean temperature of the item contradicts; "" if there is none."""
    for condition in conditions:
        stated = _DEGC.search(condition.value) if _ROOM.search(condition.name) else None
        if stated is None or item_degc is None:
            continue
        warmer_degc = item_degc - float(stated[1].replace(",", "."))
        if abs(warmer_degc) > _WARMER_DEGC:
            return (
                f"The mean temperature of the item, {item_degc:.1f} degC, differs by {warmer_degc:+.3g} degC from the stated "
                f"{condition.name}, {condition.value}."
            )
    return ""


def read_limits(path: Path) -> tuple[str, dict[str, float]]:
    """Source of the limits, and the limit of the size of each sensor parameter that has one, base units: that of the
    parameter, otherwise that of its leaf, in any order.

    **Raises:** `InputError` with all faults and their dotted paths.
    """
    table = checked(path, read_toml(path), LimitsTable)
    stated = {name: table.limits.get(name, table.limits.get(leaf_of(name))) for name in SENSOR}
    return table.source, {name: limit for name, limit in stated.items() if limit is not None}
