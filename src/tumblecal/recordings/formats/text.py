"""Text: rows between separators, or lines with words around their numbers; what the lines before the rows state."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import mode

import polars as pl

from tumblecal.data.column_names import FORCE, role_of
from tumblecal.data.files import stated
from tumblecal.data.line_form import FORM_SEPARATOR, clock_form, has_words, without_clock, word_forms
from tumblecal.data.text_cells import cells_of, numbers_in, row_of, separator_of
from tumblecal.data.text_layout import SEPARATORS, TextLayout
from tumblecal.ground.decimal_marks import DECIMAL_COMMA
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.text_file import comment_in, is_utf16, opened, shown
from tumblecal.recordings.formats.text_layouts import header_of, kinds_of, layout_of_kind, statements_in
from tumblecal.recordings.table import Reader, Source, Table


_HEAD, _LINES, _FEWEST_LINES, _TEXT_SHARE = 1 << 16, 200, 2, 0.95
# The first two rows of Empatica files: the time, s since 1970, and the rate, Hz, each in all columns.
_MOMENT = r"\d{10}(\.\d*)?"
# A cell without a number, as loggers write it.
_MISSING = re.compile(r"^(\W{0,3}|nan|null|none|n/?a)$", re.IGNORECASE)


def _is_text(path: Path, head: bytes) -> bool:
    if is_utf16(head):
        return True
    text = decoded(head[:4096].rsplit(b"\n", 1)[0])
    usual = sum(letter in "\t\r\n" or letter.isprintable() for letter in text)
    return b"\x00" not in head and usual > _TEXT_SHARE * len(text)


def decoded(raw: bytes) -> str:
    """A line of text, as UTF-8 or otherwise in the Western European encoding of spreadsheets."""
    try:
        return raw.decode("utf-8-sig").rstrip("\r\n")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace").rstrip("\r\n")


def _read(source: Source) -> list[Table]:
    """The tables of a text: one, or one for each kind of row.

    **Raises:** `InputError` if there are no rows of three numbers, or the header does not fit the rows.
    """
    path = source.path
    with opened(path) as file:
        head = file.read(_HEAD)
    # The last line may be longer.
    written = [decoded(raw) for raw in head.splitlines(keepends=True)[: None if len(head) < _HEAD else -1]]
    body = [line for line in written if line.strip() and comment_in(line) is None]
    # Lines from the middle show the layout: preambles come first, and the last line may be torn.
    middle = body[len(body) // 2 :][:_LINES]
    plain = without_clock(middle)
    separator = separator_of(plain or middle)
    clock = clock_form(separator) if plain else None
    if kinds := kinds_of(middle, separator):
        return [text_table(source, *layout_of_kind(path, written, kind, separator), kind.lstrip("$")) for kind in kinds]
    lines = [clock.line(line) for line in written] if clock else written
    rows = [[] if comment_in(line) is not None else row_of(line, separator) for line in lines]
    good = [row for row in rows if numbers_in(row) >= 3]
    width = mode(map(len, good)) if good else 0
    good = [row for row in good if len(row) == width]
    if len(good) < min(_FEWEST_LINES, len(body) - 1):
        if table := _of_axes(source, rows, separator):
            return [table]
        good = []
    roles = [{role_of(cell)[0] for cell in row if not numbers_in([cell])} for row in rows]
    # A last column may be empty in some rows, or in all.
    named = {len(row) for row, there in zip(rows, roles, strict=True) if there - {""}}
    ends = separator != " " and any(cells_of(line, separator)[width:] == [""] for line in middle)
    columns = width + (ends and width not in named and width + 1 in named)
    # Lines before the rows have words in some columns of numbers.
    numeric = [k for k, cells in enumerate(zip(*good, strict=True)) if 2 * numbers_in(cells) > len(good)]
    are_rows = [
        width - 1 <= len(row) <= columns and numbers_in(row) >= 3
        and numbers_in([_MISSING.sub("0", row[k]) for k in numeric if k < len(row)]) >= len(numeric) - (len(row) < width)
        for row in rows
    ]  # fmt: skip
    first = are_rows.index(True) if True in are_rows else len(rows)
    filled = max((k for row in good for k, cell in enumerate(row, start=1) if cell), default=0)
    widths = (columns, columns if clock else filled)
    names, header = header_of(source, written[:first], separator, *widths, clock=bool(clock)) if good else ((), None)
    axes = [number for number, there in enumerate(roles) if there >= {*FORCE}]
    if header is None and len(axes) == 1:
        # The rows below this line have words under the names, all or the first ones.
        width = len(rows[axes[0]])
        names, header = header_of(source, written[: axes[0] + 1], separator, width, width, clock=False)
    labels = any(len({*cells}) == 1 and role_of(cells[0])[0] for cells in zip(*good, strict=True))
    between_words = header is None and not (good and clock) and (not good or has_words(good) or labels)
    if between_words and (forms := word_forms(middle)):
        return [_of_form(source, written, form, name if len(forms) > 1 else "") for name, form in forms.items()]
    if not good and header is None:
        line = (body or [decoded(head[:_LINES])])[0]
        cells = row_of(line, separator)
        raise InputError(
            f"{path}: text without rows of three or more numbers in its first {_HEAD >> 10} kB; the first line {shown(line)} "
            f"has {counted(len(cells), 'cell')} separated by {SEPARATORS[separator]}, {numbers_in(cells)} of them numbers. "
            "Give the whole recording, with the accelerations of a sample in one line; for bytes of a device give --protocol"
        )
    statements = statements_in(written[:first], separator) | stated(written)
    time, rate, *_ = [*({*row} for row in rows[first : first + 2]), set(), set()]
    if header is None and len(time) == len(rate) == 1 and re.fullmatch(_MOMENT, *time):
        statements, first = statements | {"rate_hz": rate.pop()}, first + 2
    layout = TextLayout(path, names, separator, header, (header or first) + 1, clock)
    return [text_table(source, layout, statements)]


def text_table(
    source: Source,
    layout: TextLayout,
    statements: Mapping[str, str],
    name: str = "",
    roles: Mapping[str, str] | None = None,
) -> Table:
    """The rows of a text with this layout; all cells are text. `roles`: quantities of some columns."""
    decimal = source.options.decimal
    if decimal not in ("", "comma", "point", ",", "."):
        raise InputError(f"--decimal {decimal}: write point or comma")
    with_commas = decimal in ("comma", ",")
    if not decimal and layout.separator in ";\t|" + FORM_SEPARATOR:
        head = next(layout.frames(layout.names)).head(_LINES)
        with_commas = any(head[column].str.contains(DECIMAL_COMMA).any() for column in layout.names)

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        report = source.damage.report
        for frame in layout.frames(
            columns, cut=lambda line: report(f"line {line} has no end and may be truncated: left out")
        ):
            yield frame.with_columns(pl.col(pl.String).str.replace(DECIMAL_COMMA, "$1.$2")) if with_commas else frame

    return Table(
        *(name, layout.names, pieces),
        stated=statements,
        words=layout.words() + (", decimal comma" if with_commas else ""),
        row_word="line",
        sheet=layout.header_line is not None,
        roles={name: role for name, role in (roles or {}).items() if name in layout.names},
    )


def _of_form(source: Source, written: Sequence[str], form, name: str) -> Table:
    """A table of lines with words around their numbers."""
    first = next(k for k, line in enumerate(written) if form.pattern.match(line.encode()))
    layout = TextLayout(source.path, form.names, FORM_SEPARATOR, None, first + 1, form)
    return text_table(source, layout, statements_in(written[:first], FORM_SEPARATOR), name)


def _of_axes(source: Source, rows: Sequence[list[str]], separator: str) -> Table | None:
    """A table with a row for each axis, as one with a column for each; None for other text."""
    width = mode(map(len, rows))
    names, *good = [row for row in rows if len(row) == width]
    columns = dict(zip(names, zip(*good, strict=True), strict=False))
    axes = [name for name, cells in columns.items() if {*map(str.lower, cells)} == {"x", "y", "z"}]
    values = [name for name, cells in columns.items() if numbers_in(cells) == len(cells)]
    if len(axes) != 1 or not values or numbers_in(names):
        return None
    header = rows.index(names) + 1
    layout = TextLayout(source.path, tuple(names), separator, header, header + 1)
    keys = [name for name in names if name not in (axes[0], values[-1])]
    frame = pl.concat(layout.frames(names)).with_columns(pl.col(axes).str.to_lowercase())
    wide = frame.pivot(on=axes, index=keys, values=values[-1], aggregate_function="first")
    sensor = " ".join(str(frame[name][0]) for name in keys if frame[name].n_unique() == 1)
    wide = wide.rename({axis: f"{sensor} {axis}".strip() for axis in "xyz"})
    words = "text, a row for each axis"
    return Table("", tuple(wide.columns), lambda columns: iter([wide.select(columns)]), len(wide), words=words)


READER = Reader("text", _is_text, _read, rank=2)
