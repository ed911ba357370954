"""JSON, CSV and MATLAB: the unconverted numbers, for user programs."""

import csv
import io
import json
from typing import Any

import numpy as np

from tumblecal.data.calibration_terms import terms_of
from tumblecal.devices.target import Export, Numbers, Target, inverse, listed, number, numbers_after
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import require_plain, without_repeats


SCHEMA = "tumblecal.device/1"


def _json(export: Export) -> str:
    calibration = export.calibration
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
        "about": list(export.header),
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _read_json(text: str, gravity_ms2: float) -> Numbers:
    content = json_object(text)
    matrix, bias = json_numbers(content, "matrix", (3, 3)), json_numbers(content, "bias_g", (3,))
    return Numbers(matrix, bias, terms_of(content.get("terms", [])))


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
    lines = ["axis,m_x,m_y,m_z,bias_g"]
    for axis, row, bias in zip(AXES, calibration.matrix, calibration.bias, strict=True):
        lines.append(f"{axis},{','.join(number(value) for value in row)},{number(bias)}")
    return export.commented("#") + "\n".join(lines) + "\n"


def _read_csv(text: str, gravity_ms2: float) -> Numbers:
    rows = list(csv.DictReader(io.StringIO("\n".join(line for line in text.splitlines() if line[:1] != "#"))))
    try:
        table = np.array([[float(row[name]) for name in ("m_x", "m_y", "m_z", "bias_g")] for row in rows])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("columns m_x, m_y, m_z, bias_g must have numbers") from error
    if table.shape != (3, 4):
        raise InputError(f"{len(table)} rows; there must be one for each of x, y and z")
    return Numbers(table[:, :3], table[:, 3])


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
        "matrix, bias (g and m/s^2) and terms",
        _json,
        _read_json,
        _LINEAR | {"terms"},
        "docs/files.md",
    ),
    Target("csv", ".csv", "matrix and bias, one row for each axis", _csv, _read_csv, _LINEAR, "docs/files.md"),
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
