"""A self-contained page: one HTML file with its text, tables and figures.

It begins with a verdict: badge and headline, use, evidence, a card for each finding and one for the next steps.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from tumblecal import __version__
from tumblecal.ground.atomic import write_text
from tumblecal.ground.result_set import supplement
from tumblecal.show.figures.drawing import draw_each
from tumblecal.show.tables import Table
from tumblecal.show.verdict import COMMAND, Verdict
from tumblecal.show.words import SectionWords, Words


# The colour of a verdict; that of any other badge is neutral.
_TONES = {
    **dict.fromkeys(("adequate", "agrees", "stable", "usable"), "good"),
    **dict.fromkeys(("identified",), "named"),
    **dict.fromkeys(("ambiguous", "repeat", "open", "usable in part", "not tested"), "open"),
    **dict.fromkeys(("unexplained", "changed", "flagged", "do not use"), "bad"),
}
# Characters of next steps that the first screen has room for; the rest is folded.
_ROOM = 1000
_PLACE = re.compile(r"\[(table|list|code|figure|screen) ([^\]]+)\]")
_SHARE = re.compile(r"0?\.\d+|1\.0*|[01]")


PageFigures = Mapping[str, str | Callable[..., Figure | None]]


@dataclass(frozen=True)
class PageFigure:
    """A figure: its SVG text and its caption; `on_paper`: whether it is printed (not if a table has the same content)."""

    svg: str
    caption: str = ""
    on_paper: bool = True


@dataclass(frozen=True)
class Section:
    """A section of a page: text, then code, then tables, then figures."""

    title: str
    words: list[str] = field(default_factory=list)
    code: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    figures: list[PageFigure] = field(default_factory=list)


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


def _named(svg: str, prefix: str) -> str:
    """An SVG text for a page on which no other figure has this prefix of its identifiers."""
    svg = svg[svg.index("<svg") :].replace("xlink:href", "href")
    # A sixth less to store: no indents, no names of groups, no more than a hundredth of a point.
    svg = re.sub(r'<g id="[^"]*"', "<g", re.sub(r"\n\s+", "\n", svg))
    svg = re.sub(r'(?<!\(0)(\.\d\d)\d+(?=[ "\n])', r"\1", svg)
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r"url\(#", f"url(#{prefix}-", svg)
    svg = re.sub(r'href="#', f'href="#{prefix}-', svg)
    return re.sub(r'<svg\b([^>]*?) width="([\d.]+pt)"', r'<svg style="--wide: \2"\1 width="\2"', svg, count=1)


def write_page(
    path: Path,
    words: Words,
    figures: PageFigures | None = None,
    *result: object,
    tables: Mapping[str, Table] | None = None,
    verdict: Verdict | None = None,
) -> list[str]:
    """Write a complete page, or none: its layout is that of the words. The results are complete without it (see `supplement`).

    Blocks of the words: `title` and `lead`; those of the verdict; `tone`, its colour (good, named, open or bad), if it does not
    follow from the badge; `values`, results on the first screen; the fourth cell of an entry of `found` and the block `picture`
    (of a verdict without a finding) are the names of the figures on cards; blocks `next ...` are tables of the next steps,
    folded. Sections follow in their order, with `[table NAME]` (`| folded`), `[list NAME]` (a table without header), `[code
    NAME]` and `[figure NAME] | caption` as entries (`[screen NAME]`: a figure that is not printed). A section without any
    content is omitted, as is a table or figure that does not exist.

    **Arguments:**

    - `path`: the HTML file. `figures`: by name, SVG texts, or functions of the `result` that draw them.
    - `tables`: those that are no blocks. `verdict`: to show instead of that of the words.

    **Returns:** the name of the page; [] after an error.
    """
    with supplement(path):
        write_text(path, _page_text(path, words, figures or {}, result, tables or {}, verdict or words.verdict))
        return [path.name]
    return []


def _page_text(
    path: Path,
    words: Words,
    figures: PageFigures,
    result: tuple[object, ...],
    tables: Mapping[str, Table],
    verdict: Verdict,
) -> str:
    figures = {Path(name).stem: figure for name, figure in figures.items()}
    numbered = {number: cells[3] for number, cells in enumerate(words.blocks.get("found", ()), 1) if len(cells) > 3}
    pictures = {f"card {number}": name for number, name in ({0: words.text("picture")} | numbered).items()}
    places = (_PLACE.fullmatch(cells[0]) for section in words.sections for cells in section.entries)
    wanted = pictures | {place[2]: place[2] for place in places if place}
    given = {key: figures[name] for key, name in wanted.items() if name in figures}
    drawn = draw_each(path, {key: figure for key, figure in given.items() if not isinstance(figure, str)}, *result)
    drawn |= {key: svg for key, svg in given.items() if isinstance(svg, str)}
    drawn = {key: _named(svg, f"f{number}") for number, (key, svg) in enumerate(drawn.items())}
    shown, folded = _next_steps(verdict)
    environment = Environment(loader=PackageLoader("tumblecal.show"), autoescape=True, undefined=StrictUndefined)
    environment.filters |= {"typeset": _typeset, "share": _share}
    return environment.get_template("page.html").render(
        title=words.text("title"),
        lead=words.text("lead"),
        tone=words.text("tone") or _TONES.get(verdict.verdict, "named"),
        verdict=verdict,
        cards=list(_cards(verdict, drawn)),
        open=[one for one in verdict.unresolved if not one.findings],
        shown=shown,
        folded=folded,
        plans=[table for name in words.blocks if name.startswith("next ") and (table := words.table(name))],
        values=words.lines("values"),
        sections=[made for one in words.sections if (made := _section(one, words, tables, drawn))],
        footer=f"Written by tumblecal {__version__}.",
    )


def _section(
    section: SectionWords, words: Words, tables: Mapping[str, Table], drawn: Mapping[str, str]
) -> Section | None:
    """A section with the content of its places; None without any content."""
    made = Section(section.title)
    for first, *more in section.entries:
        place = _PLACE.fullmatch(first)
        kind, name = (place[1], place[2]) if place else ("", "")
        if place is None:
            made.words.append(first)
        elif kind == "table" and (table := tables.get(name) or words.table(name)):
            made.tables.append(replace(table, folded=True) if more else table)
        elif kind == "list" and (rows := words.blocks.get(name)):
            made.tables.append(Table([""] * len(rows[0]), rows))
        elif kind == "code":
            made.code.extend(words.lines(name))
        elif name in drawn:
            made.figures.append(PageFigure(drawn[name], *more, on_paper=kind == "figure"))
    return made if made.words or made.code or made.tables or made.figures else None


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
