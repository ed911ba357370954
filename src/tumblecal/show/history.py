"""The history of a unit for people: its words, its verdict, its lines on a terminal, and its page."""

from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import numpy as np

from tumblecal.data.sensor_parameters import GROUPS, leaf_of
from tumblecal.history.changes import STEP, Change
from tumblecal.history.repeatability import DAYS_A_MONTH, FEWEST, MOUNTING, TOGETHER, Trend, UnitHistory
from tumblecal.show.figures.drawing import write_each
from tumblecal.show.figures.history import FIGURES
from tumblecal.show.history_list import listed
from tumblecal.show.page import write_page
from tumblecal.show.verdict import Finding, Verdict
from tumblecal.show.words import Words, words_of
from tumblecal.words import as_sentence


def words_of_history(serial: str, history: UnitHistory, risk: float) -> Words:
    """The words of the history of a unit; block `findings`: each with its next step."""
    results, (months, limiting) = history.entries, history.interval(risk)
    # Changes by kind, first and last result, the largest first: those of several parameters are one finding.
    found = [(trend, change) for trend in history.trends for change in trend.changes]
    events = dict[tuple[str, int, int], list[tuple[Trend, Change]]]()
    for trend, change in sorted(found, key=lambda pair: -abs(pair[1].size) / pair[1].u):
        events.setdefault((change.kind, change.first, change.last), []).append((trend, change))
    return words_of(
        "history",
        h=history,
        serial=serial,
        risk=risk,
        results=results,
        events=events,
        latest=max((last for kind, _, last in events if kind == STEP), default=0),
        changed_kinds={leaf_of(trend.name) for trend in history.trends if trend.changes},
        refused=[entry for entry in results if entry.refused],
        known=[kind for kind in history.repeats if kind.leaf != MOUNTING and np.isfinite(kind.sd)],
        months=months,
        limiting=limiting,
        due=np.isfinite(months) and (results[-1].when + timedelta(days=months * DAYS_A_MONTH)).date(),
        dofs=[each.parameters.dof for each in results if each.parameters and np.isfinite(each.parameters.dof)],
        fewest=FEWEST,
        together=TOGETHER,
        mounting=MOUNTING,
        groups=GROUPS,
        finite=np.isfinite,
    )


def steps(words: Words) -> list[str]:
    """The next steps of all findings."""
    return list(dict.fromkeys(step for _, step in words.pairs("findings") if step))


def verdict_of_history(words: Words) -> Verdict:
    """The verdict of the page: the first finding is the headline."""
    found = [as_sentence(finding) for finding, _ in words.pairs("findings")]
    return replace(
        words.verdict,
        verdict="flagged" if found else words.text("badge"),
        headline=f"{found[0]}." if found else words.text("headline"),
        found=tuple(map(Finding, found[1:])),
        evidence=(*words.lines("repeatability"), *words.lines("evidence")),
        next=(*steps(words), *words.lines("interval")),
    )


def history_text(words: Words) -> str:
    """The history of a unit for a terminal: one line, or each finding, the next steps, and repeatability."""
    found, closing = words.pairs("findings"), f"{words.text('repeatability')} {words.text('interval')}".strip()
    if not found:
        return f"{words.text('headline')} {closing}"
    lines = [f"{words.text('unit')}: {finding}." for finding, _ in found]
    note = " +- is the standard uncertainty." * (" +- " in lines[0])
    return "\n".join([*lines, *(f"NEXT: {step}" for step in steps(words)), closing + note])


def write_history(folder: Path, words: Words, history: UnitHistory) -> None:
    """Write the page of a unit and its control charts."""
    charts, tables = write_each(folder, FIGURES, history), {"results": listed(history.entries)}
    write_page(folder / "history.html", words, charts, tables=tables, verdict=verdict_of_history(words))
