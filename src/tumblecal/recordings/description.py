"""The description of a recording, `FILE.recording.toml`: what was stated or found, item by item, and where it comes from."""

import json
import os
import tomllib
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tumblecal.data.column_names import RATE
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.units import AS_OPTION


if TYPE_CHECKING:
    from tumblecal.recordings.recording import Recording

SUFFIX, _SCHEMA = ".recording.toml", "tumblecal.recording/1"


def described(path: Path, options: RecordingOptions) -> tuple[Path, RecordingOptions]:
    """The recording and its options of a description; any other path unchanged. Given options replace those of the description.

    **Raises:** `InputError` for a description that cannot be read, or has an unknown key.
    """
    if not path.name.endswith(SUFFIX):
        return path, options
    try:
        content = tomllib.loads(path.read_text())
    except (OSError, UnicodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(
            f"{path}: not a description of a recording ({error}); write it with tumblecal import"
        ) from error
    if content.get("schema") != _SCHEMA or not isinstance(content.get("file"), str):
        raise InputError(f"{path}: needs schema = {_SCHEMA!r} and file = the recording; write it with tumblecal import")
    known = {field.name: field for field in fields(RecordingOptions)}
    stated: dict[str, Any] = {key: value for key, value in content.items() if key not in ("schema", "file", "source")}
    if isinstance(stated.get("columns"), dict):
        stated["columns"] = ",".join(f"{role}={name}" for role, name in stated["columns"].items())
    for key, value in stated.items():
        kind = int if key == "signed" else (int, float) if key in ("rate", "range_g") else str
        if key not in known or not isinstance(value, kind) or isinstance(value, bool):
            raise InputError(f"{path}: key {key}: unknown, or not of its type; keys: {', '.join(known)}")
    given = {key: value for key, value in asdict(options).items() if value != known[key].default}
    return path.parent / content["file"], replace(RecordingOptions(), **{**stated, **given})


def items_of(recording: "Recording") -> dict[str, tuple[object, object]]:
    """The options that state all that was found in a recording, and the source of each, in words."""
    layout, options = recording.layout, recording.options
    order = recording.table.columns
    columns = {
        role: str(order.index(column.name) + 1) if {",", "="} & {*column.name} else column.name
        for role, column in layout.columns.items()
    }
    items: dict[str, tuple[object, object]] = {
        "columns": (columns, {role: column.why for role, column in layout.columns.items()})
    }
    if recording.table.name:
        items["topic"] = recording.table.name, "accelerations and most rows"
    unit = layout.unit if layout.unit != "counts" else f"{layout.per_g:g}/g" if layout.per_g else ""
    if unit:
        by_size = layout.columns["ax"].why.endswith("size")
        items["unit"] = AS_OPTION.get(unit, unit), "the size of gravity" if by_size else "file"
    rates = {layout.columns[role].unit for role in RATE if role in layout.columns} & {"dps", "rads"}
    if rates:
        unit = rates.pop()
        items["gyro_unit"] = AS_OPTION.get(unit, unit), "file"
    clock = layout.columns.get("time")
    if clock and not clock.form and not clock.whole:
        by = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns"}
        if clock.scale in by:
            by_rate = any("time unit guessed" in note for note in layout.notes)
            items["time_unit"] = by[clock.scale], "the rate that it gives" if by_rate else "file"
    elif recording.rate_hz and not clock:
        items["rate"] = recording.rate_hz, "file"
    for name, value in asdict(options).items():
        if value and name != "columns":
            items[name] = value, "option"
    return items


def write_description(recording: "Recording", path: Path) -> None:
    """Write the description of a recording."""
    items = items_of(recording)
    there = os.path.relpath(recording.path, path.parent)
    lines = [f"schema = {_text(_SCHEMA)}", f"file = {_text(there)}"]
    lines += [f"{name} = {_text(value)}" for name, (value, _) in items.items()]
    lines += ["", "[source]", *(f"{name} = {_text(why)}" for name, (_, why) in items.items())]
    write_text(path, "\n".join(lines) + "\n")


def _text(value: object) -> str:
    """A value of TOML: a number, a text, or a table in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{role} = {_text(text)}" for role, text in value.items()) + "}"
    return json.dumps(value, ensure_ascii=False)
