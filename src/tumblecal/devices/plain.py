"""JSON, CSV and MATLAB: the unconverted numbers, for user programs."""

import csv
import io
import json
from dataclasses import replace
from typing import Any

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_table import COLUMNS, calibration_table
from tumblecal.data.calibration_terms import terms_of
from tumblecal.data.sensor_parameters import triad_of
from tumblecal.data.temperature_curves_file import StatedTemperature
from tumblecal.devices.target import (
    TEMPERATURE,
    Export,
    Numbers,
    Target,
    inverse,
    listed,
    number,
    numbers_after,
)
from tumblecal.devices.temperature_table import in_table, linear_curves
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import require_plain, without_repeats
from tumblecal.ground.strict_json import validated


SCHEMA = "tumblecal.device/1"
# Step of the table of a CSV file if none is given, degC.
_STEP_DEGC = 5.0


def _json(export: Export) -> str:
    calibration = export.calibration
    curves = calibration.temperature
    temperature = {} if curves is None else {"temperature": StatedTemperature.of(curves).model_dump(exclude_unset=True)}
    content = {
        "schema": SCHEMA,
        "equation": "f = matrix (A - bias - terms), in g; in m/s^2 with bias_ms2",
        "matrix": calibration.matrix.tolist(),
        "bias_g": calibration.bias.tolist(),
        "bias_ms2": export.bias_ms2.tolist(),
        "gravity_ms2": export.gravity_ms2,
        "temperature_degc": calibration.temperature_degc,
        "serial_number": calibration.serial_number,
        "terms": [term.record() for term in calibration.terms],
        **temperature,
        "about": list(export.header),
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _read_json(text: str, gravity_ms2: float) -> Numbers:
    content = json_object(text)
    matrix, bias = json_numbers(content, "matrix", (3, 3)), json_numbers(content, "bias_g", (3,))
    stated = content.get("temperature")
    curves = None if stated is None else validated(stated, StatedTemperature, "", "temperature").curves_of_temperature()
    return Numbers(matrix, bias, terms_of(content.get("terms", [])), curves)


def json_object(text: str) -> dict[str, Any]:
    """The object of a JSON text.

    **Raises:** `InputError` if it is not an object, or has a repeated key.
    """
    try:
        content = json.loads(text, object_pairs_hook=without_repeats)
        require_plain(content)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON: {error}") from error
    if not isinstance(content, dict):
        raise InputError("not a JSON object")
    return content


def json_numbers(content: dict[str, Any], key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers of a JSON object.

    **Raises:** `InputError` if they are missing or have a wrong shape.
    """
    try:
        values = np.array(content[key], float)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{key} is missing, or not numbers") from error
    if values.shape != shape or not np.all(np.isfinite(values)):
        raise InputError(f"{key} must have {' x '.join(map(str, shape))} finite numbers")
    return values


def _csv(export: Export) -> str:
    calibration = export.calibration
    if calibration.temperature is not None:
        rows = calibration_table(calibration, _table_degc(export).tolist(), extrapolate=True)
        table = [",".join(COLUMNS), *(",".join(map(number, row.values())) for row in rows)]
        return export.commented("#") + "\n".join(table) + "\n"
    lines = ["axis,m_x,m_y,m_z,bias_g"]
    for axis, row, bias in zip(AXES, calibration.matrix, calibration.bias, strict=True):
        lines.append(f"{axis},{','.join(number(value) for value in row)},{number(bias)}")
    return export.commented("#") + "\n".join(lines) + "\n"


def _read_csv(text: str, gravity_ms2: float) -> Numbers:
    rows = list(csv.DictReader(io.StringIO("\n".join(line for line in text.splitlines() if line[:1] != "#"))))
    over_temperature = bool(rows) and COLUMNS[0] in rows[0]
    names = [COLUMNS[0], *COLUMNS[1::2]] if over_temperature else ["m_x", "m_y", "m_z", "bias_g"]
    try:
        table = np.array([[float(row[name]) for name in names] for row in rows])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"columns {', '.join(names)} must have numbers") from error
    if over_temperature:
        if not np.all(np.isfinite(table)):
            raise InputError(f"columns {', '.join(names)} must have finite numbers")
        values, curves = linear_curves(table[:, 0], table[:, 1:])
        return Numbers(inverse(triad_of(values), "diag(1 + dK) T"), values[3:6], (), curves)
    if table.shape != (3, 4):
        raise InputError(f"{len(table)} rows; there must be one for each of x, y and z")
    return Numbers(table[:, :3], table[:, 3])


def _table_degc(export: Export) -> np.ndarray:
    return replace(export, table_step_degc=export.table_step_degc or _STEP_DEGC).table_degc


def _in_table(calibration: Calibration, export: Export) -> tuple[Calibration, str]:
    """The calibration of a program that interpolates the rows of the table linearly."""
    if calibration.temperature is None:
        return calibration, "linear interpolation"
    degc = _table_degc(replace(export, calibration=calibration))
    return in_table(calibration, degc), f"{TEMPERATURE} (linear interpolation between {len(degc)} rows)"


def _matlab(export: Export) -> str:
    matrix = export.calibration.matrix
    rows = "; ".join(listed(row) for row in matrix.T)
    offset = -matrix @ export.bias_ms2
    return (
        f"{export.commented('%')}% U: readings in rows, m/s^2. Specific force: C = U*A + b, as in accelcal.\n"
        f"A = [{rows}];\nb = [{listed(offset)}];\n"
    )


def _read_matlab(text: str, gravity_ms2: float) -> Numbers:
    code = "\n".join(line.split("%")[0] for line in text.splitlines())
    matrix = numbers_after(code, "A", 9).reshape(3, 3).T
    return Numbers(matrix, -inverse(matrix, "A") @ numbers_after(code, "b", 3) / gravity_ms2)


_LINEAR = frozenset({"cross terms", "bias"})
TARGETS = (
    Target(
        "json",
        ".json",
        "matrix, bias (g and m/s^2), terms and curves",
        _json,
        _read_json,
        _LINEAR | {"terms", "curves"},
        "docs/files.md",
    ),
    Target(
        "csv",
        ".csv",
        "matrix and bias, one row for each axis; with curves of temperature the parameters, one row for each temperature",
        _csv,
        _read_csv,
        _LINEAR | {"curves"},
        "docs/files.md",
        (),
        _in_table,
    ),
    Target(
        "matlab",
        ".m",
        "A and b of accelcal: C = U*A + b, readings in rows, m/s^2",
        _matlab,
        _read_matlab,
        _LINEAR,
        "MATLAB, Navigation Toolbox, accelcal",
    ),
)
