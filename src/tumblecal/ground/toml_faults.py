"""Faults of TOML and JSON files in words: fault, line, key and remedy."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date, time
from difflib import get_close_matches
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


# Tags of the forms of a value; pydantic inserts them into a path, but they are not in the file.
FORMS = ("list", "steps", "number")
_Keys = tuple[int | str, ...]

_TABLE, _OBJECT, _NUMBER, _WHOLE, _DATE = (
    "must be a table, such as {{ key = value }}",
    'must be an object, such as {"key": 1}',
    "must be a number",
    "must be a whole number",
    "must be a day such as 2026-11-22, without quotation marks and time",
)
# Words for error types of pydantic, by the first letters of the type; values in braces are from its context.
_WORDS = {
    "missing": "is missing; add it",
    "float": _NUMBER,
    "finite_number": "must be a finite number",
    "int": _WHOLE,
    "string_type": "must be a text in quotation marks",
    "string_too_short": "must not be empty",
    "bool": "must be true or false, without quotation marks",
    "list": "must be a list, such as [1, 2]",
    "tuple": "must be a list, such as [1, 2]",
    "dict": _TABLE,
    "model": _TABLE,
    "dataclass": _TABLE,
    "date": _DATE,
    "greater_than_equal": "must be {ge:g} or more",
    "greater_than": "must be above {gt:g}",
    "less_than_equal": "must be {le:g} or less",
    "less_than": "must be below {lt:g}",
    "literal_error": "must be {expected}",
    "too_short": "must have {min_length} or more entries, not {actual_length}",
    "too_long": "must have at most {max_length} entries, not {actual_length}",
}
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_COUNTED = ("too_short", "too_long", "missing")
_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_DOTTED = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*(\[\[?)\s*({_DOTTED})\s*\]")
_KEY = re.compile(rf"\s*({_DOTTED})\s*=")


def validation_faults(path: Path, error: ValidationError, table: type[BaseModel]) -> list[str]:
    """One line for each pydantic fault of a TOML file: line, dotted path, fault and remedy."""
    return located(
        path, list(dict.fromkeys(f"{path}: {keys or 'file'}: {text}" for keys, text in _faults(error, table)))
    )


def json_faults(named: str, error: ValidationError, within: str = "") -> list[str]:
    """One line for each pydantic fault of a part of a JSON file: `named`, dotted path, fault and remedy; one for an array.

    **Arguments:**

    - `within`: dotted path of the part.
    """
    of_arrays = dict[str, str]()
    for keys, text in _faults(error, BaseModel):
        at = ".".join(filter(None, [within, keys]))
        of_arrays.setdefault(re.sub(r"(\.\d+)+$", "", at), f"{named}: {f'{at}: ' if at else ''}{text}")
    return [fault.replace(_TABLE.format(), _OBJECT) for fault in of_arrays.values()]


def _faults(error: ValidationError, table: type[BaseModel]) -> Iterator[tuple[str, str]]:
    """Dotted path and words of each fault."""
    listed = error.errors(include_url=False)
    unknown = [fault["loc"] for fault in listed if fault["type"] in _UNKNOWN]
    meant = {at: near for at in unknown if (near := _nearest(at, table))}
    for fault in listed:
        if fault["type"] == "missing" and fault["loc"] in meant.values():
            continue
        # An unknown key of a table with a fixed set of keys is reported as unknown.
        of_table = fault["loc"][-1:] == ("[key]",)
        at = fault["loc"][:-1] if of_table else fault["loc"]
        keys = ".".join(str(part) for part in at if part not in FORMS)
        if fault["type"] in _UNKNOWN or of_table:
            names = re.findall(r"'([^']*)'", str(fault.get("ctx", {}).get("expected", "")))
            near = str(meant[at][-1]) if at in meant else next(iter(get_close_matches(str(at[-1]), names, n=1)), "")
            text = f"unknown key; did you mean {near}?" if near else "unknown key; remove it or check its spelling"
        else:
            text = _words(fault)
        yield keys, text


def _words(fault: Mapping[str, Any]) -> str:
    kind, given = fault["type"], fault["input"]
    words = next((words for name, words in _WORDS.items() if kind.startswith(name)), None)
    text = fault["msg"].removeprefix("Value error, ") if words is None else words.format(**fault.get("ctx", {}))
    got = _as_written(given)
    large = isinstance(given, dict) or (isinstance(given, list) and isinstance(next(iter(given), 0), list))
    included = kind in _COUNTED or large or (isinstance(given, str) and got in text)
    return text if included else f"{text} (got {got})"


def _as_written(value: object) -> str:
    """A value in TOML, shortened."""
    if isinstance(value, bool):
        return str(value).lower()
    return value.isoformat() if isinstance(value, date | time) else shown(value)


def _nearest(at: _Keys, table: type[BaseModel]) -> _Keys | None:
    """The most similar key of the same table for an unknown key; None if there is none."""
    tables = [table]
    for part in at[:-1]:
        tables = [inner for kind in tables for inner in _inside(kind, part)]
    names = {
        field.alias or name
        for kind in tables
        if isinstance(kind, type) and issubclass(kind, BaseModel)
        for name, field in kind.model_fields.items()
    }
    near = get_close_matches(str(at[-1]), sorted(names), n=1)
    return (*at[:-1], near[0]) if near else None


def _inside(kind: Any, part: int | str) -> Iterator[Any]:
    """The kinds of value at a key; unchanged for the tag of a form."""
    if part in FORMS:
        yield kind
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        for name, field in kind.model_fields.items():
            if part in (name, field.alias):
                yield from _kinds(field.annotation)
    elif get_origin(kind) in (list, dict):
        yield from _kinds(get_args(kind)[-1])


def _kinds(annotation: Any) -> Iterator[Any]:
    """The kinds of value that an annotation allows."""
    if get_origin(annotation) is Annotated:
        yield from _kinds(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, UnionType):
        for kind in get_args(annotation):
            yield from _kinds(kind)
    else:
        yield annotation


def located(path: Path, faults: Sequence[str]) -> list[str]:
    """Faults `FILE: dotted.keys: words` of a TOML file with the line of the key or of its table: `FILE:line 7: ...`.

    Faults in other forms, or with keys that are not in the file, are unchanged.
    """
    try:
        lines = _lines(path.read_text("utf-8"))
    except (OSError, ValueError):
        return list(faults)
    with_lines = []
    for fault in faults:
        keys = fault.removeprefix(f"{path}: ").partition(": ")[0] if fault.startswith(f"{path}: ") else ""
        while keys and keys not in lines:
            keys = keys.rpartition(".")[0]
        with_lines.append(fault.replace(f"{path}: ", f"{path}:line {lines[keys]}: ", 1) if keys else fault)
    return with_lines


@contextmanager
def faults_at(path: Path, keys: str) -> Iterator[None]:
    """Add file, line and dotted keys to faults raised in the block.

    **Raises:** `InputError`.
    """
    try:
        yield
    except InputError as error:
        raise InputError(located(path, [f"{path}: {keys}: {fault}" for fault in error.faults])) from error


def _lines(text: str) -> dict[str, int]:
    """The line (from 1) of the first occurrence of each dotted path in a TOML text."""
    lines, within, counts = dict[str, int](), "", dict[str, int]()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            within = _bare(header[2])
            lines.setdefault(within, number)
            if header[1] == "[[":
                counts[within] = counts.get(within, -1) + 1
                within = f"{within}.{counts[within]}"
            lines.setdefault(within, number)
        elif key := _KEY.match(line):
            lines.setdefault(f"{within}.{_bare(key[1])}" if within else _bare(key[1]), number)
    return lines


def _bare(dotted: str) -> str:
    return ".".join(part.strip("\"'") for part in re.findall(_PART, dotted))
