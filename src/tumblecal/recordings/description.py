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
from tumblecal.recordings.clock import TIME_S
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
    numbers = {"signed": int, "rate": (int, float), "range_g": (int, float)}
    for key, value in stated.items():
        if key not in known or not isinstance(value, numbers.get(key, str)) or isinstance(value, bool):
            raise InputError(f"{path}: key {key}: unknown, or not of its type; keys: {', '.join(known)}")
    given = {key: value for key, value in asdict(options).items() if value != known[key].default}
    return path.parent / content["file"], replace(RecordingOptions(), **{**stated, **given})


def items_of(recording: "Recording") -> dict[str, tuple[object, object]]:
    """The options that state all that was found in a recording, and the source of each, in words."""
    layout, order = recording.layout, recording.table.columns
    columns = {
        role: str(order.index(column.name) + 1) if {",", "="} & {*column.name} else column.name
        for role, column in layout.columns.items()
    }
    items: dict[str, tuple[object, object]] = {
        "columns": (columns, {role: c.why for role, c in layout.columns.items()})
    }
    if recording.table.name:
        items["topic"] = recording.table.name, "accelerations and most rows"
    clock = layout.columns.get("time")
    in_counts = f"{layout.per_g:g}/g" if layout.per_g else ""
    units = {"unit": ("ax", in_counts if layout.unit == "counts" else layout.unit)}
    if rates := [role for role in RATE if role in layout.columns and layout.columns[role].unit in ("dps", "rads")]:
        units["gyro_unit"] = rates[0], layout.columns[rates[0]].unit
    if clock and not clock.form and not clock.whole:
        units["time_unit"] = (
            "time",
            {scale: unit for unit, scale in TIME_S.items()}.get(clock.scale, ""),
        )
    for name, (role, unit) in units.items():
        if unit:
            items[name] = AS_OPTION.get(unit, unit), layout.columns[role].unit_why or "file"
    if recording.rate_hz and not clock:
        items["rate"] = recording.rate_hz, "file"
    given = {name: value for name, value in asdict(recording.options).items() if value and name != "columns"}
    return items | {name: (value, "option") for name, value in given.items()}


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
