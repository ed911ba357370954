"""The texts that a person reads are in the files of this folder: `NAME.words` for a result, `sentences/NAME.words` for
sentences that several results share. Python gives the values.

A template has blocks, each below its name: `## found`. An entry of a block is a line; indented lines continue it. ` | `
separates the cells of an entry. Values are in braces, `{size|digits(3)}`; a line that begins with `%` controls: `% if`,
`% for`, `% endif`.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from tumblecal.ground.numbers_shown import (
    capped,
    changed,
    counted,
    decimals,
    number,
    p_cell,
    p_words,
    rounded,
    rounded_together,
    shortened,
    with_decimals,
)
from tumblecal.ground.suggested_command import suggested
from tumblecal.ground.units import in_words, shown


if TYPE_CHECKING:
    from jinja2 import Environment, Template

Blocks = Iterator[tuple[str, list[list[str]]]]

# A command to be pasted ends a text: it is not folded, and no full stop follows it.
_COMMAND = re.compile(r"(.*: )(tumblecal \S.*)", re.DOTALL)
# Values may contain the marks of the format.
_HIDDEN = {"|": "\x1d", "\n": "\x1e", "#": "\x1f"}
_HIDE, _SHOW = str.maketrans(_HIDDEN), str.maketrans({hidden: mark for mark, hidden in _HIDDEN.items()})
_BLOCK, _CELL = "## ", re.compile(r" \|(?= |$)")


def blocks_of(name: str, /, **values: object) -> Blocks:
    """The name and the entries, as cells, of each block of `NAME.words`.

    **Raises:** `UndefinedError` for a value that is missing.
    """
    return _blocks(_environment().get_template(f"{name}.words").render(values))


def text_of(template: str, /, **values: object) -> str:
    """A text with its lines as they are in a template: `words/TEMPLATE`; `values` as for `blocks_of`."""
    return f"{_environment().get_template(template).render(values).translate(_SHOW)}\n"


def cells(name: str, /, **values: object) -> list[list[str]]:
    """The entries of one block of a file of shared sentences, as cells.

    **Arguments:**

    - `name`: of file and block, `noise/floor` for the block `## floor` of `sentences/noise.words`. `values`: those that the
      block uses.

    **Raises:** `UndefinedError` for a value that is missing; `KeyError` without such a block.

    **Example:** `cells("use/floor", floor=scatter, run="")`
    """
    file, _, block = name.partition("/")
    ((_, entries),) = _blocks(f"{_BLOCK}{block}\n{_templates(file)[block].render(values)}")
    return entries


def sentences(name: str, /, **values: object) -> list[str]:
    """The first cell of each entry of a block, as of `cells`."""
    return [entry[0] for entry in cells(name, **values)]


def sentence(name: str, /, **values: object) -> str:
    """The entries of a block, as of `sentences`, in one line."""
    return " ".join(sentences(name, **values))


@cache
def _templates(file: str) -> dict[str, "Template"]:
    """The blocks of a file of shared sentences; what precedes the first are macros of all."""
    environment = _environment()
    source, *_ = environment.loader.get_source(environment, f"sentences/{file}.words")  # pyright: ignore[reportOptionalMemberAccess]
    macros, *blocks = f"\n{source}".split(f"\n{_BLOCK}")
    named = (block.partition("\n") for block in blocks)
    return {name: environment.from_string(f"{macros}\n{text}") for name, _, text in named}


def command_at_end(words: str) -> tuple[str, str]:
    """Words without the command that ends them, and the command; "" where none does."""
    match = _COMMAND.fullmatch(words)
    return (match[1].rstrip(), match[2]) if match else (words, "")


def ended(words: str) -> str:
    """Words with a full stop, unless a command ends them."""
    return words if command_at_end(words)[1] else f"{words}."


def as_sentence(words: str) -> str:
    """Words with a capital letter first, unless they begin with a name of a parameter or effect."""
    return words if "_" in words.partition(" ")[0] else words[:1].upper() + words[1:]


def _blocks(text: str) -> Blocks:
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
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("tumblecal", "words"),
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
