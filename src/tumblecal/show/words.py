"""The words of a result, from one template for the terminal, the record and the page: `words/NAME.words`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from tumblecal.show.tables import Table
from tumblecal.show.verdict import Finding, Unresolved, Verdict
from tumblecal.words import blocks_of


_SECTION = "section "


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
    named = list(blocks_of(name, **values))
    sections = [SectionWords(title.removeprefix(_SECTION), of) for title, of in named if title.startswith(_SECTION)]
    return Words({title: of for title, of in named if not title.startswith(_SECTION)}, sections)
