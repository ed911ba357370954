"""JSON and CSV: the unconverted numbers, for user programs."""

import csv
import io
import json
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_table import COLUMNS, calibration_table
from tumblecal.data.calibration_terms import Terms
from tumblecal.data.temperature_curves_file import StatedTemperature
from tumblecal.devices.over_temperature import in_table, of_numbers, of_table
from tumblecal.devices.target import LINEAR, TEMPERATURE, Export, Target, number
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import json_text, require_plain, without_repeats
from tumblecal.ground.strict_json import Record, Shape, validated


SCHEMA = "tumblecal.device/1"
# Step of the table of a CSV file if none is given, degC.
_STEP_DEGC = 5.0


def _with_covariance(stated: Any) -> Any:
    """A stated dependence on temperature with a covariance of zeros (unknown), if it has none."""
    order = stated.get("covariance_order") if isinstance(stated, dict) else None
    return {"covariance": np.zeros((len(order), len(order))).tolist()} | stated if isinstance(order, list) else stated


class _DeviceFile(Record):
    """The numbers of a JSON file that are read."""

    matrix: Annotated[np.ndarray, Shape((3, 3))]
    bias_g: Annotated[np.ndarray, Shape((3,))]
    terms: Terms = Field(default_factory=list)
    temperature: Annotated[StatedTemperature | None, BeforeValidator(_with_covariance)] = None


def _write_json(export: Export) -> str:
    calibration, curves = export.calibration, export.calibration.temperature
    content = {
        "schema": SCHEMA,
        "equation": "f = matrix (A - bias - terms), in g; in m/s^2 with bias_ms2",
        **device_record(calibration),
        "bias_ms2": export.bias_ms2,
        "gravity_ms2": export.gravity_ms2,
        "temperature_degc": calibration.temperature_degc,
        "serial_number": calibration.serial_number,
        "about": export.header,
    }
    if curves is not None:
        content["temperature"]["covariance"] = curves.covariance
    return json_text(content)


def device_record(calibration: Calibration) -> dict[str, Any]:
    """The numbers that `read_device_file` reads, without covariances."""
    curves, terms = calibration.temperature, [term.record() for term in calibration.terms]
    record = {"matrix": calibration.matrix.tolist(), "bias_g": calibration.bias.tolist(), "terms": terms}
    if curves is None:
        return record
    stated = StatedTemperature.of(curves).model_dump(exclude_unset=True, exclude={"covariance"})
    return record | {"temperature": stated}


def read_device_file(text: str, _: float = 0.0) -> Calibration:
    """The calibration of a JSON text.

    **Raises:** `InputError` as `parsed`.
    """
    stated: _DeviceFile = parsed(text, _DeviceFile)
    curves = None if stated.temperature is None else stated.temperature.curves_of_temperature()
    return of_numbers(stated.matrix, stated.bias_g, stated.terms, curves)


def parsed(text: str, kind: Any) -> Any:
    """A JSON text as a model.

    **Raises:** `InputError` for a text that is not JSON, a repeated key, and content that the model does not allow.
    """
    try:
        content = json.loads(text, object_pairs_hook=without_repeats)
        require_plain(content)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON: {error}") from error
    return validated(content, kind, "JSON")


def _write_csv(export: Export) -> str:
    calibration = export.calibration
    if calibration.temperature is not None:
        rows = [row.values() for row in calibration_table(calibration, _table_degc(export).tolist(), extrapolate=True)]
        table = [",".join(COLUMNS), *(",".join(map(number, row)) for row in rows)]
    else:
        rows = np.column_stack([calibration.matrix, calibration.bias]).tolist()
        table = [
            ",".join(_LINEAR_COLUMNS),
            *(",".join([axis, *map(number, row)]) for axis, row in zip(AXES, rows, strict=True)),
        ]
    return export.commented("#") + "\n".join(table) + "\n"


_LINEAR_COLUMNS = ("axis", "m_x", "m_y", "m_z", "bias_g")


def _read_csv(text: str, gravity_ms2: float) -> Calibration:
    rows = list(csv.DictReader(io.StringIO("\n".join(line for line in text.splitlines() if line[:1] != "#"))))
    over_temperature = bool(rows) and COLUMNS[0] in rows[0]
    names = [COLUMNS[0], *COLUMNS[1::2]] if over_temperature else _LINEAR_COLUMNS[1:]
    try:
        table = np.array([[float(row[name]) for name in names] for row in rows]).reshape(-1, len(names))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"columns {', '.join(names)} must have numbers") from error
    if not np.all(np.isfinite(table)):
        raise InputError(f"columns {', '.join(names)} must have finite numbers")
    if over_temperature:
        return of_table(table[:, 0], table[:, 1:])
    if len(table) != len(AXES):
        raise InputError(f"{len(table)} rows; there must be one for each of x, y and z")
    return of_numbers(table[:, :3], table[:, 3])


def _table_degc(export: Export) -> np.ndarray:
    return replace(export, table_step_degc=export.table_step_degc or _STEP_DEGC).table_degc


def _in_table(calibration: Calibration, export: Export) -> tuple[Calibration, str]:
    """The calibration of a program that interpolates the rows of the table linearly."""
    degc = _table_degc(replace(export, calibration=calibration))
    return in_table(calibration, degc), f"{TEMPERATURE} (linear interpolation between {len(degc)} rows)"


TARGETS = (
    Target(
        "json",
        "matrix, bias (g and m/s^2), terms and curves",
        _write_json,
        read_device_file,
        LINEAR | {"terms", "curves"},
        "docs/files.md",
    ),
    Target(
        "csv",
        "matrix and bias, one row for each axis; with curves of temperature the parameters, one row for each temperature",
        _write_csv,
        _read_csv,
        LINEAR | {"curves"},
        "docs/files.md",
        (),
        _in_table,
    ),
)
