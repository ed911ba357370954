"""Text and tables for terminals of any width, without broken words or names."""

import textwrap

from rich.console import Console
from rich.text import Text

from tumblecal.show.tables import Table
from tumblecal.words import command_at_end


def print_words(console: Console, words: str, style: str = "") -> None:
    """Print a line, folded between words; a longer word is not broken."""
    _print(console, folded(words, console.width), style)


def print_table(console: Console, table: Table) -> None:
    """Print a table; if it is too wide, in parts below one another."""
    _print(console, table.fitted(console.width))


def _print(console: Console, text: str, style: str = "") -> None:
    console.print(Text(text, style=style), no_wrap=True, overflow="ignore", crop=False)


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
