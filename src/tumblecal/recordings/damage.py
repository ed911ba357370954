"""Damage of a recording: rows that are missing, left out or suspicious.

| kind | meaning | action |
|---|---|---|
| `format` | the format shows that something is missing or unreadable | reported |
| `impossible` | readings of more than a thousand times the size of gravity | left out |
| `erased` | rows of erased or empty memory: one number on all axes | left out |
| `disorder` | rows that are earlier than the row before | left out |
| `duplicates` | rows that occur twice | left out |
| `repeats` | each sample several times: the logger was faster than the sensor | one row of each sample retained |
| `corrected` | the device has already corrected the readings for temperature | reported |
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class DamageRecord:
    """One kind of damage.

    **Arguments:**

    - `kind`: as in the table above. `words`: finding and action, one line. `action`: `reported` or `left out`.
    - `rows`: number of rows concerned; None if unknown. `first_row`: the first of them, from 1, among the complete rows.
    - `largest`, `unit`: the largest size of the damage, such as the rows that repeat a sample.
    """

    kind: str
    words: str
    action: str = "reported"
    rows: int | None = None
    first_row: int | None = None
    largest: float | None = None
    unit: str = ""


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
