"""Position sets from CSV or Parquet files, and back."""

import csv
import io
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from tumblecal.data.columns import Table, positions, renamed
from tumblecal.data.parquet import read_parquet
from tumblecal.data.positions import PositionSet
from tumblecal.ground.atomic import write_text, written_aside
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.text_file import read_text


_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


def read_positions(path: Path | str, *, check_size: bool = True, names: Mapping[str, str] | None = None) -> PositionSet:
    """Read a file of positions, CSV or Parquet by its name.

    **Arguments:**

    - `path`: a `.parquet` file, or a CSV file of any other name.
    - `check_size`: refuse readings whose size is not near 1 g.
    - `names`: what columns are called in the file, by what they are (`{"ax_g": "AccX"}`); others that are not known are then
      left out, and positions without a name are numbered.

    **Raises:** `InputError` with every fault, each with file, line and column.
    """
    path = Path(path)
    table = _parquet_table(path) if path.suffix == ".parquet" else csv_table(path)
    return positions(table if names is None else renamed(table, names), check_size=check_size)


def stated(lines: Iterable[str]) -> dict[str, str]:
    """What comment lines `# key: value` state; other comments are passed over."""
    pairs = (line.lstrip("#").partition(":") for line in lines)
    return {key.strip(): value.strip() for key, colon, value in pairs if colon and " " not in key.strip()}


def csv_table(path: Path) -> Table:
    """The columns of a CSV file with `# key: value` comments, a header line and a row a line.

    **Raises:** `InputError` for a file that is not such a table.
    """
    comments: dict[str, str] = {}
    header: list[str] | None = None
    header_line, rows, lines, faults, separator = 0, [], [], [], ","
    for number, text in enumerate(read_text(path).splitlines(), start=1):
        if text.startswith("#"):
            comments |= stated([text])
            continue
        if not text.strip():
            continue
        if header is None:
            separator = _separator(text)
        try:
            cells = next(csv.reader([text], strict=True, delimiter=separator))
        except csv.Error as error:
            faults.append(f"{path}:line {number}: {error}; check the quotation marks")
            continue
        if header is None:
            header, header_line = [cell.strip() for cell in cells], number
        elif len(cells) != len(header):
            faults.append(f"{path}:line {number}: {len(cells)} cells, but the header has {len(header)}")
        else:
            rows.append(cells if separator == "," else [_with_point(cell) for cell in cells])
            lines.append(number)
    if header is None:
        raise InputError(f"{path}: no header line; the first line names the columns")
    twice = sorted({name for name in header if header.count(name) > 1})
    faults += [f"{path}:line {header_line}, column {name}: the column stands twice; keep one" for name in twice]
    if faults:
        raise InputError(faults[:20])
    columns = {name: [row[column] for row in rows] for column, name in enumerate(header)}
    return Table(str(path), columns, lines, comments, header_line)


def _separator(header: str) -> str:
    """What separates the columns: a comma, or a semicolon or tab where a spreadsheet wrote them."""
    return max(",;\t", key=header.count)


def _with_point(cell: str) -> str:
    """A number with a decimal comma (0,5) with a point; other cells as they are."""
    return cell.strip().replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell.strip()) else cell


def _parquet_table(path: Path) -> Table:
    frame, comments = read_parquet(path)
    columns = {name: frame[name].to_list() for name in frame.columns}
    return Table(str(path), columns, range(1, len(frame) + 1), comments, 0, "row")


def write_positions(path: Path | str, data: PositionSet) -> None:
    """Write a position set, CSV or Parquet by the file's name; whole or not at all. Numbers keep all digits."""
    path = Path(path)
    columns = data.columns
    if path.suffix == ".parquet":
        with written_aside(path) as aside:
            data.table().write_parquet(aside, metadata=data.comments)
        return
    out = io.StringIO()
    for key, value in data.comments.items():
        out.write(f"# {key}: {one_line(value)}\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*([_cell(value) for value in values] for values in columns.values()), strict=True))
    write_text(path, out.getvalue())


def _cell(value: object) -> object:
    return repr(int(value) if value.is_integer() else value) if isinstance(value, float) else value
