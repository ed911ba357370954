"""A certificate as a page to print: A4, with what ISO/IEC 17025, 7.8 asks for."""

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from tumblecal import __version__
from tumblecal.certificate.admin import Address, Admin
from tumblecal.certificate.results import RULE, SCOPE, VERDICTS, Results, ResultTable, method_words, serial_number
from tumblecal.certificate.term_words import term_words
from tumblecal.certificate.validity import validity_words
from tumblecal.ground.atomic import write_text
from tumblecal.ground.gravity import STANDARD
from tumblecal.ground.numbers_shown import rounded
from tumblecal.ground.units import shown


def write_certificate(path: Path, admin: Admin, results: Results, limits_source: str) -> None:
    """Write the page, whole or not at all."""
    environment = Environment(loader=PackageLoader("tumblecal.show"), autoescape=True, undefined=StrictUndefined)
    calibration = results.calibration
    text = environment.get_template("certificate.html").render(
        admin=admin,
        laboratory=_lines(admin.laboratory),
        customer=_lines(admin.customer),
        serial=serial_number(admin, results),
        method=method_words(admin, results),
        tables=[(table.at.removeprefix(" at "), _rows(table), table.calibration.rows) for table in results.tables],
        limited=results.conformity is not None,
        conformity=VERDICTS.get(results.conformity or "", ""),
        rule=RULE,
        limits_source=limits_source,
        outcome=results.outcome,
        reservation=results.reservation,
        held=validity_words(
            calibration, judged=results.conformity is not None, temperatures_degc=results.temperatures_degc
        ),
        uncertainty=results.uncertainty_words,
        scope=SCOPE,
        gravity=str(calibration.gravity or STANDARD),
        temperature=None if calibration.temperature_degc is None else f"{calibration.temperature_degc:.1f} degC",
        source=calibration.provenance.get("data", ""),
        sha256=calibration.provenance.get("sha256") or "",
        terms=list(term_words(calibration)),
        version=__version__,
    )
    write_text(path, text)


def _lines(address: Address) -> list[str]:
    town = " ".join(part for part in (address.post_code, address.city) if part)
    return [part for part in (address.name, address.street, town, address.country, address.email) if part]


def _rows(table: ResultTable) -> list[list[str]]:
    rows = []
    for result in table.results:
        unit, factor = shown(result.unit)
        digits = [*rounded(result.value * factor, result.expanded * factor), f"{result.k:.2f}", unit]
        limit = "" if result.limit is None else f"{result.limit * factor:g}"
        rows.append([result.name, *digits, limit, VERDICTS.get(result.conformity or "", "")])
    return rows
