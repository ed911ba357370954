"""`history.html`: control charts, repeatability and drift of a unit on one page."""

from collections.abc import Sequence
from pathlib import Path

from tumblecal.history.repeatability import FEWEST, UnitHistory
from tumblecal.show.history import steps
from tumblecal.show.history_list import listed
from tumblecal.show.page import page, write_page
from tumblecal.show.verdict import Finding, Verdict, as_sentence
from tumblecal.show.words import Words


@page
def write_history_page(path: Path, words: Words, history: UnitHistory, charts: Sequence[str]) -> None:
    """Write the page; `charts`: names of the control charts in its folder."""
    found = [as_sentence(finding) for finding, _ in words.pairs("findings")]
    outcome = "flagged" if found else "stable" if len(history.entries) >= FEWEST else "open"
    verdict = Verdict(
        outcome,
        f"{found[0]}." if found else words.text("headline"),
        found=tuple(map(Finding, found[1:])),
        evidence=(*words.lines("repeatability"), *words.lines("evidence")),
        next=(*steps(words), *words.lines("interval")),
    )
    texts = {"repeats": (0, 6, 7), "trends": (0, 3), "en": (0,)}
    tables = {name: words.table(name, text=text) for name, text in texts.items()} | {"results": listed(history.entries)}
    write_page(
        path,
        words,
        verdict,
        tone={"flagged": "bad", "stable": "good"}.get(outcome, "open"),
        tables={name: table for name, table in tables.items() if table},
        figures={Path(name).stem: path.parent / name for name in charts},
    )
