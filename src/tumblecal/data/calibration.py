"""`calibration.json`: what a device applies, `f = matrix (A - bias)`."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.data.atomic import write_text
from tumblecal.data.files import read_text
from tumblecal.errors import InputError


SCHEMA = "tumblecal.calibration/1"
ORDER = (*(f"matrix_{row}{column}" for row in "123" for column in "123"), "bias_x", "bias_y", "bias_z")


@dataclass(frozen=True)
class Calibration:
    """The linear correction of a triad.

    `matrix` turns readings less `bias` (g) into specific force in the triad's own orthogonal frame: x along the x
    input axis, y in the plane of the x and y input axes. `covariance` is of `ORDER`. `alignment` turns that frame's
    vectors into the fixture's: `f_fixture = alignment f`; None where the data hold several mountings. `extra` keeps
    the file's other keys as they are.
    """

    matrix: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "12 12"]
    alignment: Float[np.ndarray, "3 3"] | None = None
    temperature_degc: float | None = None
    serial_number: str | None = None
    provenance: dict[str, Any] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)

    def corrected(self, readings: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 3"]:
        """Specific force in g from readings in g."""
        return (readings - self.bias) @ self.matrix.T


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a calibration file, whole or not at all."""
    content = {
        "schema": SCHEMA,
        "equation": "f = matrix (A - bias); f_fixture = alignment f",
        "matrix": calibration.matrix.tolist(),
        "bias": calibration.bias.tolist(),
        "covariance": calibration.covariance.tolist(),
        "covariance_order": list(ORDER),
        "alignment": None if calibration.alignment is None else calibration.alignment.tolist(),
        "units": {"A": "g", "f": "g", "matrix": "1", "bias": "g", "alignment": "1"},
        "temperature_degc": calibration.temperature_degc,
        "serial_number": calibration.serial_number,
        "provenance": calibration.provenance,
        **calibration.extra,
    }
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    **Raises:** `InputError` when it is not one, or a number in it is missing or not finite.
    """
    try:
        content = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}:line {error.lineno}, column {error.colno}: not JSON: {error.msg}") from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else None
        raise InputError(f"{path}: schema is {found!r}, not {SCHEMA!r}; give the calibration.json that calibrate wrote")
    own = {"schema", "equation", "matrix", "bias", "covariance", "covariance_order", "alignment", "units"}
    own |= {"temperature_degc", "serial_number", "provenance"}
    return Calibration(
        matrix=_numbers(path, content, "matrix", (3, 3)),
        bias=_numbers(path, content, "bias", (3,)),
        covariance=_numbers(path, content, "covariance", (12, 12)),
        alignment=None if content.get("alignment") is None else _numbers(path, content, "alignment", (3, 3)),
        temperature_degc=content.get("temperature_degc"),
        serial_number=content.get("serial_number"),
        provenance=content.get("provenance", {}),
        extra={key: value for key, value in content.items() if key not in own},
    )


def _numbers(path: Path, content: dict[str, Any], key: str, shape: tuple[int, ...]) -> np.ndarray:
    try:
        values = np.array(content[key], float)
    except KeyError as error:
        raise InputError(f"{path}: {key} is missing") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: {key} is not a table of numbers") from error
    if values.shape != shape or not np.all(np.isfinite(values)):
        raise InputError(f"{path}: {key} must hold {' x '.join(map(str, shape))} finite numbers")
    return values
