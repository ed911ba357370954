"""JSON: an object in each line, one list of objects, or one object of lists; nested names are joined by dots."""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
import polars as pl

from tumblecal.data.parquet import PIECE_ROWS
from tumblecal.data.text_cells import pieces_of
from tumblecal.data.text_layout import ROW
from tumblecal.ground.decoding import damaged
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import opened
from tumblecal.recordings.memory import require_size
from tumblecal.recordings.table import Reader, Source, Table, tables_of_arrays


_SEEN = 1000
_MOST_KINDS, _MOST_ITEMS = 12, 32
_WHOLE_SHARE = 0.8
# Of each byte of a list of objects.
_BYTES_IN_MEMORY = 10

Row = dict[str, object]
# The objects with their lines, from the start at each call; None for a line that is not an object.
Rows = Callable[[], Iterable[tuple[int, Row | None]]]


def _recognised(path: Path, head: bytes) -> bool:
    text = head.decode("utf-8-sig", "replace").lstrip()
    if re.match(r"\[\s*\{", text):
        return True
    lines = text.splitlines()[:20]
    of_rows = sum(_row(line) is not None for line in lines)
    return of_rows > _WHOLE_SHARE * (len(lines) - 1) if of_rows else bool(re.match(r'\{\s*"[^\[{]*[\[{]', text))


def _row(line: str) -> Row | None:
    """The object of a line with nested names joined; None for other lines and for an object of lists."""
    try:
        content = json.loads(line)
        row = _flat(content) if isinstance(content, dict) else None
    except (ValueError, RecursionError):
        return None
    return None if row is None or any(isinstance(value, list) for value in row.values()) else row


def _flat(content: Mapping[str, object], before: str = "") -> Row:
    row = Row()
    for key, value in content.items():
        if isinstance(value, list) and len(value) <= _MOST_ITEMS:
            names = "xyz" if len(value) == 3 else range(1, len(value) + 1)
            value = dict(zip(map(str, names), value, strict=True))
        if isinstance(value, dict):
            row |= _flat(value, f"{before}{key}.")
        else:
            row[f"{before}{key}"] = value
    return row


def _numbered_pieces(path: Path) -> Iterator[tuple[int, bytes]]:
    line = 1
    for piece in pieces_of(path):
        yield line, piece
        line += piece.count(b"\n")


def _rows_in(line: int, piece: bytes) -> Iterator[tuple[int, Row | None]]:
    """The objects in lines that are numbered from this number."""
    for number, text in enumerate(piece.removesuffix(b"\n").decode("utf-8", "replace").split("\n"), line):
        if content := text.strip(" \t,[]\ufeff"):
            yield number, _row(content)


def _rows_of_lines(path: Path) -> Iterator[tuple[int, Row | None]]:
    for line, piece in _numbered_pieces(path):
        yield from _rows_in(line, piece)


def _flat_frame(line: int, piece: bytes, kinds: Mapping[str, bool]) -> pl.DataFrame | None:
    """The rows of lines, if each is an object with exactly these keys, each once; otherwise None.

    **Arguments:**

    - `kinds`: the keys, and whether their values are numbers (otherwise words).
    """
    count = piece.count(b"\n") + (not piece.endswith(b"\n"))
    marks = {b"{": count, b"}": count, b"[": 0, b"\\": 0, b"true": 0, b"false": 0, b"},": 0}
    marks |= {json.dumps(key, ensure_ascii=False).encode(): count for key in kinds}
    marks[b'"'] = count * sum(2 if number else 4 for number in kinds.values())
    if any(piece.count(mark) != count for mark, count in marks.items()):
        return None
    try:
        schema = {key: pl.Float64 if number else pl.String for key, number in kinds.items()}
        frame = pl.read_ndjson(piece, schema=schema)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError):
        return None
    if len(frame) != count or sum(frame.null_count().row(0)):
        return None
    return frame.with_columns(pl.Series(ROW, range(line, line + count), pl.Int64))


