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
# Of each byte of a list of objects.
_BYTES_IN_MEMORY = 10
# Characters around the object of a line, also of a list with an object in each line.
_AROUND = " \t\r,[]\ufeff"

Row = dict[str, object]
# The numbers and texts (or objects) of the rows from the first on, in pieces.
Pieces = Callable[[], Iterable[Sequence[tuple[int, str | Row]]]]


def _recognised(path: object, head: bytes) -> bool:
    text = head.decode("utf-8-sig", "replace").lstrip()
    lines = text.splitlines()[:20]
    rows = sum(bool(_row(line)) for line in lines)
    return rows > _WHOLE_SHARE * (len(lines) - 1) if rows else bool(re.match(r'(\[\s*)?\{\s*"[^"]*"\s*:', text))


def _flat(content: Mapping[str, object], most: int = 0, before: str = "") -> Row:
    """The values in an object by their names, joined by dots; lists of up to `most` items are objects."""
    row = Row()
    for key, value in content.items():
        if isinstance(value, list) and len(value) <= most:
            value = dict(zip("xyz" if len(value) == 3 else map(str, range(1, most + 1)), value, strict=False))
        row |= _flat(value, most, f"{before}{key}.") if isinstance(value, dict) else {f"{before}{key}": value}
    return row


def _loaded(text: str) -> Any:
    content = json.loads(text)
    if "\\ud" in text:
        # A single half of a surrogate pair is not text.
        json.dumps(content, ensure_ascii=False).encode()
    return content


def _row(given: str | Row) -> Row:
    """The values of a row; none for a line that is not an object of values."""
    try:
        content = _loaded(given.strip(_AROUND)) if isinstance(given, str) else given
        row = _flat(content, _MOST_ITEMS) if isinstance(content, dict) else Row()
    except (ValueError, RecursionError):
        return Row()
    values = {name: value for name, value in row.items() if not isinstance(value, list)}
    return Row() if isinstance(given, str) and len(values) < len(row) else values


def _read(source: Source) -> list[Table]:
    path = source.path

    def lines() -> Iterator[Sequence[tuple[int, str | Row]]]:
        first = 1
        for piece in pieces_of(path):
            texts = enumerate(piece.decode("utf-8", "replace").split("\n"), first)
            if rows := [(number, text) for number, text in texts if text.strip(_AROUND)]:
                yield rows
            first += piece.count(b"\n")

    seen = _seen(lines)
    if sum(map(bool, seen)) > max(0, _WHOLE_SHARE * (len(seen) - 1)):
        return _tables("", lines, "line")
    size = path.stat().st_size
    what = "objects of a list, or lists of an object,"
    require_size(path, what, _BYTES_IN_MEMORY * size, size, "write one object in each line")
    with opened(path) as file:
        try:
            content = _loaded(file.read().decode("utf-8-sig"))
            values = _flat(content if isinstance(content, dict) else {"": content})
        except (ValueError, RecursionError) as error:
            raise damaged(path, "JSON file", error) from error
    tables, arrays, lists = (
        list[Table](),
        dict[str, np.ndarray](),
        {k: v for k, v in values.items() if isinstance(v, list)},
    )
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


def _seen(pieces: Pieces) -> list[Row]:
    return [_row(given) for _, given in islice(chain.from_iterable(pieces()), _SEEN)]


def _kinds(seen: Sequence[Row]) -> Callable[[Row], str]:
    """The kind of a row: the word in a field such as `sensor`, or the names that other rows do not have."""
    for name in seen[0]:
        values = {row.get(name) for row in seen}
        words = sum(isinstance(value, str) and not is_number(value) for value in values)
        if words > 1 and len(values) <= _MOST_KINDS:
            return lambda row: str(row.get(name, ""))
    every = dict.fromkeys(name for row in seen for name in row)
    # An object without one of the names is of the same kind as an object with all names.
    one = any(len(row) == len(every) for row in seen)
    some = [] if one else [name for name in every if not all(name in row for row in seen)]
    return lambda row: ", ".join(name for name in some if name in row)


def _tables(title: str, pieces: Pieces, row_word: str) -> list[Table]:
    """A table for each kind of object."""
    if not (seen := [row for row in _seen(pieces) if row]):
        return []
    kind_of = _kinds(seen)
    kinds = dict.fromkeys(map(kind_of, seen))

    def table(kind: str) -> Table:
        # A name that is only the letter of an axis gets the word of its kind as a prefix.
        own = [row for row in seen if kind_of(row) == kind]
        names = {f"{kind}.{name}" if kind and name in ("x", "y", "z") else name: name for row in own for name in row}
        numeric = {name for row in own for name, value in row.items() if isinstance(value, int | float)}

        def frames(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
            schema = {column: pl.Float64 if names[column] in numeric else pl.String for column in columns}
            for piece in pieces():
                lines, given = zip(*piece, strict=True)
                rows = [
                    (line, row)
                    for line, row in zip(lines, map(_row, given), strict=True)
                    if not row or kind_of(row) == kind
                ]
                frame = pl.DataFrame(
                    {column: [row.get(names[column]) for _, row in rows] for column in schema}, schema, strict=False
                )
                yield frame.with_columns(pl.Series(ROW, [line for line, _ in rows], pl.Int64))

        words = f"JSON, {len(names)} columns"
        return Table(" ".join(filter(None, (title, kind))), tuple(names), frames, words=words, row_word=row_word)

    return [table(kind) for kind in kinds]


READER = Reader("JSON", _recognised, _read, rank=1)
