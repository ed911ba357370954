"""Text of any layout: rows between separators, or lines with words around their numbers."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import polars as pl

from tumblecal.capture.columns.units import FINE
from tumblecal.capture.recordings.damage import Damage
from tumblecal.capture.recordings.table import Reader, Source, SourceTable
from tumblecal.capture.recordings.text_sought import check_late_marks, decoded, sought_layouts
from tumblecal.data.text_layout import TextLayout
from tumblecal.ground.text_file import is_utf16


_TEXT_SHARE = 0.95
_ROLES = {"SampleTimeFine": f"time_{FINE}"}


def _is_text(head: bytes) -> bool:
    if is_utf16(head):
        return True
    if b"\x00" in head:
        return False
    # As Western European text if it is not UTF-8, which has several bytes a letter.
    text = decoded(head[:4096].rsplit(b"\n", 1)[0])
    usual = sum(letter in "\t\r\n" or letter.isprintable() for letter in text)
    return usual > _TEXT_SHARE * len(text)


def _read(source: Source) -> list[SourceTable]:
    layouts, comments = sought_layouts(source.path, source.options)
    return [
        text_table(name if len(layouts) > 1 else "", layout, comments, source.damage)
        for name, layout in layouts.items()
    ]


def text_table(
    name: str, layout: TextLayout, comments: dict[str, str], damage: Damage, roles: Mapping[str, str] = _ROLES
) -> SourceTable:
    """The rows of a text with this layout as a table of a source."""

    def pieces(columns: Sequence[str]) -> Iterator[pl.DataFrame]:
        return layout.frames(
            columns,
            check=partial(check_late_marks, layout),
            cut=lambda line: damage.report(f"line {line} has no end and may be truncated: left out"),
        )

    def as_written(numbers: Collection[str]) -> SourceTable:
        columns = zip(layout.names, layout.marks, strict=True)
        marks = tuple(mark if column in numbers or mark[:1] != "." else "" for column, mark in columns)
        return text_table(name, replace(layout, marks=marks), comments, damage, roles)

    return SourceTable(
        *(name, layout.names, pieces),
        comments=comments,
        description=layout.words(),
        row_word="line",
        header=layout.header_line,
        sheet=layout.header_line is not None,
        as_written=as_written,
        roles={name: role for name, role in roles.items() if name in layout.names},
    )


READER = Reader("text", lambda path, head: _is_text(head), _read, rank=2)
