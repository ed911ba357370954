"""JSON: an object in each line, lists of objects, or lists of numbers in an object; nested names are joined by dots."""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain, islice
from typing import Any

import numpy as np
import polars as pl

from tumblecal.data.text_cells import pieces_of
from tumblecal.data.text_layout import ROW
from tumblecal.ground.decoding import damaged
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import opened
from tumblecal.recordings.columns import is_number
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table, tables_of_arrays


_SEEN, _WHOLE_SHARE = 1000, 0.8
_MOST_KINDS, _MOST_ITEMS = 12, 32
# Rows that are in memory as objects; Python's garbage collection is slow with more.
_AT_ONCE = 2000
# Of each byte of a list of objects.
_BYTES_IN_MEMORY = 10
# Characters around the object of a line, also of a list with an object in each line.
_AROUND = " \t\r,[]\ufeff"
_DECODER = json.JSONDecoder()

Row = Mapping[str, Any]
# The numbers and texts (or objects) of the rows from the first on, in pieces.
Pieces = Callable[[], Iterable[Sequence[tuple[int, str | Row]]]]


def _recognised(path: object, head: bytes) -> bool:
    text = head.decode("utf-8-sig", "replace").lstrip()
    lines = text.splitlines()[:20]
    return bool(re.match(r'(\[\s*)?\{\s*"[^"]*"\s*:', text)) or sum(map(_is_row, lines)) > _WHOLE_SHARE * len(lines)


def _columns(rows: Sequence[Row], most: int, before: str = "") -> dict[str, list]:
    """The values of objects by their names, joined by dots; lists of up to `most` items are objects."""
    found: dict[str, list] = {}
    for key in dict.fromkeys(chain.from_iterable(rows)):
        values = [row.get(key) for row in rows]
        if {dict, list} & {*map(type, values)}:
            nested = [_items(value, most) for value in values]
            found |= _columns(nested, most, f"{before}{key}.")
            values = [None if own else value for own, value in zip(nested, values, strict=True)]
        if {*map(type, values)} != {type(None)}:
            found[f"{before}{key}"] = values
    return found


def _items(value: object, most: int) -> Row:
    """The items of a value by their names; none for a single value."""
    if isinstance(value, list) and len(value) <= most:
        return dict(zip("xyz" if len(value) == 3 else map(str, range(1, most + 1)), value, strict=False))
    return value if isinstance(value, dict) else {}


def _loaded(text: str) -> Any:
    content, end = _DECODER.raw_decode(text)
    if end < len(text):
        raise ValueError
    if "\\ud" in text:
        # A single half of a surrogate pair is not text.
        json.dumps(content, ensure_ascii=False).encode()
    return content


def _row(given: str | Row) -> Row:
    """The object of a row; empty for a line that is no object of values."""
    if not isinstance(given, str):
        return given
    try:
        row = _loaded(given.strip(_AROUND))
    except (ValueError, RecursionError):
        return {}
    return row if isinstance(row, dict) else {}


def _read(source: Source) -> list[Table]:
    path = source.path

    def lines() -> Iterator[Sequence[tuple[int, str | Row]]]:
        first = 1
        for piece in pieces_of(path):
            texts = enumerate(piece.decode("utf-8", "replace").split("\n"), first)
            if rows := [(number, text) for number, text in texts if text.strip(_AROUND)]:
                yield rows
            first += piece.count(b"\n")

    first = [_is_row(text) for _, text in _first(lines)]
    if sum(first) > max(0, _WHOLE_SHARE * (len(first) - 1)):
        return _tables("", lines, "line")
    size = path.stat().st_size
    what = "objects of a list, or lists of an object,"
    require_size(path, what, _BYTES_IN_MEMORY * size, size, "write one object in each line")
    with opened(path) as file:
        try:
            content = _loaded(file.read().decode("utf-8-sig").strip())
            values = _columns([content if isinstance(content, dict) else {"": content}], 0)
        except (ValueError, RecursionError) as error:
            raise damaged(path, "JSON file", error) from error
    tables, arrays = list[Table](), dict[str, np.ndarray]()
    lists = {name: value for name, (value,) in values.items() if isinstance(value, list)}
    of_objects = [name for name, own in lists.items() if own and all(isinstance(item, dict) for item in own)]
    for name, own in lists.items():
        if name in of_objects:
            tables += _tables(name * (len(of_objects) > 1), lambda own=own: [[*enumerate(own, 1)]], "element")
        with suppress(ValueError):  # lists of different lengths
            arrays |= {name: np.array(own)} if own else {}
    if tables := tables or tables_of_arrays(arrays):
        return tables
    words = "JSON without samples; samples are read from one object a line, a list of objects, or an object of lists"
    raise InputError(f"{path}: {words}")


def _is_row(text: str | Row) -> bool:
    """Whether a line is an object of values."""
    columns = _columns([_row(text)], _MOST_ITEMS)
    return bool(columns) and not any(isinstance(value, list) for (value,) in columns.values())


def _first(pieces: Pieces) -> list[tuple[int, str | Row]]:
    return list(islice(chain.from_iterable(pieces()), _SEEN))


def _kinds(seen: Sequence[Row]) -> Callable[[Row], str]:
    """The kind of a row: the word in a field such as `sensor`, or the names that other rows do not have."""
    for name in seen[0]:
        texts = {value for row in seen if isinstance(value := row.get(name), str)}
        if len(texts) <= _MOST_KINDS and sum(not is_number(text) for text in texts) > 1:
            return lambda row: str(row.get(name, ""))
    every = dict.fromkeys(chain.from_iterable(seen))
    # An object without one of the names is of the same kind as an object with all names.
    one = any(len(row) == len(every) for row in seen)
    some = [] if one else [name for name in every if not all(name in row for row in seen)]
    return lambda row: ", ".join(name for name in some if name in row)


def _tables(title: str, pieces: Pieces, row_word: str) -> list[Table]:
    """A table for each kind of object."""
    if not (first := [row for _, given in _first(pieces) if (row := _row(given))]):
        return []
    kind_of = _kinds(first)

    def table(kind: str) -> Table:
        own = _columns([row for row in first if kind_of(row) == kind], _MOST_ITEMS)
        # A name that is only the letter of an axis gets the word of its kind as a prefix.
        names = {f"{kind}.{name}" if kind and name in ("x", "y", "z") else name: name for name in own}
        numeric = {name for name, values in own.items() if any(isinstance(value, int | float) for value in values)}

        def frame_of(piece: Sequence[tuple[int, str | Row]], schema: Mapping[str, type[pl.DataType]]) -> pl.DataFrame:
            rows = [(line, row) for line, given in piece if not (row := _row(given)) or kind_of(row) == kind]
            found, none = _columns([row for _, row in rows], _MOST_ITEMS), [None] * len(rows)
            values = {column: found.get(names[column], none) for column in schema}
            return pl.DataFrame(values, schema, strict=False).with_columns(
                pl.Series(ROW, [line for line, _ in rows], pl.Int64)
            )

        def frames(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
            schema = {column: pl.Float64 if names[column] in numeric else pl.String for column in columns}
            for piece in pieces():
                yield pl.concat([frame_of(piece[k : k + _AT_ONCE], schema) for k in range(0, len(piece), _AT_ONCE)])

        words = f"JSON, {len(names)} columns"
        return Table(" ".join(filter(None, (title, kind))), tuple(names), frames, words=words, row_word=row_word)

    return [table(kind) for kind in dict.fromkeys(map(kind_of, first))]


READER = Reader("JSON", _recognised, _read, rank=1)
