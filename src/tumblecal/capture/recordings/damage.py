"""Damage of a recording: records of missing or changed rows, and of their repair.

| kind | meaning | usual action |
|---|---|---|
| `format` | the format shows that something is missing or unreadable | reported |
| `unsigned` | negative numbers written as unsigned ones | corrected |
| `overflow` | numbers that exceeded the range of their type and wrapped around | corrected |
| `erased` | rows of erased or empty memory: the clock and all readings stop | left out |
| `frozen` | readings that stop while the clock goes on | left out |
| `disorder` | rows that are not in the order of their clock | sorted, or left out if they have no place |
| `duplicates` | rows that occur twice | left out |
| `corrected` | the device has already corrected the readings for temperature | reported |
| `repeats` | each sample several times: the logger was faster than the sensor | one row of each sample retained |
"""

from dataclasses import asdict, dataclass, field, replace


@dataclass(frozen=True)
class DamageRecord:
    """One kind of damage.

    **Arguments:**

    - `kind`: as in the table above. `finding`: description; with `done`, the repair, one line.
    - `action`: `reported`, `corrected`, `sorted` or `left out`. `rows`: number of rows concerned; None if unknown.
    - `first_row`: the first of them, from 1, among the complete rows. `largest`, `unit`: its largest size, such as the
      correction in the numbers of the source or the delay in s.
    """

    kind: str
    finding: str
    done: str = ""
    action: str = "reported"
    rows: int | None = None
    first_row: int | None = None
    largest: float | None = None
    unit: str = ""

    @property
    def words(self) -> str:
        """The record as one line of text."""
        return f"{self.finding}: {self.done}" if self.done else self.finding

    def unrepaired(self) -> "DamageRecord":
        """The same record, with rows that do not change."""
        return replace(self, action="reported", done="the rows are not changed")

    def as_dict(self) -> dict[str, object]:
        """The record as keys and values of a file."""
        content = asdict(self)
        return {"kind": content.pop("kind"), "words": self.words} | {
            key: value for key, value in content.items() if key not in ("finding", "done")
        }


@dataclass
class Damage:
    """The damage of a recording in the order of discovery; filled while a source is read.

    Damage without any sound row is an `InputError` instead of a record.
    """

    records: list[DamageRecord] = field(default_factory=list)

    @property
    def lines(self) -> list[str]:
        """A line for each record."""
        return [record.words for record in self.records]

    def report(self, words: str) -> None:
        """Add damage that the format shows, once."""
        self.add(DamageRecord("format", words))

    def add(self, record: DamageRecord) -> None:
        """Add a record, once."""
        if record not in self.records:
            self.records.append(record)
