"""What `tumblecal import` found in a recording: one table for people, one document for programs.

`{"schema": "tumblecal.import/1", "source", "output", "format", "tables": [{"name", "rows", "taken"}], "rows",
"left_out": {"rows", "first"}, "rate_hz", "duration_s", "columns": {"ax": {"column", "unit", "why"}}, "accelerations":
{"unit", "counts_per_g", "size"}, "guesses": [line], "gaps": {"count", "total_s", "first_s"}, "clock_back": {"count",
"first_s"}, "temperature_degc": [low, high], "repeats": record or null, "damage": [record]}`; records as in
`capture.recordings.damage`, what is not known is null.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tumblecal.capture.columns.units import FORCE
from tumblecal.ground.counted import counted
from tumblecal.report.recording_words import UNITS, format_words, left_out_words, rate_words, temperature_words


if TYPE_CHECKING:
    from tumblecal.capture.rows.contents import Contents

SCHEMA = "tumblecal.import/1"
_REPEATS = "repeats"
_RATE_BY = {True: "from the times, without gaps", False: "asked for, or stated in the file"}


def import_document(source: Path, out: Path, contents: "Contents") -> dict[str, object]:
    """The document for programs."""
    layout, damage = contents.layout, contents.damage.records
    ahead, back = ([gap for gap in contents.gaps if (gap[1] > 0) is forwards] for forwards in (True, False))
    rate, (low, high) = contents.rate_hz, contents.temperature
    return {
        "schema": SCHEMA,
        "source": str(source),
        "output": str(out),
        "format": contents.reader.title,
        "tables": [
            {"name": table.name, "rows": table.rows, "taken": table is layout.table} for table in contents.tables
        ],
        "rows": contents.rows,
        "left_out": {"rows": contents.unreadable, "first": contents.places},
        "rate_hz": rate,
        "duration_s": contents.rows / rate if rate else None,
        "columns": {
            role: {"column": column.name, "unit": column.unit or None, "why": layout.why[role]}
            for role, column in layout.columns.items()
        },
        "accelerations": {"unit": layout.unit, "counts_per_g": layout.per_g, "size": layout.size},
        "guesses": list(layout.guesses),
        "gaps": {
            "count": len(ahead),
            "total_s": sum(gap[1] for gap in ahead),
            "first_s": ahead[0][0] if ahead else None,
        },
        "clock_back": {"count": len(back), "first_s": back[0][0] if back else None},
        "temperature_degc": [low, high] if np.isfinite([low, high]).all() and low <= high else None,
        "repeats": next((record.as_dict() for record in damage if record.kind == _REPEATS), None),
        "damage": [record.as_dict() for record in damage],
    }


def import_lines(contents: "Contents") -> list[str]:
    """The table for people: what was found, and by what evidence; below it the guesses, with the options that override them."""
    layout, damage = contents.layout, contents.damage.records
    first, *clock = rate_words(contents)
    per_g = f" ({layout.per_g:g} a g)" if layout.per_g else ""
    rows: list[tuple[str, str, str, str]] = [
        ("item", "found", "unit", "evidence"),
        ("rows", counted(contents.rows, "sample"), "", next(left_out_words(contents), "none left out")),
        ("rate", first.partition(" at ")[2] or "not known (--rate)", "", _RATE_BY["time" in layout.columns]),
    ]
    for role, column in layout.columns.items():
        unit = UNITS.get(column.unit, column.unit) + (per_g if role in FORCE else "")
        rows.append((role, column.name, unit, layout.why[role]))
    rows.append(("size", f"about {layout.size:.5g}", UNITS[layout.unit], "of gravity in ax, ay, az"))
    repeats = [record.words for record in damage if record.kind == _REPEATS]
    others = [record.words for record in damage if record.kind != _REPEATS]
    low, high = contents.temperature
    rest = {"gaps": clock, "repeats": repeats, "damage": others, "temperature": list(temperature_words(contents))}
    if low > high:
        del rest["temperature"]
    wide = [max(len(row[k]) for row in [*rows, *((name, "", "") for name in rest)]) for k in range(3)]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(row, (*wide, 0), strict=True)).rstrip() for row in rows]
    table += [f"{name:{wide[0]}}  {words}" for name, lines in rest.items() for words in lines or ["none"]]
    return [*format_words(contents, tables=True), *table, *layout.guesses]
