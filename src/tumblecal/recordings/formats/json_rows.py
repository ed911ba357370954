"""JSON: an object in each line, lists of objects, or lists of numbers in an object; nested names are joined by dots."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from tumblecal.data.text_cells import pieces_of
from tumblecal.data.text_layout import ROW
from tumblecal.ground.decoding import damaged
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import opened
from tumblecal.recordings.columns import is_number
from tumblecal.recordings.formats.arrays import of_frame
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table, tables_of_arrays


# Rows that show the form; rows that are in memory as objects: Python's garbage collection is slow with more.
_SEEN, _AT_ONCE = 1000, 2000
_WHOLE_SHARE, _MOST_KINDS, _MOST_ITEMS = 0.8, 12, 32
# Of each byte of a list of objects.
_BYTES_IN_MEMORY = 10
# Characters around the object of a line, also of a list with an object in each line.
_AROUND = " \t\r,[]\ufeff"
_DECODER = json.JSONDecoder()

Row = Mapping[str, Any]


def _recognised(path: object, head: bytes) -> bool:
    text = head.decode("utf-8-sig", "replace").lstrip()
    return bool(re.match(r'(\[\s*)?\{\s*"[^"]*"\s*:', text)) or _are_rows(map(_row, text.splitlines()[:20]))


def _are_rows(rows: Iterable[Row]) -> bool:
    """Whether most rows are objects of values; the last one may be torn."""
    columns = [_columns([row], _MOST_ITEMS) for row in rows]
    good = [own for own in columns if own and not any(isinstance(value, list) for (value,) in own.values())]
    return len(good) > max(0, _WHOLE_SHARE * (len(columns) - 1))


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


def _row(text: str) -> Row:
    """The object of a line; empty for a line that is no object of values."""
    with suppress(ValueError, RecursionError):
        row = _loaded(text.strip(_AROUND))
        return row if isinstance(row, dict) else {}
    return {}


def _lines(path: Path) -> Iterator[tuple[int, Row]]:
    """The objects of the lines that are not blank, with their numbers."""
    first = 1
    for piece in pieces_of(path):
        texts = enumerate(piece.decode("utf-8", "replace").split("\n"), first)
        yield from ((number, _row(text)) for number, text in texts if text.strip(_AROUND))
        first += piece.count(b"\n")


def _read(source: Source) -> list[Table]:
    path = source.path
    if _are_rows(row for _, row in islice(_lines(path), _SEEN)):
        return _tables("", _lines(path), "line")
    size = path.stat().st_size
    what = "objects of a list, or lists of an object,"
    require_size(path, what, _BYTES_IN_MEMORY * size, size, "write one object in each line")
    with opened(path) as file:
        try:
            content = _loaded(file.read().decode("utf-8-sig").strip())
            values = _columns([content if isinstance(content, dict) else {"": content}], 0)
        except (ValueError, RecursionError) as error:
            raise damaged(path, "JSON file", error) from error
    arrays = dict[str, np.ndarray]()
    lists = {name: value for name, (value,) in values.items() if value and isinstance(value, list)}
    of_objects = {name: own for name, own in lists.items() if all(isinstance(item, dict) for item in own)}
    titles = {name: name * (len(of_objects) > 1) for name in of_objects}
    tables = [
        table for name, own in of_objects.items() for table in _tables(titles[name], enumerate(own, 1), "element")
    ]
    for name, own in lists.items():
        with suppress(ValueError):  # lists of different lengths
            arrays[name] = np.array(own)
    if tables := tables or tables_of_arrays(arrays):
        return tables
    words = "JSON without samples; samples are read from one object a line, a list of objects, or an object of lists"
    raise InputError(f"{path}: {words}")


def _tables(title: str, rows: Iterator[tuple[int, Row]], row_word: str) -> list[Table]:
    """A table for each kind of row: the word in a field such as `sensor`, or the names that other rows do not have."""
    frames, word, some = dict[str, list[pl.DataFrame]](), "", list[str]()
    while piece := list(islice(rows, _AT_ONCE)):
        if not frames:
            seen = [row for _, row in piece[:_SEEN] if row]
            for name in seen[0] if seen else ():
                texts = {value for row in seen if isinstance(value := row.get(name), str)}
                if len(texts) <= _MOST_KINDS and sum(not is_number(text) for text in texts) > 1:
                    word = word or name
            every = dict.fromkeys(chain.from_iterable(seen))
            # An object without one of the names is of the same kind as an object with all names.
            if not any(len(row) == len(every) for row in seen):
                some = [name for name in every if not all(name in row for row in seen)]
        kinds = [
            str(row.get(word, "")) if word else ", ".join(name for name in some if name in row) for _, row in piece
        ]
        new = [] if frames else [kind for kind, (_, row) in zip(kinds, piece, strict=True) if row]
        for kind in frames or dict.fromkeys(new):
            # A row that cannot be read may be of any kind.
            own = [one for one, of_row in zip(piece, kinds, strict=True) if of_row == kind or not one[1]]
            columns = _columns([row for _, row in own], _MOST_ITEMS)
            numeric = {name for name, cells in columns.items() if any(isinstance(cell, int | float) for cell in cells)}
            schema = {name: pl.Float64 if name in numeric else pl.String for name in columns}
            places = pl.Series(ROW, [number for number, _ in own], pl.Int64)
            frames.setdefault(kind, []).append(pl.DataFrame(columns, schema, strict=False).with_columns(places))
    return [_table(title, kind, pl.concat(own, how="diagonal_relaxed"), row_word) for kind, own in frames.items()]


def _table(title: str, kind: str, frame: pl.DataFrame, row_word: str) -> Table:
    # A name that is only the letter of an axis gets the word of its kind as a prefix.
    frame = frame.rename({name: f"{kind}.{name}" for name in "xyz" if kind and name in frame.columns})
    words = f"JSON, {frame.width - 1} columns"
    return of_frame(" ".join(filter(None, (title, kind))), frame, words=words, row_word=row_word)


READER = Reader("JSON", _recognised, _read, rank=1)
