"""A Digital Calibration Certificate: DCC XML of PTB with D-SI quantities and the full covariance."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from datetime import date
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.special import gammaincinv

from tumblecal import __version__
from tumblecal.certificate.admin import Address, Admin
from tumblecal.certificate.results import RULE, SCOPE, Results, ResultTable, method_words, serial_number
from tumblecal.certificate.term_words import term_words
from tumblecal.certificate.validity import validity_words
from tumblecal.ground.gravity import STANDARD


# Version of the schema.
DCC_VERSION = "3.2.1"
_DCC, _SI = "https://ptb.de/dcc", "https://ptb.de/si"
_LANGUAGE = "en"
# D-SI units of the base units; g is converted to m/s^2.
_UNITS = {"1": r"\one", "rad": r"\radian", "g": r"\metre\second\tothe{-2}"}
ElementTree.register_namespace("dcc", _DCC)
ElementTree.register_namespace("si", _SI)


def dcc_text(admin: Admin, results: Results, limits_source: str) -> str:
    """The certificate as XML.

    **Arguments:**

    - `limits_source`: source of the limits, for the statement of conformity.
    """
    root = Element(f"{{{_DCC}}}digitalCalibrationCertificate", schemaVersion=DCC_VERSION)
    _administrative(_dcc(root, "administrativeData"), admin, results, limits_source)
    _measurement(_dcc(_dcc(root, "measurementResults"), "measurementResult"), admin, results)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _dcc(parent: Element, name: str, text: str | date | None = None, **attributes: str) -> Element:
    return _element(parent, _DCC, name, text, attributes)


def _si(parent: Element, name: str, text: str | None = None) -> Element:
    return _element(parent, _SI, name, text, {})


def _element(parent: Element, space: str, name: str, text: str | date | None, attributes: dict[str, str]) -> Element:
    element = SubElement(parent, f"{{{space}}}{name}", attributes)
    element.text = None if text is None else str(text)
    return element


def _text(parent: Element, name: str, text: str) -> None:
    """A text in the language of the certificate."""
    _dcc(_dcc(parent, name), "content", text, lang=_LANGUAGE)


def _administrative(parent: Element, admin: Admin, results: Results, limits_source: str) -> None:
    software = _dcc(_dcc(parent, "dccSoftware"), "software")
    _text(software, "name", "tumblecal")
    _dcc(software, "release", __version__)
    core = _dcc(parent, "coreData")
    _dcc(core, "countryCodeISO3166_1", admin.laboratory.country)
    for name in ("usedLangCodeISO639_1", "mandatoryLangCodeISO639_1"):
        _dcc(core, name, _LANGUAGE)
    _dcc(core, "uniqueIdentifier", admin.id)
    if admin.performance.received:
        _dcc(core, "receiptDate", admin.performance.received)
    _dcc(core, "beginPerformanceDate", admin.performance.begin)
    _dcc(core, "endPerformanceDate", admin.performance.end)
    _dcc(core, "performanceLocation", admin.performance.location)
    _dcc(core, "issueDate", admin.issued)
    _item(_dcc(_dcc(parent, "items"), "item"), admin, results)
    laboratory = _dcc(parent, "calibrationLaboratory")
    if admin.laboratory.accreditation:
        _dcc(laboratory, "calibrationLaboratoryCode", admin.laboratory.accreditation)
    _contact(_dcc(laboratory, "contact"), admin.laboratory)
    person = _dcc(_dcc(parent, "respPersons"), "respPerson")
    _text(_dcc(person, "person"), "name", admin.authorised_by.name)
    _dcc(person, "role", admin.authorised_by.role)
    _dcc(person, "mainSigner", "true")
    _contact(_dcc(parent, "customer"), admin.customer)
    _statements(_dcc(parent, "statements"), admin, results, limits_source)


def _item(item: Element, admin: Admin, results: Results) -> None:
    _text(item, "name", admin.item.name)
    _text(item, "description", admin.item.condition)
    if admin.item.manufacturer:
        _text(_dcc(item, "manufacturer"), "name", admin.item.manufacturer)
    if admin.item.model:
        _dcc(item, "model", admin.item.model)
    _identification(item, serial_number(admin, results))


def _identification(parent: Element, serial: str) -> None:
    identification = _dcc(_dcc(parent, "identifications"), "identification")
    _dcc(identification, "issuer", "manufacturer")
    _dcc(identification, "value", serial)
    _text(identification, "name", "serial number")


def _contact(parent: Element, address: Address) -> None:
    _text(parent, "name", address.name)
    if address.email:
        _dcc(parent, "eMail", address.email)
    location = _dcc(parent, "location")
    parts = {
        "street": address.street,
        "postCode": address.post_code,
        "city": address.city,
        "countryCode": address.country,
    }
    for name, text in parts.items():
        if text:
            _dcc(location, name, text)


def _statements(parent: Element, admin: Admin, results: Results, limits_source: str) -> None:
    statements = [("judgement", results.reservation)] if results.reservation else []
    statements += [("scope", SCOPE), ("traceability", admin.traceability), ("uncertainty", results.uncertainty_words)]
    for name, text in [*statements, *(("remark", remark) for remark in admin.remarks)]:
        statement = _dcc(parent, "statement")
        _text(statement, "name", name)
        _text(statement, "declaration", text)
    if results.conformity:
        statement = _dcc(parent, "statement")
        _text(statement, "name", "conformity")
        validity = validity_words(results.calibration, judged=True, temperatures_degc=results.temperatures_degc)
        _text(statement, "declaration", f"{RULE}. Limits: {limits_source}{validity and f'. {validity}'}")
        _dcc(statement, "conformity", results.conformity)


def _measurement(parent: Element, admin: Admin, results: Results) -> None:
    _text(parent, "name", "Calibration of the accelerometer triad")
    _text(parent, "description", results.outcome)
    method = _dcc(_dcc(parent, "usedMethods"), "usedMethod")
    _text(method, "name", method_words(admin, results))
    if admin.equipment:
        listed = _dcc(parent, "measuringEquipments")
        for instrument in admin.equipment:
            equipment = _dcc(listed, "measuringEquipment")
            _text(equipment, "name", f"{instrument.name} ({instrument.certificate})")
            _identification(equipment, instrument.serial_number)
    conditions = _dcc(parent, "influenceConditions")
    gravity = results.calibration.gravity or STANDARD
    computed = [("one g", str(gravity))]
    judged = results.conformity is not None
    if validity := validity_words(results.calibration, judged=judged, temperatures_degc=results.temperatures_degc):
        computed.append(("validity of the values", validity))
    for name, value in (*((c.name, c.value) for c in admin.conditions), *computed):
        condition = _dcc(conditions, "influenceCondition")
        _text(condition, "name", name)
        _text(_dcc(condition, "data"), "text", value)
    listed = _dcc(parent, "results")
    for table in results.tables:
        _result(_dcc(listed, "result"), table, results, gravity.value_ms2)


def _result(parent: Element, table: ResultTable, results: Results, gravity_ms2: float) -> None:
    _text(parent, "name", f"scale factor errors, biases, non-orthogonalities{table.at}")
    terms = "".join(f"; in addition in {words}" for words in term_words(results.calibration))
    _text(parent, "description", f"A = diag(1 + dK) T f + bias, T = [1 0 0; gamma_21 1 0; gamma_31 gamma_32 1]{terms}")
    data = _dcc(parent, "data")
    if table.temperature_degc is not None:
        temperature = _dcc(data, "quantity")
        _text(temperature, "name", "temperature")
        real = _si(temperature, "real")
        _si(real, "value", repr(table.temperature_degc))
        _si(real, "unit", r"\degreecelsius")
    quantity = _dcc(data, "quantity")
    _text(quantity, "name", ", ".join(result.name for result in table.results))
    _list(_si(_si(quantity, "list"), "realList"), table, results.level, gravity_ms2)
    _metadata(quantity, table)


def _metadata(quantity: Element, table: ResultTable) -> None:
    """The conformity of each parameter with a limit."""
    limited = [result for result in table.results if result.conformity]
    if limited:
        listed = _dcc(quantity, "measurementMetaData")
        for result in limited:
            data = _dcc(listed, "metaData")
            _text(data, "name", result.name)
            _text(data, "declaration", f"limit {result.limit:.6g} {result.unit}")
            _dcc(data, "conformity", result.conformity or "")


def _list(parent: Element, table: ResultTable, level: float, gravity_ms2: float) -> None:
    factors = np.array([gravity_ms2 if result.unit == "g" else 1.0 for result in table.results])
    units = [_UNITS[result.unit] for result in table.results]
    for result, factor, unit in zip(table.results, factors, units, strict=True):
        real = _si(parent, "real")
        _si(real, "label", result.name)
        _si(real, "value", repr(result.value * float(factor)))
        _si(real, "unit", unit)
        expanded = _si(real, "expandedUnc")
        _si(expanded, "uncertainty", repr(result.expanded * float(factor)))
        _si(expanded, "coverageFactor", f"{max(result.k, 1.0):.4f}")
        _si(expanded, "coverageProbability", f"{level:.6f}")
    region = _si(parent, "ellipsoidalRegion")
    _covariance(_si(region, "covarianceMatrix"), table.covariance * np.outer(factors, factors), units)
    # Radius of the ellipsoid with this coverage probability for a normal distribution: chi-square with len(units) dof.
    radius = float(np.sqrt(2 * gammaincinv(len(units) / 2, level)))
    _si(region, "coverageFactor", f"{radius:.4f}")
    _si(region, "coverageProbability", f"{level:.6f}")


def _covariance(parent: Element, covariance: np.ndarray, units: Sequence[str]) -> None:
    for column, unit in enumerate(units):
        listed = _si(parent, "column")
        for row, other in enumerate(units):
            entry = _si(listed, "covariance")
            _si(entry, "value", repr(float(covariance[row, column])))
            both = [name for name in (other, unit) if name != r"\one"]
            _si(entry, "unit", "".join(both) or r"\one")
