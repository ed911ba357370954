"""A verdict as a record, and its one layout: five labelled blocks that fit on a screen, a rule, and the details below it."""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass


WIDTH = 100
COMMAND = "tumblecal "
_INDENT = 12
# Lines above the rule at `WIDTH` columns: of all blocks, and of each. NEXT has the remaining lines (at least 6).
_MOST = 25
_MOST_LINES = {"USE": 2, "FOUND": 5, "UNRESOLVED": 5, "EVIDENCE": 4}
_MORE = "(continued below the rule)"
_DETAIL = 30
# Details that tables of a page repeat.
UNDETECTABLE, NOT_TESTABLE = "Undetectable with these data", "Not testable"


@dataclass(frozen=True)
class Finding:
    """One error that was found: in words, its size as value +- standard uncertainty, and its id."""

    words: str
    size: str = ""
    id: str = ""

    @property
    def sentence(self) -> str:
        """All of it in one line."""
        return f"{self.words}{f': {self.size}' if self.size else ''}{f' ({self.id})' if self.id else ''}"


@dataclass(frozen=True)
class Unresolved:
    """One open question, why it is open, and the numbers of the findings (from 1) that it is about."""

    words: str
    reason: str = ""
    findings: tuple[int, ...] = ()

    @property
    def sentence(self) -> str:
        """All of it in one line."""
        numbers = "".join(f"{number}. " for number in self.findings)
        return f"{numbers}{self.words}{f': {self.reason}' if self.reason else ''}"


@dataclass(frozen=True)
class Verdict:
    """The statements of a diagnosis or another analysis.

    - `verdict`: adequate, identified, ambiguous or unexplained; `headline`: its consequence. `source`: name of the data.
    - `use`: whether calibration.json may be used; "" without such a file.
    - `found`, `unresolved`, `evidence`: the errors, the open questions, and the tests and gains.
    - `next`: instructions, and commands (`tumblecal ...`) to be pasted.
    - `details`: heading and text of everything that asks for no action.
    """

    verdict: str
    headline: str
    source: str = ""
    use: str = ""
    found: tuple[Finding, ...] = ()
    unresolved: tuple[Unresolved, ...] = ()
    evidence: tuple[str, ...] = ()
    next: tuple[str, ...] = ()
    details: tuple[tuple[str, str], ...] = ()

    @property
    def advice(self) -> list[tuple[str, str]]:
        """The entries of `next` that are about one finding: its id and the words after it."""
        parts = [text.partition(": ") for text in self.next]
        ids = {one.id for one in self.found if one.id}
        return [(id, words) for id, _, words in parts if id in ids]

    @property
    def steps(self) -> list[str]:
        """All other entries of `next`."""
        ids = {one.id for one in self.found if one.id}
        return [text for text in self.next if text.partition(": ")[0] not in ids]

    def words(self, *, lists: bool = True) -> str:
        """The verdict without layout, a paragraph a line; `lists`: whether with the effects that the data cannot show."""
        return "\n".join(self._paragraphs(lists=lists))

    def _paragraphs(self, *, lists: bool) -> Iterator[str]:
        yield f"{self.verdict.upper()}: {self.headline}"
        yield f"Use of calibration.json: {self.use}."
        yield from (f"Found: {number}. {one.sentence}" for number, one in enumerate(self.found, 1))
        yield from (f"Unresolved: {one.sentence}" for one in self.unresolved)
        yield from (*self.evidence, *self.next)
        yield from (
            f"{name}: {text}" for name, text in self.details if lists or name not in (UNDETECTABLE, NOT_TESTABLE)
        )


def verdict_lines(verdict: Verdict, width: int = WIDTH) -> list[str]:
    """The verdict in lines of at most `width` columns; only commands and longer words are longer.

    Above the rule there are at most 25 lines at 100 columns, with a headline of one or two. Entries beyond that are moved
    below the rule, whole, the same ones at every width.
    """
    blocks: dict[str, Sequence[str]] = {
        "FOUND": [f"{number}. {one.sentence}" for number, one in enumerate(verdict.found, 1)],
        "UNRESOLVED": [one.sentence for one in verdict.unresolved],
        "EVIDENCE": verdict.evidence,
        "NEXT": verdict.next,
    }
    lines = _block(verdict.verdict.upper(), [verdict.headline], width)
    if len(lines[-1]) + len(verdict.source) + 2 <= width:
        lines[-1] += verdict.source.rjust(width - len(lines[-1]))
    use, below = f"calibration.json: {verdict.use}.", list[tuple[str, str]]()
    if _count([use]) > _MOST_LINES["USE"]:
        below.append(("USE, reasons", f"{verdict.use.partition(': ')[2]}."))
        use = f"calibration.json: {verdict.use.partition(': ')[0]} (reasons below the rule)."
    lines += [*_block("USE", [use] if verdict.use else [], width), ""]
    open_lines = _MOST - _count([verdict.headline]) - _count([use]) - 1
    for label, entries in blocks.items():
        shown, moved = _fitting(entries, _MOST_LINES.get(label, open_lines))
        open_lines -= _count(shown)
        lines += _block(label, shown, width)
        below += [(f"{label}, continued", entry) for entry in moved]
    below += verdict.details
    before = ["", *(name for name, _ in below)]
    named = [("" if name == last else name, text) for last, (name, text) in zip(before, below, strict=False)]
    details = [line for name, text in named for line in _detail(name, text, width)]
    return [*lines, "-" * width, *details] if details else lines


def _fitting(entries: Sequence[str], most: int) -> tuple[list[str], list[str]]:
    """The entries that fit in so many lines at `WIDTH` columns, and those that do not."""
    lengths = [_count([entry]) for entry in entries]
    if sum(lengths) <= most:
        return list(entries), []
    count = next(count for count in range(len(entries), -1, -1) if sum(lengths[:count]) < most)
    return [*entries[:count], _MORE], list(entries[count:])


def _count(entries: Sequence[str]) -> int:
    """Lines at `WIDTH` columns."""
    return sum(len(_folded(entry, WIDTH - _INDENT)) for entry in entries)


def _block(label: str, entries: Sequence[str], width: int) -> list[str]:
    """A label and its entries with a hanging indent."""
    lines = [line for entry in entries for line in _folded(entry, max(width - _INDENT, 20))]
    return [(label if k == 0 else "").ljust(_INDENT) + line for k, line in enumerate(lines)]


def _detail(name: str, text: str, width: int) -> list[str]:
    if width >= WIDTH:
        lines = _folded(text, width - _DETAIL)
        return [(name if k == 0 else "").ljust(_DETAIL) + line for k, line in enumerate(lines)]
    return _folded(f"{name}: {text}" if name else text, width)


def _folded(text: str, width: int) -> list[str]:
    """Lines of one entry; a command stays whole."""
    if text.startswith(COMMAND):
        return [f"  {text}"]
    hanging = "   " if text[:1].isdigit() and text[1:3] == ". " else ""
    options = {"break_long_words": False, "break_on_hyphens": False, "subsequent_indent": hanging}
    return textwrap.wrap(text, width, **options) or [""]
