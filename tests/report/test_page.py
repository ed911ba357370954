"""The page of the paper's study, opened in a real browser."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from reading_html import Cells

from tumblecal.show.page import write_page
from tumblecal.show.tables import Table
from tumblecal.show.verdict import Verdict
from tumblecal.show.words import SectionWords, Words


NOTHING = Verdict("", "", "", "")


def layout(title: str, lead: str = "", *sections: tuple[str, list[list[str]]], found: list[list[str]] = ()) -> Words:
    """Words of a page: title, lead, sections with their entries, and the cells of its findings."""
    blocks = {"title": [[title]], "lead": [[lead]], "found": found}
    return Words(blocks, [SectionWords(*section) for section in sections])


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("reproduce")


@pytest.fixture
def reproduced(folder, tumblecal) -> Path:
    """What the command writes; made once."""
    if not (folder / "study").exists():
        outcome = tumblecal("reproduce", "--out", folder / "study")
        assert outcome.code == 0 and "Findings" in outcome.out
    return folder / "study"


@pytest.fixture
def page(reproduced) -> Path:
    return reproduced / "page.html"


@pytest.mark.long
def test_reproduce_writes_everything(reproduced, page):
    names = sorted(path.name for path in reproduced.iterdir())
    assert {"page.html", "study.json", "findings.txt"} <= set(names)
    assert len([name for name in names if name.endswith(".svg")]) == 7
    diagnosis = json.loads((reproduced / "diagnosis" / "diagnosis.json").read_text())
    assert diagnosis["verdict"] == "adequate"
    assert "gravity_value" in diagnosis["invisible"] and "gravity_value" in page.read_text()
    content = json.loads((reproduced / "study.json").read_text())
    assert content["schema"] == "tumblecal.reproduction/1"
    assert content["audit"]["explanations"][0]["p_value"] == pytest.approx(0.34, abs=5e-3)


def test_browser_shows_the_numbers_the_figures_and_no_errors(page, chromium):
    document, cells = chromium.whole(page, 7), Cells()
    cells.feed(document)
    assert ["dK_x", "1e-3", "0.35", "0.22"] in [row[:4] for row in cells.rows]
    assert any(
        row[0].startswith("input of the paper") and row[1] == "1.14" and row[2].startswith("0.34")
        for row in cells.rows
        if row
    )
    assert document.count("<h2>") >= 3


def test_markup_in_the_data_is_text_on_the_page(tmp_path):
    cells = Table(["<i>"], [["&"], ["dK_x by <u>+0.342e-3</u> (+1.5 sd), bias_x by 0.1 mg"]])
    script = replace(NOTHING, evidence=("<script>alert(1)</script>",))
    words = layout("<b>title</b>", "a < b", ("x", [["[table cells]"]]))
    write_page(tmp_path / "p.html", words, tables={"cells": cells}, verdict=script)
    text = (tmp_path / "p.html").read_text()
    assert "<script>" not in text and "<i>" not in text and "<b>" not in text and "<u>" not in text
    assert "&lt;script&gt;" in text and "a &lt; b" in text
    assert '<span class="whole">+0.342e-3</span>' in text  # browsers would break it after its minus sign


def test_on_paper_two_figures_of_residuals_fill_a_page(chromium, tmp_path):
    """With heading and captions, whatever their own widths, and a heading is not left alone at the foot of a page."""
    drawn = '<?xml version="1.0"?><svg width="504pt" height="374pt" viewBox="0 0 504 374"><path d="M0 0h9"/></svg>'
    words = layout("Title", "", ("Residuals", [["[figure drawn]", "A caption of three lines. " * 12]] * 2))
    write_page(tmp_path / "p.html", words, {"drawn": drawn})
    assert chromium.printed(tmp_path / "p.html") == 1


def test_on_paper_tables_go_over_the_foot_of_a_page(chromium, tmp_path):
    """Five that are a little more than half a page each fill three pages; kept whole, each would leave half a page blank."""
    table = Table(["", "value", ""], [[f"row {k}", "1", "two words " * 10] for k in range(11)])
    words = layout("Title", "", *((f"Part {k}", [["[table rows]"]]) for k in range(5)))
    write_page(tmp_path / "p.html", words, tables={"rows": table})
    assert chromium.printed(tmp_path / "p.html") == 3
