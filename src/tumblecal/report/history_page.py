"""`history.html`: control charts, repeatability and drift of a unit on one page."""

from collections.abc import Sequence
from pathlib import Path

from tumblecal.history.repeatability import FEWEST, TOGETHER, UnitHistory
from tumblecal.report.history_list import listed
from tumblecal.report.history_words import (
    en_table,
    headline,
    interval_words,
    next_steps,
    repeatability_words,
    repeats_table,
    statements,
    trends_table,
    uncertainty_words,
)
from tumblecal.report.page import Section, inline_figure, page, write_page
from tumblecal.report.verdict import Finding, Verdict, as_sentence


_CAPTION = (
    "Bars: expanded uncertainty at 95.45 % (k = 2 if the noise was stated, otherwise Student's t). Line: constant, with the "
    "changes that were found. Band: control limits about the mean, from the moving range, from four results on. Results beyond "
    "them are red; several charts of a stable unit have one."
)
_TESTED = (
    "Steps, drifts and single deviating results were tested against a constant with the repeatability, at a family-wise error "
    f"rate of {1 - TOGETHER:.2g} for the unit. +- is the standard uncertainty. Mount angles and pitch errors are not "
    "properties of the unit"
)


@page
def write_history_page(path: Path, serial: str, history: UnitHistory, risk: float, charts: Sequence[str]) -> None:
    """Write the page; `charts`: names of the control charts in its folder."""
    found = statements(history)
    enough = len(history.entries) >= FEWEST
    evidence = [repeatability_words(history), _TESTED, uncertainty_words(history)]
    verdict = Verdict(
        "flagged" if found else "stable" if enough else "open",
        found[0].words if found else headline(serial, history),
        found=tuple(Finding(as_sentence(one.words)) for one in found[len(found) == 1 :]),
        evidence=tuple(f"{as_sentence(words)}." for words in evidence if words),
        next=tuple(f"{as_sentence(words)}." for words in [*next_steps(found), interval_words(history, risk)]),
    )
    write_page(
        path,
        f"History of {serial}",
        f"{len(history.entries)} independent results{f', {history.months:.1f} months' if history.months else ''}.",
        verdict,
        [
            Section("Repeatability", tables=[repeats_table(history)]),
            Section("Control charts", figures=[inline_figure(path.parent / name, _CAPTION) for name in charts]),
            Section("Parameters", tables=[trends_table(history)]),
            Section("E_n of each result and the previous one", tables=[en_table(history)]),
            Section("Results", tables=[listed(history.entries)]),
        ],
        tone="bad" if found else "good" if enough else "open",
    )
