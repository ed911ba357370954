"""A certificate as a page to print: A4, with what ISO/IEC 17025, 7.8 asks for."""

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from tumblecal import __version__
from tumblecal.certificate.admin import Admin
from tumblecal.certificate.results import RULE, SCOPE, VERDICTS, Results, method_words, serial_number
from tumblecal.certificate.term_words import term_words
from tumblecal.certificate.validity import validity_words
from tumblecal.ground.atomic import write_text
from tumblecal.ground.gravity import STANDARD
from tumblecal.ground.numbers_shown import rounded
from tumblecal.ground.units import shown


def write_certificate(path: Path, admin: Admin, results: Results, limits_source: str) -> None:
    """Write the page, whole or not at all."""
    environment = Environment(loader=PackageLoader("tumblecal.show"), autoescape=True, undefined=StrictUndefined)
    judged = results.conformity is not None
    text = environment.get_template("certificate.html").render(
        admin=admin,
        results=results,
        calibration=results.calibration,
        serial=serial_number(admin, results),
        method=method_words(admin, results),
        judged=judged,
        verdicts=VERDICTS,
        rule=RULE,
        limits_source=limits_source,
        validity=validity_words(results.calibration, judged=judged, temperatures_degc=results.temperatures_degc),
        scope=SCOPE,
        gravity=results.calibration.gravity or STANDARD,
        terms=list(term_words(results.calibration)),
        version=__version__,
        shown=shown,
        rounded=rounded,
    )
    write_text(path, text)