def _read(source: Source) -> list[Table]:
    seen = [row for _, row in islice(_rows_of_lines(source.path), _SEEN)]
    if sum(row is not None for row in seen) > max(0, _WHOLE_SHARE * (len(seen) - 1)):
        return _tables(seen, lambda: _rows_of_lines(source.path), "line", source.path)
    size = source.path.stat().st_size
    what = "objects of a list, or lists of an object,"
    require_size(source.path, what, _BYTES_IN_MEMORY * size, size, "write one object in each line")
    with opened(source.path) as file:
        try:
            content = json.loads(file.read())
        except (ValueError, RecursionError) as error:
            raise damaged(source.path, "JSON file", error) from error
    lists = [content] if isinstance(content, list) else [*content.values()] if isinstance(content, dict) else []
    of_rows = [one for one in lists if isinstance(one, list) and one and all(isinstance(item, dict) for item in one)]
    if of_rows:
        rows = [_flat(item) for item in max(of_rows, key=len)]
        return _tables(rows[:_SEEN], lambda: enumerate(rows, start=1), "element")
    if tables := tables_of_arrays(_arrays(content) if isinstance(content, dict) else {}):
        return tables
    raise InputError(
        f"{source.path}: JSON without samples; samples are read from one object a line, a list of objects, or an object of "
        "lists"
    )


def _arrays(content: Mapping[str, object], before: str = "") -> dict[str, np.ndarray]:
    """The lists of numbers or words in an object."""
    arrays = dict[str, np.ndarray]()
    for key, value in content.items():
        if isinstance(value, dict):
            arrays |= _arrays(value, f"{before}{key}.")
        elif isinstance(value, list) and value:
            try:
                arrays[f"{before}{key}"] = np.array(value)
            except ValueError:  # lists of different lengths
                continue
    return arrays


def _tables(seen: Sequence[Row | None], rows: Rows, row_word: str, lines: Path | None = None) -> list[Table]:
    """A table for each kind of object, by the word in a field such as `sensor`, or by the names.

    **Arguments:**

    - `lines`: the file, if each line is an object.
    """
    whole = [row for row in seen if row]
    words = [name for name in whole[0] if len({value for row in whole if isinstance(value := row.get(name), str)}) > 1]
    words = [name for name in words if len({row.get(name) for row in whole}) <= _MOST_KINDS]
    names = [
        name for name in dict.fromkeys(name for row in whole for name in row) if not all(name in row for row in whole)
    ]

    def kind_of(row: Row) -> str:
        if words:
            return str(row.get(words[0], ""))
        return ", ".join(name for name in names if name in row) if names else ""

    kinds = dict[str, list[Row]]()
    for row in whole:
        kinds.setdefault(kind_of(row), []).append(row)
    if not words and any(len(row) == len(set().union(*whole)) for row in whole):
        # An object without one of the names is of the same kind as an object with all names.
        return [_table("", whole, lambda row: "", rows, row_word, lines)]
    return [_table(kind, names, kind_of, rows, row_word) for kind, names in kinds.items()]


def _table(
    kind: str,
    seen: Sequence[Row],
    kind_of: Callable[[Row], str],
    rows: Rows,
    row_word: str,
    lines: Path | None = None,
) -> Table:
    names = tuple(dict.fromkeys(name for row in seen for name in row))
    # A name that is only the letter of an axis gets the word of its kind as a prefix.
    source_names = {f"{kind}.{name}" if kind and name in ("x", "y", "z") else name: name for name in names}
    numeric = {
        column for column, name in source_names.items() if any(isinstance(row.get(name), int | float) for row in seen)
    }

    def frames(columns: Sequence[str], rows: Iterable[tuple[int, Row | None]]) -> Iterator[pl.DataFrame]:
        schema = {name: pl.Float64 if name in numeric else pl.String for name in columns} | {ROW: pl.Int64}
        cells = (
            (*((row or {}).get(source_names[column]) for column in columns), line)
            for line, row in rows
            if row is None or kind_of(row) == kind
        )
        while piece := list(islice(cells, PIECE_ROWS)):
            series = zip(schema.items(), zip(*piece, strict=True), strict=True)
            yield pl.DataFrame([pl.Series(name, values, dtype, strict=False) for (name, dtype), values in series])

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        if lines is None:
            yield from frames(columns, rows())
            return
        kinds = {name: name in numeric for name in names}
        for line, piece in _numbered_pieces(lines):
            frame = _flat_frame(line, piece, kinds)
            yield from frames(columns, _rows_in(line, piece)) if frame is None else [frame.select([*columns, ROW])]

    return Table(kind, tuple(source_names), pieces, words=f"JSON, {len(names)} columns", row_word=row_word)


READER = Reader("JSON", _recognised, _read, rank=1)
