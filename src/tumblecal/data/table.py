"""A table of positions with unconverted cells, and the standard names of its columns."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from tumblecal.data.faults import Faults
from tumblecal.ground.axes import AXES
from tumblecal.ground.decimal_marks import has_decimal_comma, pointed
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS
from tumblecal.ground.text_file import shown


NUMERIC = ("alpha_deg", "beta_deg", "time_s", "temperature_degc", "approach", "n")
# Label of the clock of a row, if the time between the files of a recording is unknown.
TIME_CLOCK = "time_clock"
LABELS = ("position", "run", "mount", TIME_CLOCK)
READINGS = tuple(f"a{axis}_{unit}" for axis in AXES for unit in UNITS)
DEVIATIONS = tuple(f"a{axis}_sd_{unit}" for axis in AXES for unit in UNITS)
# Fault of three axes with different units.
DIFFERENT_UNITS = "are in different units; give the three axes in one unit"
KNOWN = (*LABELS, *NUMERIC, *READINGS, *DEVIATIONS)


@dataclass(frozen=True)
class Table:
    """Columns of a file: unconverted cells, and the line of each row. `ignored`: names of columns that are not used."""

    source: str
    columns: Mapping[str, Sequence[object]]
    lines: Sequence[int]
    comments: dict[str, str]
    header_line: int = 1
    row_word: str = "line"
    separator: str = ","
    ignored: tuple[str, ...] = ()

    def line_of(self, row: int) -> str:
        """The place of a row in faults."""
        return f":{self.row_word} {self.lines[row]}"

    def place(self, row: int, column: str) -> str:
        """The name of a cell in messages."""
        return f"{self.source}{self.line_of(row)}, column {column}"

    def with_points(self) -> "Table":
        """The table with decimal points. If it is not separated by commas, a comma in a number is decimal.

        **Raises:** `InputError` naming each number with a point in a table with decimal commas.
        """
        numbers = {name: cells for name, cells in self.columns.items() if name in KNOWN and name not in LABELS}
        texts = [(n, row, cell) for n, cells in numbers.items() for row, cell in enumerate(cells) if type(cell) is str]
        first = next((cell for cell in texts if has_decimal_comma(cell[2])), None)
        if self.separator == "," or first is None:
            return self
        name, row, cell = first
        other = f"{cell!r} ({self.line_of(row)[1:]}, column {name}) has a decimal comma"
        faults = Faults(self.source)
        for name, row, cell in texts:
            if "." in cell:
                words = f"{cell!r} has a point, but {other}; use one decimal mark, and separate no thousands"
                faults.add(words, self.line_of(row), name)
        faults.stop()
        plain = {name: [pointed(str(cell)) for cell in cells] for name, cells in numbers.items()}
        return replace(self, columns={**self.columns, **plain})


def axis_columns(names: Iterable[str], kind: str = "") -> list[str]:
    """The columns of the three axes among these, for `kind` "" (readings) or "sd_"; empty if there are none."""
    return [name for axis in AXES for name in names if name in {f"a{axis}_{kind}{unit}" for unit in UNITS}]


def renamed(table: Table, names: Mapping[str, str], *, one_of_several: bool = False) -> Table:
    """The table with standard names of its columns.

    **Arguments:**

    - `names`: the name of each column in the file, by its standard name. Other unknown columns are ignored, and positions
      without a name are numbered.
    - `one_of_several`: whether the table may have standard names instead, such as a file of proposed positions in a batch.

    **Raises:** `InputError` for a column that the file does not have, or an unknown standard name.
    """
    used = [*names.values()]
    if one_of_several and not {*used} & {*table.columns} and {*names} <= {*table.columns}:
        return table
    faults = list[str]()
    for name, column in names.items():
        if name not in KNOWN:
            faults.append(f"--columns {name}=...: no such column; columns: {', '.join(KNOWN)}")
        if column not in table.columns:
            missing = f"column {column} (--columns {name}={column}) is missing; its columns are"
            faults.append(f"{table.source}: {missing} {shown(', '.join(table.columns))}")
        if used.count(column) > 1 and name != [*names][used.index(column)]:
            first = f"column {column} is {[*names][used.index(column)]} already"
            faults.append(f"--columns {name}={column}: {first}; name a different column for each quantity")
    if faults:
        raise InputError(faults)
    others = {name: cells for name, cells in table.columns.items() if name not in used}
    columns: dict[str, Sequence[object]] = {"position": [f"p{row + 1}" for row in range(len(table.lines))]}
    columns |= {name: cells for name, cells in others.items() if name in KNOWN}
    columns |= {name: table.columns[column] for name, column in names.items()}
    ignored = tuple(name for name in others if name and name not in KNOWN)
    return replace(table, columns=columns, ignored=ignored)


def likely_meant(name: str, among: Iterable[str], *, similarity: float = 0.7) -> str:
    """The most similar name to that of an unknown column, "" if none; `similarity` as by Ratcliff and Obershelp."""
    import difflib

    near = difflib.get_close_matches(name.strip().lower(), [*among], n=1, cutoff=similarity)
    return near[0] if near else ""
