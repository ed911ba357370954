"""Messages of `tumblecal import` and `tumblecal reduce` about a recording, a line each, and the document of an import."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from tumblecal.data.column_names import FORCE
from tumblecal.ground.counted import counted, shortened
from tumblecal.ground.gravity import unit_in_g


if TYPE_CHECKING:
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples
    from tumblecal.recordings.recording import Recording
    from tumblecal.recordings.still.stillness import Stillness


# Units as people write them.
UNITS = {"ms2": "m/s^2", "dps": "deg/s", "rads": "rad/s"} | {unit: unit for unit in ("g", "mg", "counts")}
_MOST, _MOST_NAMES = 12, 8
_SIZE = ", size about "


def temperature_words(recording: "Recording") -> Iterator[str]:
    """The range of the temperature, if there is one."""
    if found := recording.temperature:
        low, high, lacking = found
        without = f", none in {counted(lacking, recording.table.row_word)}" if lacking else ""
        yield f"temperature {low:.2f} to {high:.2f} degC{without}"


def recording_words(recording: "Recording") -> Iterator[str]:
    """The layout of a recording, its rate, the rows that are left out, and its temperature."""
    yield from layout_words(recording)
    yield from rate_words(recording)
    yield from left_out_words(recording)
    yield from temperature_words(recording)


def layout_words(recording: "Recording") -> Iterator[str]:
    """The columns of a recording, with the assumptions about them."""
    layout = recording.layout
    yield from format_words(recording, tables=False)
    columns = (f"{role}={column.name}" for role, column in layout.columns.items())
    yield f"columns: {', '.join(columns)}"
    per_g = f" ({layout.per_g:g} a g)" if layout.per_g else ""
    yield f"accelerations in {UNITS[layout.unit]}{per_g}{_SIZE}{layout.size:.5g}"
    yield from layout.notes


def layouts_words(read: Sequence["Recording"]) -> Iterator[str]:
    """The layout of several recordings: that of the first, then the lines in which others differ, except the mean size."""
    of_all = list(layout_words(read[0]))
    yield from of_all
    known = {line.partition(_SIZE)[0] for line in of_all}
    for one in read[1:]:
        yield from (f"{one.path}: {line}" for line in layout_words(one) if line.partition(_SIZE)[0] not in known)


def grouped_lines(lines: Sequence[str]) -> Iterator[str]:
    """Lines `NAME: words`, those with equal words as one line with all their names."""
    names: dict[str, list[str]] = {}
    for line in lines:
        name, _, words = line.partition(": ")
        names.setdefault(words, []).append(name)
    yield from (f"{shortened(each, _MOST_NAMES)}: {words}" for words, each in names.items())


def format_words(recording: "Recording", *, tables: bool) -> Iterator[str]:
    """The format of a recording and its tables, if it has several."""
    table = recording.table
    yield f"{recording.reader.title}{f': {table.words}' if table.words else ''}"
    if tables and len(recording.tables) > 1:
        for each in recording.tables:
            rows = "" if each.rows is None else f", {counted(each.rows, each.row_word)}"
            yield f"  {'*' if each is table else ' '} {each.name}{f' ({each.words})' if each.words else ''}{rows}"


def left_out_words(recording: "Recording") -> Iterator[str]:
    """Number of rows without a complete reading, and the first of them; nothing if there are none."""
    if recording.unread.rows:
        places = [
            *map(str, recording.unread.places),
            *(["..."] if recording.unread.rows > len(recording.unread.places) else []),
        ]
        left_out = counted(recording.unread.rows, recording.table.row_word)
        yield f"{left_out} left out, without a whole reading: {', '.join(places)}"


def rate_words(recording: "Recording") -> Iterator[str]:
    """Number of samples, their rate, and missing samples."""
    rate = recording.rate_hz
    yield counted(recording.rows, "sample") + (
        f" at {rate:.6g} Hz, {recording.rows / rate:.1f} s" if rate else ", rate not known (--rate)"
    )
    if recording.mixed_rates:
        low, high = recording.mixed_rates
        yield f"the rate changes between {low:.4g} and {high:.4g} Hz; the sd of means use the average"
    if recording.missing:
        yield f"{counted(recording.missing, 'sample')} missing according to the clock"
    if recording.equal_times:
        yield f"{counted(recording.equal_times, 'sample')} with the time of the previous one"
    ahead, back = _gaps(recording)
    if back:
        yield f"the clock jumps back {counted(len(back), 'time')}, first at {back[0][0]:.2f} s; no interval goes across"
    if ahead:
        total = sum(gap[1] for gap in ahead)
        yield f"{counted(len(ahead), 'gap')}, {total:.1f} s in all, first at {ahead[0][0]:.2f} s; no interval goes across"


def _gaps(recording: "Recording") -> tuple[list, list]:
    """Gaps (time, duration) of the clock, and its jumps back."""
    return [gap for gap in recording.gaps if gap[1] > 0], [gap for gap in recording.gaps if gap[1] < 0]


def interval_words(stillness: "Stillness") -> Iterator[str]:
    """Number of still intervals, and the reasons why others are rejected."""
    c = stillness.criterion
    yield (
        f"{counted(len(stillness.used), 'still interval')} (probability of rejecting a still second {c.false_alarm:g} per "
        f"axis; at least {c.least_s:g} s, {c.guard_s:g} s excluded next to movement)"
    )
    if stillness.joins:
        follow = "interval follows the one" if stillness.joins == 1 else "intervals follow the ones"
        yield f"{stillness.joins} {follow} before without movement between: joined recordings, or an interrupted logger"
    if stillness.coarse:
        steps_mg = 1e3 * max(stillness.coarse.values()) * unit_in_g(stillness.blocks.unit, None)
        axes = "axis" if len(stillness.coarse) == 1 else "axes"
        yield (
            f"{axes} {', '.join(stillness.coarse)}: readings in steps of {steps_mg:.3g} mg, wider than the noise: a mean "
            "may be in error by half a step"
        )
    if stillness.used and not stillness.size_judged:
        yield "sizes of the intervals are not tested: too few orientations for a rough bias and scale of each axis"
    rejected = [interval for interval in stillness.intervals if interval.reason]
    for interval in rejected[:_MOST]:
        yield f"rejected: {interval.start_s:.1f} to {interval.stop_s:.1f} s: {interval.reason}"
    if len(rejected) > _MOST:
        yield f"and {len(rejected) - _MOST} more (reduction.json)"


def reduction_words(dwells: "DwellSamples") -> Iterator[str]:
    """The recordings, their intervals at rest, and how the positions were found."""
    read = dwells.read
    if len(read) == 1:
        yield from recording_words(read[0]) if dwells.force else layout_words(read[0])
    elif read:
        yield from layouts_words(read)
        for one in read:
            yield from (f"{one.path}: {line}" for line in (*left_out_words(one), *list(rate_words(one))[1:]))
        rows = sum(one.rows for one in read)
        yield f"{counted(rows, 'sample')} of {counted(len(read), 'file')} at {dwells.rate_hz:.6g} Hz"
    if dwells.stillness is not None:
        yield from interval_words(dwells.stillness)
        if dwells.stillness.one_attitude:
            yield "all still intervals have one orientation: they determine the noise, but no calibration"
    elif len(read) > 1:
        yield "positions from the columns of the files"
    yield from dwells.lines


SCHEMA = "tumblecal.import/1"
_REPEATS = "repeats"
_RATE_BY = {True: "from the times, without gaps", False: "asked for, or stated in the file"}


def import_document(source: Path, out: Path, recording: "Recording") -> dict[str, object]:
    """The document of `tumblecal import` for programs; what is not known is null.

    `{"schema": "tumblecal.import/1", "source", "output", "format", "tables": [{"name", "rows", "taken"}], "rows",
    "left_out": {"rows", "first"}, "rate_hz", "duration_s", "columns": {"ax": {"column", "unit", "why"}}, "accelerations":
    {"unit", "counts_per_g", "size"}, "guesses": [line], "gaps": {"count", "total_s", "first_s"}, "clock_back": {"count",
    "first_s"}, "temperature_degc": [low, high], "repeats": record or null, "damage": [record]}`; records as in
    `recordings.damage`.
    """
    layout, damage = recording.layout, recording.damage.records
    ahead, back = _gaps(recording)
    rate, degc = recording.rate_hz, recording.temperature
    return {
        "schema": SCHEMA,
        "source": str(source),
        "output": str(out),
        "format": recording.reader.title,
        "tables": [{"name": one.name, "rows": one.rows, "taken": one is recording.table} for one in recording.tables],
        "rows": recording.rows,
        "left_out": {"rows": recording.unread.rows, "first": recording.unread.places},
        "rate_hz": rate,
        "duration_s": recording.rows / rate if rate else None,
        "columns": {
            role: {"column": column.name, "unit": column.unit or None, "why": column.evidence}
            for role, column in layout.columns.items()
        },
        "accelerations": {"unit": layout.unit, "counts_per_g": layout.per_g, "size": layout.size},
        "guesses": list(layout.notes),
        "gaps": {
            "count": len(ahead),
            "total_s": sum(gap[1] for gap in ahead),
            "first_s": ahead[0][0] if ahead else None,
        },
        "clock_back": {"count": len(back), "first_s": back[0][0] if back else None},
        "temperature_degc": list(degc[:2]) if degc else None,
        "repeats": next((asdict(record) for record in damage if record.kind == _REPEATS), None),
        "damage": [asdict(record) for record in damage],
    }


def import_lines(recording: "Recording") -> list[str]:
    """The table for people: what was found, and by what evidence; below it the guesses, with the options that override them."""
    layout, damage = recording.layout, recording.damage.records
    first, *clock = rate_words(recording)
    per_g = f" ({layout.per_g:g} a g)" if layout.per_g else ""
    rows: list[tuple[str, str, str, str]] = [
        ("item", "found", "unit", "evidence"),
        ("rows", counted(recording.rows, "sample"), "", next(left_out_words(recording), "none left out")),
        ("rate", first.partition(" at ")[2] or "not known (--rate)", "", _RATE_BY["time" in layout.columns]),
    ]
    for role, column in layout.columns.items():
        unit = UNITS.get(column.unit, column.unit) + (per_g if role in FORCE else "")
        rows.append((role, column.name, unit, column.evidence))
    rows.append(("size", f"about {layout.size:.5g}", UNITS[layout.unit], "of gravity in ax, ay, az"))
    repeats = [record.words for record in damage if record.kind == _REPEATS]
    others = [record.words for record in damage if record.kind != _REPEATS]
    rest = {"gaps": clock, "repeats": repeats, "damage": others, "temperature": list(temperature_words(recording))}
    if not rest["temperature"]:
        del rest["temperature"]
    wide = [max(len(row[k]) for row in [*rows, *((name, "", "") for name in rest)]) for k in range(3)]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(row, (*wide, 0), strict=True)).rstrip() for row in rows]
    table += [f"{name:{wide[0]}}  {words}" for name, lines in rest.items() for words in lines or ["none"]]
    return [*format_words(recording, tables=True), *table, *layout.notes]
