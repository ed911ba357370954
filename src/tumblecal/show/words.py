"""The words of a result, from one template for the terminal, the record and the page: `words/NAME.words`.

A template has blocks, each below its name: `## found`. An entry of a block is a line; indented lines continue it. ` | `
separates the cells of an entry. Values are in braces, `{size|digits(3)}`; a line that begins with `%` controls: `% if`,
`% for`, `% endif`.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from tumblecal.ground.numbers_shown import (
    capped,
    changed,
    counted,
    decimals,
    p_cell,
    p_words,
    rounded,
    rounded_together,
    shortened,
    with_decimals,
)
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.units import in_words, shown
from tumblecal.show.tables import Table, number
from tumblecal.show.verdict import Finding, Unresolved, Verdict, as_sentence, ended


# Values may contain the marks of the format.
_HIDDEN = {"|": "\x1d", "\n": "\x1e", "#": "\x1f"}
_HIDE, _SHOW = str.maketrans(_HIDDEN), str.maketrans({hidden: mark for mark, hidden in _HIDDEN.items()})
_BLOCK, _SECTION, _CELL = "## ", "section ", re.compile(r" \|(?= |$)")


@dataclass(frozen=True)
class SectionWords:
    """A section of a page: its title and its entries, paragraphs and places of tables, figures and code."""

    title: str
    entries: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Words:
    """The words of a result.

    - `blocks`: the entries of each block, as cells. `sections`: those of the page, in order.
    """

    blocks: Mapping[str, Sequence[Sequence[str]]]
    sections: Sequence[SectionWords]

    def lines(self, block: str) -> list[str]:
        """The first cell of each entry of a block; none without the block."""
        return [cells[0] for cells in self.blocks.get(block, ())]

    def text(self, block: str) -> str:
        """A block as one line."""
        return " ".join(self.lines(block))

    def section(self, title: str) -> list[str]:
        """The paragraphs of a section."""
        return [cells[0] for section in self.sections if section.title == title for cells in section.entries]

    def pairs(self, block: str) -> list[tuple[str, str]]:
        """The first two cells of each entry of a block."""
        return [(cells[0], cells[1] if len(cells) > 1 else "") for cells in self.blocks.get(block, ())]

    def table(self, block: str) -> Table | None:
        """A block as a table, its first entry as the header; None without rows."""
        header, *rows = self.blocks.get(block) or [()]
        return Table(header, rows) if rows else None

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict by the blocks badge, headline, source, use, found, unresolved, evidence, next and details.

        Cells of `found`: words, size, id. Cells of `unresolved`: words, reason, numbers of the findings.
        """
        questions = ([*cells, "", ""][:3] for cells in self.blocks.get("unresolved", ()))
        return Verdict(
            self.text("badge"),
            self.text("headline"),
            self.text("source"),
            self.text("use"),
            tuple(Finding(*cells[:3]) for cells in self.blocks.get("found", ())),
            tuple(Unresolved(words, reason, tuple(map(int, about.split()))) for words, reason, about in questions),
            tuple(self.lines("evidence")),
            tuple(self.lines("next")),
            tuple(self.pairs("details")),
        )


def words_of(name: str, **values: object) -> Words:
    """The words of a result.

    **Arguments:**

    - `name`: of the template. `values`: the values and functions that it uses.

    **Raises:** `UndefinedError` for a value that is missing.

    **Example:** `words_of("check", r=result).lines("evidence")`
    """
    named = list(_blocks(_environment().get_template(f"{name}.words").render(values)))
    sections = [SectionWords(title.removeprefix(_SECTION), of) for title, of in named if title.startswith(_SECTION)]
    return Words({title: of for title, of in named if not title.startswith(_SECTION)}, sections)


def text_of(template: str, **values: object) -> str:
    """A text with its lines as they are in a template: `words/TEMPLATE`; `values` as for `words_of`."""
    return f"{_environment().get_template(template).render(values).translate(_SHOW)}\n"


def _blocks(text: str) -> Iterator[tuple[str, list[list[str]]]]:
    """The name and the entries of each block."""
    for block in f"\n{text}".split(f"\n{_BLOCK}")[1:]:
        name, *lines = block.split("\n")
        entries = list[str]()
        for line in lines:
            if line[:1] == " " and entries:
                entries[-1] = f"{entries[-1].rstrip()} {line.strip()}"
            elif line.strip():
                entries.append(line)
        yield (
            name.strip().translate(_SHOW),
            [[cell.strip().translate(_SHOW) for cell in _CELL.split(entry)] for entry in entries],
        )


def _hidden(value: object) -> object:
    """A value without the marks of the format; an undefined one is unchanged, so that it is an error."""
    return value.translate(_HIDE) if isinstance(value, str) else value


def _digits(value: float, count: int = 3, sign: str = "") -> str:
    return f"{value:{sign}.{count}g}"


def _places(value: float, count: int, sign: str = "") -> str:
    return f"{value:{sign}.{count}f}"


def _listed(words: Sequence[str], last: str = " and ") -> str:
    """`a`, `a and b`, `a, b and c`."""
    *first, end = words or [""]
    return f"{', '.join(first)}{last}{end}" if first else end


def _command(command: str, *words: object) -> str:
    """A command to paste; a word may be a sequence of words."""
    flat = (one for word in words for one in (word if isinstance(word, list | tuple) else [word]))
    return suggested(command, *flat)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("tumblecal.show", "words"),
        undefined=StrictUndefined,
        finalize=_hidden,
        variable_start_string="{",
        variable_end_string="}",
        line_statement_prefix="%",
        line_comment_prefix="%#",
        autoescape=False,
    )
    filters: dict[str, Callable[..., Any]] = {
        "p": p_words,
        "p_cell": p_cell,
        "digits": _digits,
        "places": _places,
        "with_decimals": with_decimals,
        "capped": capped,
        "counted": counted,
        "shortened": shortened,
        "listed": _listed,
        "sentence": as_sentence,
        "ended": ended,
    }
    environment.filters |= filters
    environment.globals |= {"plus_minus": rounded_together, "changed": changed, "command": _command}
    environment.globals |= {
        "shown": shown,
        "in_words": in_words,
        "rounded": rounded,
        "decimals": decimals,
        "number": number,
    }
    return environment
