"""The command line of a benchmark: its options, and its tables in Markdown."""

import argparse
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any


def asked(text: str | None, words: Sequence[str] | None = None, **options: Any) -> argparse.Namespace:
    """The options on the command line, or in `words`, by their defaults.

    False is a flag, `Path` a file that need not be given, `[int]` any number of values. A tuple is an argument without a name:
    one of its words, or, if it has none, a file.
    """
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in options.items():
        option = f"--{name.replace('_', '-')}"
        if isinstance(default, tuple):
            parser.add_argument(name, choices=default or None, type=str if default else Path)
        elif isinstance(default, list):
            parser.add_argument(option, nargs="+", action="extend", type=default[0], default=[])
        elif isinstance(default, bool):
            parser.add_argument(option, action="store_true")
        elif default is Path:
            parser.add_argument(option, type=Path)
        else:
            parser.add_argument(option, type=type(default), default=default)
    return parser.parse_args(words)


def counted(words: Iterable[str]) -> str:
    """How often each word occurs."""
    return ", ".join(f"{count} {word}" for word, count in sorted(Counter(words).items()))


def print_row(*cells: object) -> None:
    """Print a row of a table."""
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def print_head(*names: str) -> None:
    """Print the head of a table."""
    print_row(*names)
    print("|---" * len(names) + "|", flush=True)
