"""A self-contained page: one HTML file with its text, tables and figures.

It begins with a verdict: badge and headline, use, evidence, a card for each finding and one for the next steps.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial, wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from tumblecal import __version__
from tumblecal.ground.atomic import write_text
from tumblecal.ground.supplement import supplement
from tumblecal.report.drawing import draw_each, svg_text
from tumblecal.show.tables import Table
from tumblecal.show.verdict import COMMAND, Verdict
from tumblecal.show.words import SectionWords, Words


# The colour of a diagnosis.
TONES = {"adequate": "good", "identified": "named", "ambiguous": "open", "unexplained": "bad"}
# Characters of next steps that the first screen has room for; the rest is folded.
_ROOM = 1000
_Content = ParamSpec("_Content")
_Result = TypeVar("_Result")
_PLACE = re.compile(r"\[(table|code|figure|screen) ([^\]]+)\]")
_SHARE = re.compile(r"0?\.\d+|1\.0*|[01]")


@dataclass(frozen=True)
class PageFigure:
    """A figure: its SVG text and its caption; `on_paper`: whether it is printed (not if a table has the same content)."""

    svg: str
    caption: str
    on_paper: bool = True


@dataclass(frozen=True)
class Section:
    """A section of a page: text, then code, then tables, then figures."""

    title: str
    words: Sequence[str] = ()
    code: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[PageFigure] = field(default_factory=tuple)


@dataclass(frozen=True)
class _Steps:
    """Next steps: paragraphs and commands in their order."""

    parts: Sequence[tuple[str, bool]]

    @property
    def blocks(self) -> list[tuple[bool, list[str]]]:
        """Commands that follow each other together."""
        blocks: list[tuple[bool, list[str]]] = []
        for text, command in self.parts:
            if blocks and command and blocks[-1][0]:
                blocks[-1][1].append(text)
            else:
                blocks.append((command, [text]))
        return blocks


def inline_figure(path: Path, caption: str) -> PageFigure:
    """An SVG file for insertion into a page: no XML header, identifiers made unique by the name of the file."""
    return PageFigure(_named(path.read_text(encoding="utf-8"), path.stem), caption)


def inline_drawing(figure: Figure, path: Path) -> str:
    """A figure as SVG text for a page on which no other figure has the name of this `path`."""
    return _named(svg_text(figure), path.stem)


def inline_each(
    path: Path, result: _Result, figures: Iterable[tuple[str, Callable[[_Result], Figure]]], captions: Mapping[str, str]
) -> dict[str, PageFigure]:
    """Figures of a result on a page by name, without those that fail."""
    drawn = draw_each(path, {name: partial(figure_of, result) for name, figure_of in figures}, inline_drawing)
    return {name: PageFigure(svg, captions[name]) for name, svg in drawn.items()}


def chosen(drawn: Mapping[str, PageFigure], *names: str) -> list[PageFigure]:
    """The figures of a section by name, those that were drawn."""
    return [drawn[name] for name in names if name in drawn]


def _named(svg: str, name: str) -> str:
    svg, prefix = svg[svg.index("<svg") :], re.sub(r"\W", "_", name)
    # A sixth less to store: no indents, no names of groups, no more than a hundredth of a point.
    svg = re.sub(r'<g id="[^"]*"', "<g", re.sub(r"\n\s+", "\n", svg))
    svg = re.sub(r'(?<!\(0)(\.\d\d)\d+(?=[ "\n])', r"\1", svg)
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r"url\(#", f"url(#{prefix}-", svg)
    svg = re.sub(r'href="#', f'href="#{prefix}-', svg)
    return re.sub(r'<svg\b([^>]*?) width="([\d.]+pt)"', r'<svg style="--wide: \2"\1 width="\2"', svg, count=1)


def page(write: Callable[Concatenate[Path, _Content], None]) -> Callable[Concatenate[Path, _Content], list[str]]:
    """A function that writes a page of results that are complete without it; it returns the name of the page, [] after an
    error (see `supplement`)."""

    @wraps(write)
    def written(path: Path, *content: _Content.args, **options: _Content.kwargs) -> list[str]:
        with supplement(path):
            write(path, *content, **options)
            return [path.name]
        return []

    return written


def write_sections(
    path: Path,
    title: str,
    lead: str,
    verdict: Verdict,
    sections: Iterable[Section],
    *,
    tone: str = "",
    pictures: Mapping[int, Callable[[], Figure]] | None = None,
    plans: Sequence[Table] = (),
    values: Sequence[str] = (),
) -> None:
    """Write a complete page, or none.

    **Arguments:**

    - `path`: the HTML file.
    - `title`, `lead`: its subject, a line each.
    - `verdict`: the first screen. `tone`: its colour: good, named, open or bad.
    - `sections`: the rest; after an error in one the page ends.
    - `pictures`: functions that draw the cards, by number of the finding from 1 on; 0: of a verdict without a finding.
    - `plans`: tables of the next steps, folded. `values`: results on the first screen, a line each.
    """
    environment = Environment(loader=PackageLoader("tumblecal.show"), autoescape=True, undefined=StrictUndefined)
    environment.filters |= {"typeset": _typeset, "share": _share}
    shown, folded = _next_steps(verdict)
    cards = {f"card {number}": figure_of for number, figure_of in (pictures or {}).items()}
    drawn, made = draw_each(path, cards, inline_drawing), list[Section]()
    with supplement(path):
        made.extend(sections)
    text = environment.get_template("page.html").render(
        title=title,
        lead=lead,
        tone=tone,
        verdict=verdict,
        cards=list(_cards(verdict, drawn)),
        open=[one for one in verdict.unresolved if not one.findings],
        shown=shown,
        folded=folded,
        plans=plans,
        values=values,
        sections=made,
        footer=f"Written by tumblecal {__version__}.",
    )
    write_text(path, text)


def write_page(
    path: Path,
    words: Words,
    verdict: Verdict,
    *,
    tone: str = "",
    tables: Mapping[str, Table] | None = None,
    figures: Mapping[str, Path | Callable[[], Figure]] | None = None,
    code: Mapping[str, Sequence[str]] | None = None,
    plans: Sequence[Table] = (),
) -> None:
    """Write a complete page, or none: its layout is that of the words.

    Blocks of the words: `title` and `lead`; `values`, results on the first screen; the fourth cell of an entry of `found` and
    the block `picture` (of a verdict without a finding) are the names of the figures on cards; sections follow in their order,
    with `[table NAME]`, `[code NAME]` and `[figure NAME] | caption` as entries (`[screen NAME]`: a figure that is not printed).
    A section without any content is omitted, as is a table or figure that does not exist.

    **Arguments:**

    - `path`: the HTML file. `tone`: colour of the verdict: good, named, open or bad.
    - `tables`, `figures`, `code`: by name; a figure is a function that draws it, or its SVG file. `plans`: tables of the next
      steps, folded.
    """
    tables, code, figures = tables or {}, code or {}, figures or {}
    numbered = {number: cells[3] for number, cells in enumerate(words.blocks.get("found", ()), 1) if len(cells) > 3}
    named = {0: words.text("picture")} | numbered
    functions = {name: figure for name, figure in figures.items() if not isinstance(figure, Path)}
    pictures = {number: functions[name] for number, name in named.items() if name in functions}
    wanted = {
        match[2] for section in words.sections for cells in section.entries if (match := _PLACE.fullmatch(cells[0]))
    }
    drawn = {name: inline_figure(figure, "").svg for name, figure in figures.items() if isinstance(figure, Path)}
    drawn |= draw_each(path, {name: figure for name, figure in functions.items() if name in wanted}, inline_drawing)
    write_sections(
        path,
        words.text("title"),
        words.text("lead"),
        verdict,
        [made for one in words.sections if (made := _section(one, tables, drawn, code)) is not None],
        tone=tone,
        pictures=pictures,
        plans=plans,
        values=words.lines("values"),
    )


def _section(
    words: SectionWords, tables: Mapping[str, Table], drawn: Mapping[str, str], code: Mapping[str, Sequence[str]]
) -> Section | None:
    """A section with the content of its places; None without any content."""
    texts, lines = list[str](), list[str]()
    held, figures = list[Table](), list[PageFigure]()
    for first, *caption in words.entries:
        place = _PLACE.fullmatch(first)
        if place is None:
            texts.append(first)
        elif place[1] == "table":
            held += [tables[place[2]]] if place[2] in tables else []
        elif place[1] == "code":
            lines += code.get(place[2], ())
        elif place[2] in drawn:
            figures.append(PageFigure(drawn[place[2]], *caption, on_paper=place[1] == "figure"))
    return Section(words.title, texts, lines, held, figures) if texts or lines or held or figures else None


def _cards(verdict: Verdict, drawn: Mapping[str, str]) -> Iterator[dict]:
    """A card for each finding: words, picture, open questions, and instructions for the bench."""
    if not verdict.found and "card 0" in drawn:
        yield {"number": "", "finding": None, "picture": drawn["card 0"], "open": [], "bench": []}
    for number, finding in enumerate(verdict.found, 1):
        questions = [one for one in verdict.unresolved if one.findings[:1] == (number,)]
        yield {
            "number": number,
            "finding": finding,
            "picture": drawn.get(f"card {number}", ""),
            "open": questions,
            "bench": [text for id, text in verdict.advice if id == finding.id],
        }


def _next_steps(verdict: Verdict) -> tuple[_Steps, _Steps]:
    """The next steps on the first screen, and those that are folded."""
    parts = [(text, text.startswith(COMMAND)) for text in verdict.steps]
    lengths = [sum(len(text) for text, _ in parts[: k + 1]) for k in range(len(parts))]
    count = max(1, sum(length <= _ROOM for length in lengths))
    while count < len(parts) and parts[count][1]:
        count += 1  # commands stay with their instruction
    return _Steps(parts[:count]), _Steps(parts[count:])


def _typeset(text: str) -> Markup:
    """Signs as they are printed; numbers with an exponent whole, which browsers would break after the minus sign."""
    signs = {"+-": "±", " -> ": " → ", "^2": "²", "^3": "³", " degC": " °C"}
    for written, printed in signs.items():
        text = text.replace(written, printed)
    return Markup(re.sub(r"[-+]?[\d.]+e-\d+", r'<span class="whole">\g<0></span>', str(escape(text))))


def _share(cell: str) -> str:
    """A number from 0 to 1 as a percentage for a bar."""
    return f"{100 * float(cell):.1f}%" if _SHARE.fullmatch(cell) else "0%"
