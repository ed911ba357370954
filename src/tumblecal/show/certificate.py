"""A certificate as a page to print: A4, with what ISO/IEC 17025, 7.8 asks for; and its words on a terminal."""

from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from scipy.special import gammaincinv

from tumblecal import __version__
from tumblecal.certificate.admin import Admin
from tumblecal.certificate.judged import head_covariance
from tumblecal.certificate.results import (
    RULE,
    SCOPE,
    VERDICTS,
    Result,
    Results,
    ResultTable,
    method_words,
    serial_number,
)
from tumblecal.certificate.term_words import term_words
from tumblecal.certificate.validity import validity_words
from tumblecal.data.not_applied import use_lines
from tumblecal.data.uncertainty_parts import contribution_words
from tumblecal.ground.atomic import write_text
from tumblecal.ground.gravity import STANDARD
from tumblecal.ground.numbers_shown import rounded
from tumblecal.ground.units import shown
from tumblecal.show.words import Words, words_of


# D-SI units of the base units; g is converted to m/s^2.
_UNITS = {"1": "", "rad": r"\radian", "g": r"\metre\second\tothe{-2}"}


def write_certificate(folder: Path, admin: Admin, results: Results, limits_source: str) -> None:
    """Write `certificate.html`, and `dcc.xml`: a Digital Calibration Certificate of PTB, with D-SI quantities and the full
    covariance; each whole or not at all."""
    judged, gravity = results.conformity is not None, results.calibration.gravity or STANDARD

    def in_si(table: ResultTable) -> tuple[list[list[float]], list[tuple[Result, str, float, float]]]:
        """Covariance and results of a table in D-SI units."""
        factors = [gravity.value_ms2 if result.unit == "g" else 1.0 for result in table.results]
        scaled = [
            (of, _UNITS[of.unit], of.value * k, of.expanded * k) for of, k in zip(table.results, factors, strict=True)
        ]
        return (table.covariance * np.outer(factors, factors)).tolist(), scaled

    count = len(results.tables[0].results)
    content = {
        "admin": admin,
        "results": results,
        "calibration": results.calibration,
        "serial": serial_number(admin, results),
        "method": method_words(admin, results),
        "judged": judged,
        "verdicts": VERDICTS,
        "rule": RULE,
        "limits_source": limits_source,
        "validity": validity_words(results.calibration, judged=judged, temperatures_degc=results.temperatures_degc),
        "scope": SCOPE,
        "gravity": gravity,
        "terms": list(term_words(results.calibration)),
        "version": __version__,
        "shown": shown,
        "rounded": rounded,
        "in_si": in_si,
        # Of the ellipsoid with this coverage probability for a normal distribution: chi-square with `count` dof.
        "radius": float(np.sqrt(2 * gammaincinv(count / 2, results.level))),
    }
    loader = PackageLoader("tumblecal.show")
    for name, template, blocks in (("certificate.html", "certificate.html", False), ("dcc.xml", "dcc.xml.j2", True)):
        made = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=blocks)
        text = made.get_template(template).render(content)
        write_text(folder / name, f"{text.strip()}\n")


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
