"""The document of `tumblecal import` for programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tumblecal.recordings.recording import Recording


def import_record(source: Path, out: Path, recording: Recording) -> dict[str, Any]:
    """A recording as plain numbers, lists and texts; what is not known is null.

    `{"schema": "tumblecal.import/1", "source", "output", "format", "tables": [{"name", "rows", "taken"}], "rows",
    "left_out": {"rows", "first"}, "rate_hz", "duration_s", "columns": {"ax": {"column", "unit", "why"}}, "accelerations":
    {"unit", "counts_per_g", "size"}, "guesses": [line], "gaps": {"count", "total_s", "first_s"}, "clock_back": {"count",
    "first_s"}, "temperature_degc": [low, high], "repeats": record or null, "damage": [record]}`; records as in
    `recordings.damage`.
    """
    layout, damage = recording.layout, recording.damage.as_dicts()
    ahead = [gap for gap in recording.gaps if gap[1] > 0]
    back = [gap for gap in recording.gaps if gap[1] < 0]
    rate, degc = recording.rate_hz, recording.temperature
    return {
        "schema": "tumblecal.import/1",
        "source": str(source),
        "output": str(out),
        "format": recording.reader.title,
        "tables": [{"name": one.name, "rows": one.rows, "taken": one is recording.table} for one in recording.tables],
        "rows": recording.rows,
        "left_out": recording.entries["left_out"],
        "rate_hz": rate,
        "duration_s": recording.rows / rate if rate else None,
        "columns": {
            role: {"column": column.name, "unit": column.unit or None, "why": column.evidence}
            for role, column in layout.columns.items()
        },
        "accelerations": {"unit": layout.unit, "counts_per_g": layout.per_g, "size": layout.size},
        "guesses": list(layout.notes),
        "gaps": {"count": len(ahead), "total_s": sum(length for _, length in ahead), "first_s": _first_s(ahead)},
        "clock_back": {"count": len(back), "first_s": _first_s(back)},
        "temperature_degc": list(degc[:2]) if degc else None,
        "repeats": next((record for record in damage if record["kind"] == "repeats"), None),
        "damage": damage,
    }


def _first_s(gaps: Sequence[tuple[float, float]]) -> float | None:
    return gaps[0][0] if gaps else None
