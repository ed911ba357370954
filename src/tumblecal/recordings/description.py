"""The description of a recording, `FILE.recording.toml`: what was stated or found, item by item, and where it comes from."""

import os
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tumblecal.data.column_names import RATE
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_json import validated
from tumblecal.ground.strict_toml import read_toml, toml_lines
from tumblecal.recordings.columns import TIME_S
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
    content = read_toml(path)
    if content.get("schema") != _SCHEMA or not isinstance(content.get("file"), str):
        raise InputError(f"{path}: needs schema = {_SCHEMA!r} and file = the recording; write it with tumblecal import")
    stated: dict[str, Any] = {key: value for key, value in content.items() if key not in ("schema", "file", "source")}
    if isinstance(stated.get("columns"), dict):
        stated["columns"] = ",".join(f"{role}={name}" for role, name in stated["columns"].items())
    read, usual = validated(stated, RecordingOptions, str(path)), asdict(RecordingOptions())
    given = {key: value for key, value in asdict(options).items() if value != usual[key]}
    return path.parent / content["file"], replace(read, **given)


def items_of(recording: "Recording") -> dict[str, tuple[object, object]]:
    """The options that state all that was found in a recording, and the source of each, in words."""
    layout, order = recording.layout, recording.table.columns
    names = {role: column.name for role, column in layout.columns.items()}
    names = {role: str(order.index(name) + 1) if {",", "="} & {*name} else name for role, name in names.items()}
    items: dict[str, tuple[object, object]] = {"columns": (names, {role: c.why for role, c in layout.columns.items()})}
    if recording.table.name:
        items["topic"] = recording.table.name, "accelerations and most rows"
    clock, force = layout.columns.get("time"), layout.columns["ax"]
    if unit := (f"{layout.per_g:g}/g" if layout.per_g else "") if layout.unit == "counts" else layout.unit:
        items["unit"] = AS_OPTION.get(unit, unit), force.unit_why or "file"
    for rate in [layout.columns[role] for role in RATE if role in layout.columns][:1]:
        if rate.unit in ("dps", "rads"):
            items["gyro_unit"] = AS_OPTION.get(rate.unit, rate.unit), rate.unit_why or "file"
    if clock and not clock.form and not clock.whole:
        for unit in [unit for unit, scale in TIME_S.items() if scale == clock.scale]:
            items["time_unit"] = unit, clock.unit_why or "file"
    if recording.rate_hz and not clock:
        items["rate"] = recording.rate_hz, "file"
    given = {name: value for name, value in asdict(recording.options).items() if value and name != "columns"}
    return items | {name: (value, "option") for name, value in given.items()}


def write_description(recording: "Recording", path: Path) -> None:
    """Write the description of a recording."""
    items = items_of(recording)
    content: dict[str, object] = {"schema": _SCHEMA, "file": os.path.relpath(recording.path, path.parent)}
    content |= {name: value for name, (value, _) in items.items()}
    content["source"] = {name: why for name, (_, why) in items.items()}
    write_text(path, "\n".join(toml_lines(content)) + "\n")
