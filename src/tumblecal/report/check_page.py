"""`check.html`: a check on one screen: verdict, size of gravity at each attitude, detection limits, next steps."""

from functools import partial
from pathlib import Path

from tumblecal.check.result import CheckResult
from tumblecal.report.check_verdict import TONES
from tumblecal.report.check_words import attitudes_words
from tumblecal.report.page import Section, page, write_page
from tumblecal.report.tables import Table
from tumblecal.report.verdict import Verdict
from tumblecal.show.figures.check import check_figure, limits, sizes


@page
def write_check_page(path: Path, result: CheckResult, verdict: Verdict) -> None:
    """Write the page."""
    serial = result.data.serial_number or result.calibration.serial_number
    unit = f"serial number {serial}, " if serial else ""
    if len(verdict.found) > 1:
        cards = {1: partial(check_figure, result, sizes), 2: partial(check_figure, result, limits)}
    else:
        cards = {len(verdict.found): partial(check_figure, result, sizes, limits)}
    write_page(
        path,
        f"Check of {result.path.name}",
        f"{unit}{Path(result.data.source).name}: {attitudes_words(result)}.",
        verdict,
        [Section("Conditions", tables=[Table(("", ""), list(verdict.details), text=(0, 1))])],
        tone=TONES[result.outcome],
        pictures=cards,
    )
