"""A page that opens anywhere: one HTML file with its words, tables and figures inside."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from tumblecal import __version__
from tumblecal.ground.atomic import write_text


# Words before a colon that are no longer than this are what a line of the verdict is about.
_LONGEST_SUBJECT = 40


# The colour of a diagnosis.
TONES = {"adequate": "good", "identified": "named", "ambiguous": "open", "unexplained": "bad"}


@dataclass(frozen=True)
class PageTable:
    """A table: header cells and rows of cells; `text` are the columns of words, which may break into lines."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    text: Sequence[int] = ()


@dataclass(frozen=True)
class PageFigure:
    """A figure: its SVG text and its caption; `on_paper`: whether it is printed, where a table beside it says the same."""

    svg: str
    caption: str
    on_paper: bool = True


@dataclass(frozen=True)
class PageCard:
    """One thing in a frame: its title, and facts as (name, text)."""

    title: str
    facts: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Section:
    """A part of a page: words, then code, then cards, then tables, then figures."""

    title: str
    words: Sequence[str] = ()
    code: Sequence[str] = ()
    cards: Sequence[PageCard] = ()
    tables: Sequence[PageTable] = ()
    figures: Sequence[PageFigure] = field(default_factory=tuple)


def inline_figure(path: Path, caption: str) -> PageFigure:
    """An SVG file ready to stand inside a page: no XML header, identifiers made its own by the file's name."""
    svg = path.read_text(encoding="utf-8")
    svg = svg[svg.index("<svg") :]
    own = re.sub(r"\W", "_", path.stem)
    svg = re.sub(r'\bid="', f'id="{own}-', svg)
    svg = re.sub(r"url\(#", f"url(#{own}-", svg)
    svg = re.sub(r'href="#', f'href="#{own}-', svg)
    svg = re.sub(r'<svg\b([^>]*?) width="([\d.]+pt)"', r'<svg style="--wide: \2"\1 width="\2"', svg, count=1)
    return PageFigure(svg, caption)


def headed(text: str) -> tuple[str, list[str]]:
    """A verdict's first line as a headline (`IDENTIFIED: the head ...` as `Identified: the head ...`), and the other lines."""
    head, *lines = text.replace("+- ", "± ").splitlines()
    word, _, rest = head.partition(": ")
    return f"{word.capitalize()}: {rest}", lines


def write_page(
    path: Path,
    title: str,
    lead: str,
    verdict: Sequence[str],
    sections: Sequence[Section],
    *,
    headline: str = "",
    tone: str = "",
    cards: Sequence[Section] = (),
) -> None:
    """Write a page, whole or not at all.

    **Arguments:**

    - `path`: the HTML file.
    - `title`, `lead`: what it is about, in a line each.
    - `verdict`: what was found, first thing on the page; lines that begin with `- ` are a list.
    - `sections`: the rest.
    - `headline`: the verdict in one line, above it; `tone`: its colour: good, named, open or bad.
    - `cards`: what a reader wants to know first, side by side below the verdict: titles, words, code.
    """
    environment = Environment(loader=PackageLoader("tumblecal.report"), autoescape=True, undefined=StrictUndefined)
    environment.filters["whole"] = _whole
    text = environment.get_template("page.html").render(
        title=title,
        lead=lead,
        headline=headline,
        tone=tone,
        verdict=_paragraphs(verdict, subjects=bool(headline)),
        sections=sections,
        cards=cards,
        footer=f"Written by tumblecal {__version__}.",
    )
    write_text(path, text)


def _whole(text: str) -> Markup:
    """Numbers with an exponent, which browsers would break after its minus sign."""
    return Markup(re.sub(r"[-+]?[\d.]+e-\d+", r'<span class="whole">\g<0></span>', str(escape(text))))


def _paragraphs(lines: Sequence[str], *, subjects: bool) -> list[dict]:
    """Paragraphs and lists; with `subjects` the few words before an item's first colon apart."""
    blocks: list[dict] = []
    for line in lines:
        subject, colon, rest = line.removeprefix("- ").partition(": ")
        short = subjects and bool(colon) and len(subject) < _LONGEST_SUBJECT and not {*".="} & {*subject}
        entry = {"subject": f"{subject}:" if short else "", "text": rest if short else line.removeprefix("- ")}
        if not line.startswith("- "):
            blocks.append({"items": [entry], "list": False})
        elif blocks and blocks[-1]["list"]:
            blocks[-1]["items"].append(entry)
        else:
            blocks.append({"items": [entry], "list": True})
    return blocks
