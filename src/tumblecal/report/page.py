"""A page that opens anywhere: one HTML file with its words, tables and figures inside."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from tumblecal import __version__
from tumblecal.data.atomic import write_text


@dataclass(frozen=True)
class PageTable:
    """A table: header cells and rows of cells."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class PageFigure:
    """A figure: its SVG text and its caption."""

    svg: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A part of a page: words, then tables, then figures."""

    title: str
    words: Sequence[str] = ()
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
    return PageFigure(svg, caption)


def write_page(path: Path, title: str, lead: str, verdict: Sequence[str], sections: Sequence[Section]) -> None:
    """Write a page, whole or not at all.

    **Arguments:**

    - `path`: the HTML file.
    - `title`, `lead`: what it is about, in a line each.
    - `verdict`: what was found, first thing on the page.
    - `sections`: the rest.
    """
    environment = Environment(loader=PackageLoader("tumblecal.report"), autoescape=True, undefined=StrictUndefined)
    text = environment.get_template("page.html").render(
        title=title, lead=lead, verdict=verdict, sections=sections, footer=f"Written by tumblecal {__version__}."
    )
    write_text(path, text)
