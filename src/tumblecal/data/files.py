"""Position sets: CSV and Parquet files."""

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from tumblecal.data.columns import positions
from tumblecal.data.faults import Faults
from tumblecal.data.named_layout import named_layout, require_different, row_words
from tumblecal.data.position_comments import ATTITUDES
from tumblecal.data.positions import PositionSet
from tumblecal.data.table import Table, renamed
from tumblecal.ground.atomic import write_text, written_aside
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.plain_text import as_text
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.ground.text_file import EMPTY_CELLS, comment_in, shown


# Keys of comments that the program uses; others are copied unchanged.
USED_COMMENTS = (
    *("serial_number", "gravity_ms2", "gravity_source", "noise_model", "attitudes", "measured_utc"),
    *("rate_hz", "counts_per_g", "corrected_by", "capture_setup"),
)
# As of a rig.
_MOST_POSITIONS = 100_000


def read_positions(
    path: Path | str,
    *,
    check_size: bool = True,
    names: Mapping[str, str] | None = None,
    one_of_several: bool = False,
    attitudes: str | None = None,
) -> PositionSet:
    """Read a position file, Parquet or CSV according to its name.

    **Arguments:**

    - `path`: a `.parquet` file, or a CSV file with any other name.
    - `check_size`: whether to reject readings whose size is not near 1 g.
    - `names`: the name of each column in the file, by its standard name (`{"ax_g": "AccX"}`). Other unknown columns are then
      ignored, and positions without a name are numbered. `one_of_several`: as in `renamed`.
    - `attitudes`: how they were set (`head`, `hand`, `unknown`), instead of the comment in the file.

    **Raises:** `InputError` with every fault, each with file, line and column.

    Examples:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> import tumblecal
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "mine.csv")
        ...     _ = file.write_text("Angle;Pitch;X;Y;Z\\n0;0;0,001;0;9,81\\n180;0;0,002;0;-9,80\\n")
        ...     names = {"alpha_deg": "Angle", "beta_deg": "Pitch", "ax_ms2": "X", "ay_ms2": "Y", "az_ms2": "Z"}
        ...     data = tumblecal.read_positions(file, names=names)
        >>> data.names, data.readings.round(3).tolist()
        (('p1', 'p2'), [[0.0, 0.0, 1.0], [0.0, 0.0, -0.999]])
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: {_folder_words(path)}")
    table = _parquet_table(path) if path.suffix == ".parquet" else csv_table(path)
    if attitudes is not None:
        table = replace(table, comments=table.comments | {ATTITUDES: attitudes})
    return positions(
        table if names is None else renamed(table, names, one_of_several=one_of_several), check_size=check_size
    )


def _folder_words(folder: Path) -> str:
    """The fault of a folder, with the file to give."""
    file = folder / "positions.csv"
    if file.is_file():
        return f"a folder; give the file, {file}"
    if (folder / "journal.log").is_file():
        return f"the folder of a capture; give {file} of this command: {suggested('reduce', folder, less=EVERY)}"
    return "a folder; give a file of positions"


def stated(lines: Iterable[str]) -> dict[str, str]:
    """The values of comment lines `# key: value`; other comments and lines are ignored.

    Quotation marks and empty cells that a spreadsheet adds to a comment are not part of the value.
    """
    comments = (comment for line in lines if (comment := comment_in(line)) is not None)
    pairs = (comment.lstrip("#").partition(":") for comment in comments)
    return {key.strip(): value.strip(EMPTY_CELLS) for key, colon, value in pairs if colon and " " not in key.strip()}


def stated_once(path: Path, comments: Iterable[tuple[int, str]]) -> dict[str, str]:
    """The values of numbered comment lines, as in `stated`.

    **Raises:** `InputError` if two lines state different values of a key in `USED_COMMENTS`.
    """
    values, lines = dict[str, str](), dict[str, int]()
    for line, text in comments:
        for key, value in stated([text]).items():
            if key in USED_COMMENTS and key in values and not _same(values[key], value):
                raise InputError(
                    f"{path}:line {line}: comment {key}: {shown(value)}, but line {lines[key]} states {shown(values[key])}; "
                    "keep the correct one"
                )
            values[key], lines[key] = value, line
    return values


def _same(one: str, other: str) -> bool:
    """Whether two values are the same text or number."""
    try:
        return one == other or float(one) == float(other)
    except ValueError:
        return False


def csv_table(path: Path) -> Table:
    """The columns of a CSV file with `# key: value` comments, a header line and one row on each line.

    **Raises:** `InputError` for a file that is not such a table.
    """
    layout, comments = named_layout(path)
    names, rows, faults = layout.names, dict[int, list[str]](), Faults(str(path))
    for number, cells, wrong in layout.rows():
        if wrong := wrong or row_words(cells, names):
            faults.add(wrong, f":line {number}")
        rows[number] = cells
        _require_few(path, len(rows))
    faults.stop()
    # A spreadsheet adds empty columns without a name.
    columns = [
        (name, cells) for name, *cells in zip(names, *rows.values(), strict=True) if name or "".join(cells).strip()
    ]
    require_different(layout, [name for name, _ in columns])
    comments = stated_once(path, comments)
    return Table(str(path), dict(columns), [*rows], comments, layout.header_line or 1, separator=layout.separator)


def _require_few(path: Path, rows: int) -> None:
    """Reject a table that is too long for positions.

    **Raises:** `InputError`.
    """
    if rows > _MOST_POSITIONS:
        command = suggested("reduce", path, "--out", path.stem)
        raise InputError(
            f"{path}: more than {_MOST_POSITIONS} positions; if the rows are samples, reduce them: {command}"
        )


def _parquet_table(path: Path) -> Table:
    from tumblecal.data.parquet import read_parquet, scan_parquet

    _require_few(path, scan_parquet(path, check=False)[1])
    frame, comments = read_parquet(path)
    columns = {name: frame[name].to_list() for name in frame.columns}
    return Table(str(path), columns, range(1, len(frame) + 1), comments, 0, "row")


def write_positions(path: Path | str, data: PositionSet) -> None:
    """Write a position set, Parquet or CSV according to the file name, completely or not at all, with full precision.

    **Raises:** `InputError` for a file that cannot be written.

    Examples:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> import numpy as np
        >>> from tumblecal.data import PositionSet, write_positions
        >>> data = PositionSet(("a",), np.zeros(1), np.zeros(1), np.array([[0.0, 0.0, 1.0]]), comments={"operator": "Li"})
        >>> with TemporaryDirectory() as folder:
        ...     write_positions(Path(folder, "p.csv"), data)
        ...     print(Path(folder, "p.csv").read_text(), end="")
        # operator: Li
        position,alpha_deg,beta_deg,ax_g,ay_g,az_g
        a,0,0,0,0,1
    """
    path = Path(path)
    columns = data.columns
    if path.suffix == ".parquet":
        from tumblecal.data.parquet import metadata_of, put_checksum

        with written_aside(path) as aside:
            data.table().write_parquet(aside, metadata=metadata_of(data.comments))
            put_checksum(aside)
        return
    out = io.StringIO()
    for key, value in data.comments.items():
        out.write(f"# {key}: {one_line(value)}\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*([_cell(value) for value in values] for values in columns.values()), strict=True))
    write_text(path, out.getvalue())


def _cell(value: object) -> object:
    if isinstance(value, str):
        return as_text(value)
    return repr(int(value) if value.is_integer() else value) if isinstance(value, float) else value
