"""A table of positions with unconverted cells, and the standard names of its columns."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from tumblecal.data.cells import labels_in
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

    def place(self, row: int, column: str) -> str:
        """The name of a cell in messages."""
        return f"{self.source}:{self.row_word} {self.lines[row]}, column {column}"

    def with_points(self) -> "Table":
        """The table with decimal points. If it is not separated by commas, a comma in a number is decimal.

        **Raises:** `InputError` naming each number with a point in a table with decimal commas.
        """
        numbers = {name: cells for name, cells in self.columns.items() if name in KNOWN and name not in LABELS}
        written = ((name, row) for name, cells in numbers.items() for row in range(len(cells)))
        first = next((place for place in written if has_decimal_comma(numbers[place[0]][place[1]])), None)
        if self.separator == "," or first is None:
            return self
        name, row = first
        other = f"{numbers[name][row]!r} ({self.row_word} {self.lines[row]}, column {name}) has a decimal comma"
        faults, plain = Faults(self.source), dict[str, Sequence[object]]()
        for name, cells in numbers.items():
            for row, cell in enumerate(cells):
                if isinstance(cell, str) and "." in cell:
                    words = f"{cell!r} has a point, but {other}; use one decimal mark, and separate no thousands"
                    faults.add(words, f":{self.row_word} {self.lines[row]}", name)
            plain[name] = [pointed(cell) if isinstance(cell, str) else cell for cell in cells]
        faults.stop()
        return replace(self, columns={**self.columns, **plain})


def axis_columns(names: Iterable[str], kind: str = "") -> list[str]:
    """The columns of the three axes among these, for `kind` "" (readings) or "sd_"; empty if there are none."""
    return [name for axis in AXES for name in names if name in {f"a{axis}_{kind}{unit}" for unit in UNITS}]


def without_empty(table: Table) -> Table:
    """The table without empty optional columns; sd columns only if all are empty."""
    empty = {name for name, cells in table.columns.items() if len(cells) and not any(labels_in(cells))}
    sd = {name for name in table.columns if name in DEVIATIONS}
    removed = empty & {*LABELS[1:], *NUMERIC[2:]} | (sd if sd <= empty else set())
    return replace(table, columns={name: cells for name, cells in table.columns.items() if name not in removed})


def renamed(table: Table, names: Mapping[str, str], *, one_of_several: bool = False) -> Table:
    """The table with standard names of its columns.

    **Arguments:**

    - `names`: the name of each column in the file, by its standard name. Other unknown columns are ignored, and positions
      without a name are numbered.
    - `one_of_several`: whether the table may have standard names instead, such as a file of proposed positions in a batch.

    **Raises:** `InputError` for a column that the file does not have, or an unknown standard name.
    """
    if one_of_several and not {*names.values()} & {*table.columns} and {*names} <= {*table.columns}:
        return table
    faults = [
        f"--columns {name}=...: no such column; columns: {', '.join(KNOWN)}" for name in names if name not in KNOWN
    ]
    listed = shown(", ".join(table.columns))
    faults += [
        f"{table.source}: column {column} (--columns {name}={column}) is missing; its columns are {listed}"
        for name, column in names.items()
        if column not in table.columns
    ]
    first = {column: name for name, column in reversed(list(names.items()))}
    faults += [
        f"--columns {name}={column}: column {column} is {first[column]} already; name a different column for each quantity"
        for name, column in names.items()
        if first[column] != name
    ]
    if faults:
        raise InputError(faults)
    renamed_columns = set(names.values())
    columns = {name: cells for name, cells in table.columns.items() if name in KNOWN and name not in renamed_columns}
    columns |= {name: table.columns[column] for name, column in names.items()}
    columns.setdefault("position", [f"p{number + 1}" for number in range(len(table.lines))])
    ignored = tuple(name for name in table.columns if name and name not in KNOWN and name not in renamed_columns)
    return replace(table, columns=columns, ignored=ignored)


def likely_meant(name: str, among: Iterable[str], *, similarity: float = 0.7) -> str:
    """The most similar name to that of an unknown column, "" if none; `similarity` as by Ratcliff and Obershelp."""
    import difflib

    near = difflib.get_close_matches(name.strip().lower(), [*among], n=1, cutoff=similarity)
    return near[0] if near else ""
