"""Text and tables for terminals of any width, without broken words or names."""

import textwrap
from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from tumblecal.report.sentences import command_at_end


_GAP = 2


def print_words(console: Console, words: str, style: str = "") -> None:
    """Print a line, folded between words; a longer word is not broken."""
    console.print(Text(folded(words, console.width), style=style), no_wrap=True, overflow="ignore", crop=False)


def folded(words: str, width: int) -> str:
    """Paragraphs in lines of this width, folded between words. A longer word is not broken, nor a command at the end of a
    paragraph, so that it can be pasted."""
    return "\n".join(_paragraph(line, width) for line in words.split("\n"))


def _paragraph(words: str, width: int) -> str:
    def wrapped(text: str) -> list[str]:
        return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)

    if words.startswith("  ") and words.lstrip().startswith("tumblecal "):
        return words  # a command on a line of its own
    text, command = command_at_end(words)
    if not command or len(words) <= width:
        return "\n".join(wrapped(words))
    return "\n".join([*wrapped(text), f"  {command}"])


def print_table(console: Console, header: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int]) -> None:
    """Print a table; if it is too wide, its columns in parts below one another, each with the first column.

    **Arguments:**

    - `left`: left-aligned columns of words; the others contain numbers.
    """
    widths = [
        max(len(line) for cell in column for line in cell.split("\n")) for column in zip(header, *rows, strict=True)
    ]
    for part in _parts(widths, console.width):
        table = Table(box=None, header_style="bold", pad_edge=False)
        for place in part:
            words = place in left
            table.add_column(header[place], justify="left" if words else "right", no_wrap=True, min_width=widths[place])
        for row in rows:
            table.add_row(*(Text(row[place]) for place in part))
        console.print(table, crop=False, overflow="ignore", width=max(console.width, _width([widths[k] for k in part])))


def _parts(widths: Sequence[int], room: int) -> Iterator[list[int]]:
    """Columns that fit in one line, with the first column in each part."""
    part = [0]
    for place in range(1, len(widths)):
        if len(part) > 1 and _width([widths[k] for k in (*part, place)]) > room:
            yield part
            part = [0]
        part.append(place)
    yield part


def _width(widths: Sequence[int]) -> int:
    return sum(widths) + _GAP * (len(widths) - 1)
