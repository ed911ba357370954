"""The document of `tumblecal import` for programs; what is not known is null."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from tumblecal.ground.record import ResultRecord, TextOrNull, at
from tumblecal.recordings.damage import DamageRecord
from tumblecal.recordings.recording import Recording
from tumblecal.recordings.rows import Unread


class TableRecord(ResultRecord):
    """A table of the source; `taken`: whether it was read."""

    name: str
    rows: int | None
    taken: bool


class ColumnRecord(ResultRecord):
    """The column of a quantity, and the evidence for it."""

    column: str = at("name")
    unit: TextOrNull
    why: str = at("evidence")


class AccelerationsRecord(ResultRecord):
    """Unit of the readings, counts for one g, and size of gravity in the readings."""

    unit: str
    counts_per_g: float | None = at("per_g")
    size: float


class StepsRecord(ResultRecord):
    """Steps of the clock: their number, and the time of the first."""

    count: int
    first_s: float | None


class GapsRecord(StepsRecord):
    """Gaps, and their total length."""

    total_s: float


class ImportRecord(ResultRecord):
    """A `Recording`; `repeats`: the damage of this kind."""

    schema_: Literal["tumblecal.import/1"] = "tumblecal.import/1"
    source: str
    output: str
    format: str = at("reader.title")
    tables: list[TableRecord]
    rows: int
    left_out: Unread = at("unread")
    rate_hz: float | None
    duration_s: float | None
    columns: dict[str, ColumnRecord] = at("layout.columns")
    accelerations: AccelerationsRecord = at("layout")
    guesses: list[str] = at("layout.notes")
    gaps: GapsRecord
    clock_back: StepsRecord
    temperature_degc: tuple[float, float] | None
    repeats: DamageRecord | None
    damage: list[DamageRecord] = at("damage.records")


def import_record(source: Path, out: Path, recording: Recording) -> ImportRecord:
    """A recording that was read from `source` and written as `out`."""
    ahead = [gap for gap in recording.gaps if gap[1] > 0]
    back = [gap for gap in recording.gaps if gap[1] < 0]
    rate, degc = recording.rate_hz, recording.temperature
    return ImportRecord.of(
        recording,
        source=str(source),
        output=str(out),
        tables=[TableRecord.of(one, taken=one is recording.table) for one in recording.tables],
        duration_s=recording.rows / rate if rate else None,
        gaps=GapsRecord(count=len(ahead), total_s=sum(length for _, length in ahead), first_s=_first_s(ahead)),
        clock_back=StepsRecord(count=len(back), first_s=_first_s(back)),
        temperature_degc=degc and degc[:2],
        repeats=next((one for one in recording.damage.records if one.kind == "repeats"), None),
    )


def _first_s(gaps: Sequence[tuple[float, float]]) -> float | None:
    return gaps[0][0] if gaps else None
