"""A table of positions as it stands in a file, and the names that its columns have."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from tumblecal.data.cells import labels_in
from tumblecal.data.faults import Faults
from tumblecal.ground.axes import AXES
from tumblecal.ground.decimal_marks import MarkedColumns
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import UNITS
from tumblecal.ground.text_file import shown


NUMERIC = ("alpha_deg", "beta_deg", "time_s", "temperature_degc", "approach", "n")
# The clock by which a row's time counts, where the time from one file of a recording to the next is not known.
TIME_CLOCK = "time_clock"
LABELS = ("position", "run", "mount", TIME_CLOCK)
READINGS = tuple(f"a{axis}_{unit}" for axis in AXES for unit in UNITS)
DEVIATIONS = tuple(f"a{axis}_sd_{unit}" for axis in AXES for unit in UNITS)
# What is wrong with axes of which each has a unit of its own, wherever they are read.
DIFFERENT_UNITS = "are in different units; give the three axes in one unit"
# Cells of columns that reach a thousand, as patterns: 100 g are no reading.
THOUSANDS = {"time_s": ".*", "n": ".*", **dict.fromkeys(("ax_mg", "ay_mg", "az_mg"), r"[+-]?[1-9]\d?[.,]\d{3}")}
KNOWN = (*LABELS, *NUMERIC, *READINGS, *DEVIATIONS)


@dataclass(frozen=True)
class Table:
    """Columns as they are in a file: cells of text or numbers, and the line of each row. `ignored` are the names of those
    that nothing needs."""

    source: str
    columns: Mapping[str, Sequence[object]]
    lines: Sequence[int]
    comments: dict[str, str]
    header_line: int = 1
    row_word: str = "line"
    separator: str = ","
    ignored: tuple[str, ...] = ()

    def place(self, row: int, column: str) -> str:
        """A cell as faults name it."""
        return f"{self.source}:{self.row_word} {self.lines[row]}, column {column}"

    def marked(self, names: Iterable[str]) -> MarkedColumns:
        """Columns of numbers, whose decimal mark is sought."""
        return MarkedColumns(
            {name: self.columns[name] for name in names},
            THOUSANDS,
            self.source,
            lambda row, name: f"{self.row_word} {self.lines[row]}, column {name}",
        )

    def with_points(self) -> "Table":
        """The table with decimal points in its numbers and nothing between thousands, as between commas they are anyway.

        **Raises:** `InputError` naming two cells with different marks, or each cell whose mark may be either.
        """
        if self.separator == ",":
            return self
        faults = Faults(self.source)
        plain = self.marked(name for name in self.columns if name in KNOWN and name not in LABELS).with_points(
            lambda row, name, words: faults.add(words, f":{self.row_word} {self.lines[row]}", name)
        )
        faults.stop()
        return replace(self, columns={**self.columns, **plain})


def axis_columns(names: Iterable[str], kind: str = "") -> list[str]:
    """The columns of the three axes among these, for `kind` "" (readings) or "sd_"; empty when there are none."""
    return [name for axis in AXES for name in names if name in {f"a{axis}_{kind}{unit}" for unit in UNITS}]


def without_empty(table: Table) -> Table:
    """The table without the columns that need not be there and are empty throughout; of sd columns all or none."""
    empty = {name for name, cells in table.columns.items() if len(cells) and not any(labels_in(cells))}
    sd = {name for name in table.columns if name in DEVIATIONS}
    left = empty & {*LABELS[1:], *NUMERIC[2:]} | (sd if sd <= empty else set())
    return replace(table, columns={name: cells for name, cells in table.columns.items() if name not in left})


def renamed(table: Table, names: Mapping[str, str], *, one_of_several: bool = False) -> Table:
    """The table under the names that columns have here.

    **Arguments:**

    - `names`: the file's own name of each column, by what it is. Columns that are neither named nor known are left out;
      positions without a name are numbered.
    - `one_of_several`: with files that have those names, one may have the names of here instead, such as the positions that
      were proposed next.

    **Raises:** `InputError` for a column that the file lacks, or a name that no column has here.
    """
    if one_of_several and not {*names.values()} & {*table.columns} and {*names} <= {*table.columns}:
        return table
    faults = [
        f"--columns {name}=...: no such column; there are {', '.join(KNOWN)}" for name in names if name not in KNOWN
    ]
    there = shown(", ".join(table.columns))
    faults += [
        f"{table.source}: column {own} (--columns {name}={own}) is missing; it has {there}"
        for name, own in names.items()
        if own not in table.columns
    ]
    first = {own: name for name, own in reversed(list(names.items()))}
    faults += [
        f"--columns {name}={own}: column {own} is {first[own]} already; name another column for each quantity"
        for name, own in names.items()
        if first[own] != name
    ]
    if faults:
        raise InputError(faults)
    taken = set(names.values())
    columns = {name: cells for name, cells in table.columns.items() if name in KNOWN and name not in taken}
    columns |= {name: table.columns[own] for name, own in names.items()}
    columns.setdefault("position", [f"p{number + 1}" for number in range(len(table.lines))])
    ignored = tuple(name for name in table.columns if name and name not in KNOWN and name not in taken)
    return replace(table, columns=columns, ignored=ignored)


def likely_meant(name: str, among: Iterable[str], *, similarity: float = 0.7) -> str:
    """The name that an unknown column resembles most, "" where none: so much of both (Ratcliff and Obershelp) is the same."""
    import difflib

    near = difflib.get_close_matches(name.strip().lower(), [*among], n=1, cutoff=similarity)
    return near[0] if near else ""
