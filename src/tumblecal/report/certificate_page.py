"""A certificate as a page to print: A4, with what ISO/IEC 17025, 7.8 asks for."""

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from tumblecal import __version__
from tumblecal.certificate.admin import Address, Admin
from tumblecal.certificate.holds_at import holds_at
from tumblecal.certificate.results import RULE, SCOPE, VERDICTS, Results, method_words, serial_number
from tumblecal.certificate.term_words import term_words
from tumblecal.ground.atomic import write_text
from tumblecal.ground.gravity import STANDARD
from tumblecal.ground.numbers_shown import rounded
from tumblecal.ground.units import shown


def write_certificate(path: Path, admin: Admin, results: Results, limits_source: str) -> None:
    """Write the page, whole or not at all."""
    environment = Environment(loader=PackageLoader("tumblecal.report"), autoescape=True, undefined=StrictUndefined)
    own = results.calibration
    text = environment.get_template("certificate.html").render(
        admin=admin,
        laboratory=_lines(admin.laboratory),
        customer=_lines(admin.customer),
        serial=serial_number(admin, results),
        method=method_words(admin, results),
        rows=_rows(results),
        limited=results.conformity is not None,
        conformity=VERDICTS.get(results.conformity or "", ""),
        rule=RULE,
        limits_source=limits_source,
        outcome=results.outcome,
        reservation=results.reservation,
        held=holds_at(own, judged=results.conformity is not None),
        uncertainty=results.uncertainty_words,
        scope=SCOPE,
        matrix=own.rows,
        gravity=str(own.gravity or STANDARD),
        temperature=None if own.temperature_degc is None else f"{own.temperature_degc:.1f} degC",
        source=own.provenance.get("data", ""),
        sha256=own.provenance.get("sha256") or "",
        terms=list(term_words(own)),
        version=__version__,
    )
    write_text(path, text)


def _lines(address: Address) -> list[str]:
    town = " ".join(part for part in (address.post_code, address.city) if part)
    return [part for part in (address.name, address.street, town, address.country, address.email) if part]


def _rows(results: Results) -> list[list[str]]:
    rows = []
    for own in results.results:
        unit, factor = shown(own.unit)
        digits = [*rounded(own.value * factor, own.expanded * factor), f"{own.k:.2f}", unit]
        limit = "" if own.limit is None else f"{own.limit * factor:g}"
        rows.append([own.name, *digits, limit, VERDICTS.get(own.conformity or "", "")])
    return rows
