"""A certificate as a page to print: A4, with what ISO/IEC 17025, 7.8 asks for; and its words on a terminal."""

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from tumblecal import __version__
from tumblecal.certificate.admin import Admin
from tumblecal.certificate.judged import head_covariance
from tumblecal.certificate.results import RULE, SCOPE, VERDICTS, Results, method_words, serial_number
from tumblecal.certificate.term_words import term_words
from tumblecal.certificate.validity import validity_words
from tumblecal.data.not_applied import use_lines
from tumblecal.data.uncertainty_parts import contribution_words
from tumblecal.ground.atomic import write_text
from tumblecal.ground.gravity import STANDARD
from tumblecal.ground.numbers_shown import rounded
from tumblecal.ground.units import shown
from tumblecal.show.words import Words, words_of


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


def words_of_certificate(results: Results, admin: Path, elsewhen: str, *, stated_degc: bool) -> Words:
    """What the laboratory should read before it signs.

    **Arguments:**

    - `admin`: file of its statements. `elsewhen`: why their dates contradict the calibration; "" if they do not.
    - `stated_degc`: whether the temperatures of the values are stated.
    """
    calibration = results.calibration
    head = "the measured head" if head_covariance(calibration) else ""
    return words_of(
        "certificate",
        r=results,
        gravity_stated=calibration.gravity is not None and not calibration.gravity.assumed,
        admin=admin,
        elsewhen=elsewhen,
        included=contribution_words(calibration, head),
        use=use_lines(calibration),
        stated_degc=stated_degc,
        verdicts=VERDICTS,
    )
