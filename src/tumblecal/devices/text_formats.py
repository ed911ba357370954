"""Matrices of other programs and devices, m/s^2: a record of names and convention for each, written and read by one rule."""

import json
import re
from dataclasses import dataclass
from functools import partial, reduce
from typing import Annotated

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.devices.over_temperature import inverse, of_numbers
from tumblecal.devices.own_formats import parsed
from tumblecal.devices.target import LINEAR, Export, Target, number, numbers_after
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_json import Record, Shape, Text, one_of


@dataclass(frozen=True)
class Layout:
    """The content of a file and the convention of its numbers.

    - `text`: with rows of numbers in braces, such as `{SM[0]}`, `{header}` (comments), `{comment}` (a JSON text) and `{noise}`.
    - `factors`: names of the matrices whose product is the matrix of the calibration, its `inverse` or its `transposed`. The
      first or the last of two is the diagonal of the product (`scale_first`).
    - `offset`: name of the bias in m/s^2; "" without one. `after`: it is this multiple of the matrix times the bias; 0: of the
      bias alone.
    - `mark`: of a comment. `separator`: of the numbers of a row. `format`: of a number. `section`: text before the numbers.
    - `ordered`: the numbers have no names, only their order.
    """

    text: str
    factors: tuple[str, ...]
    offset: str = ""
    after: float = 0.0
    inverse: bool = False
    transposed: bool = False
    scale_first: bool = False
    mark: str = "#"
    separator: str = ", "
    format: str = ""
    section: str = ""
    ordered: bool = False


def _write(layout: Layout, export: Export) -> str:
    matrix, offset = export.calibration.matrix, export.bias_ms2
    stated = np.linalg.inv(matrix) if layout.inverse else matrix.T if layout.transposed else matrix
    scale = np.diag(np.diag(stated))
    split = [scale, np.linalg.inv(scale) @ stated] if layout.scale_first else [stated @ np.linalg.inv(scale), scale]
    arrays = dict(zip(layout.factors, split if len(layout.factors) > 1 else [stated], strict=True))
    if layout.offset:
        arrays[layout.offset] = (layout.after * matrix @ offset if layout.after else offset)[:, None]
    rows = {
        name: [layout.separator.join(format(value, layout.format) for value in row) for row in array.tolist()]
        for name, array in arrays.items()
    }
    comment = json.dumps("; ".join(export.header))
    return layout.text.format(header=export.commented(layout.mark), comment=comment, noise=_noise(export), **rows)


def _read(layout: Layout, text: str, gravity_ms2: float) -> Calibration:
    text = re.sub(f"{layout.mark}.*", "", text)
    arrays = _arrays(layout, text[max(text.find(layout.section), 0) :])
    offset = arrays.pop(layout.offset, np.zeros(3)) / gravity_ms2
    product, name = reduce(np.matmul, [array.reshape(3, 3) for array in arrays.values()]), " ".join(arrays)
    matrix = inverse(product, name) if layout.inverse else product.T if layout.transposed else product
    return of_numbers(matrix, layout.after * inverse(matrix, name) @ offset if layout.after else offset)


def _arrays(layout: Layout, text: str) -> dict[str, np.ndarray]:
    """The numbers of a file, by name."""
    counts = dict.fromkeys(layout.factors, 9) | ({layout.offset: 3} if layout.offset else {})
    if layout.ordered:
        try:
            values = np.array(text.replace(",", " ").split(), float)
        except ValueError as error:
            raise InputError(f"{error}; only numbers may be here") from error
        if len(values) != sum(counts.values()):
            raise InputError(f"{len(values)} numbers; there must be {sum(counts.values())} ({', '.join(counts)})")
        arrays = dict(zip(counts, np.split(values, np.cumsum([*counts.values()])[:-1]), strict=True))
    else:
        arrays = {name: numbers_after(text, name, count) for name, count in counts.items()}
    if not np.all(np.isfinite(np.concatenate([*arrays.values()]))):
        raise InputError("numbers that are not finite; correct the file")
    return arrays


def _noise(export: Export) -> str:
    """Noise density and random walk of the noisiest axis: Kalibr has one value for three axes."""
    if not export.noise:
        return "  # accelerometer_noise_density, accelerometer_random_walk: give --noise reduction.json\n"
    density, walk = (
        max(axis.get(key, 0.0) for axis in export.noise) * export.gravity_ms2
        for key in ("white_g_per_rthz", "walk_g_per_rts")
    )
    found = f"accelerometer_random_walk: {number(walk)}  # m/s^3/sqrt(Hz)"
    not_found = (
        "# accelerometer_random_walk: not found in the recording (too short, or only flicker); Kalibr needs a value"
    )
    lines = (f"accelerometer_noise_density: {number(density)}  # m/s^2/sqrt(Hz)", found if walk > 0 else not_found)
    return "".join(f"  {line}\n" for line in lines)


class _Ferraris(Record):
    """The accelerometer in a file of imucal."""

    acc_unit: Annotated[Text, one_of(("m/s^2", "g"))]
    from_acc_unit: Annotated[Text, one_of(("m/s^2", "g"))]
    K_a: Annotated[np.ndarray, Shape((3, 3))]
    R_a: Annotated[np.ndarray, Shape((3, 3))]
    b_a: Annotated[np.ndarray, Shape((3,))]


def _read_imucal(text: str, gravity_ms2: float) -> Calibration:
    stated: _Ferraris = parsed(text, _Ferraris)
    if stated.acc_unit != stated.from_acc_unit:
        raise InputError("acc_unit and from_acc_unit differ; units of readings and force must be the same")
    bias = stated.b_a / (gravity_ms2 if stated.acc_unit == "m/s^2" else 1.0)
    return of_numbers(inverse(stated.K_a @ stated.R_a, "K_a R_a"), bias)


def _checksum(command: str) -> int:
    """Exclusive or of all bytes between $ and *."""
    return reduce(int.__xor__, command.encode("ascii", "replace"), 0)


# In the format of the library of the manufacturer; the registers are float32.
_REGISTER = Layout(
    "VNWRG,25,{C[0]},{C[1]},{C[2]},{B[0]},{B[1]},{B[2]}",
    ("C",),
    "B",
    separator=",",
    format="+.6f",
    ordered=True,
)


def _write_vectornav(export: Export) -> str:
    return "".join(f"${command}*{_checksum(command):02X}\r\n" for command in (_write(_REGISTER, export), "VNWNV"))


def _read_vectornav(text: str, gravity_ms2: float) -> Calibration:
    command = re.search(r"\$(VN[RW]RG,25,([^*\r\n]*))\*([0-9A-Fa-f]{2})", text)
    if command is None:
        raise InputError("no $VNWRG,25 or $VNRRG,25 with its checksum")
    if int(command[3], 16) != _checksum(command[1]):
        raise InputError(
            f"the checksum of register 25 is {command[3]}, not {_checksum(command[1]):02X}: the line was changed; read the "
            "register again"
        )
    return _read(_REGISTER, command[2], gravity_ms2)


_IMU_TK = Layout(
    "{T[0]}\n{T[1]}\n{T[2]}\n\n{K[0]}\n{K[1]}\n{K[2]}\n\n{B[0]}\n{B[1]}\n{B[2]}\n",
    ("T", "K"),
    "B",
    separator=" ",
    ordered=True,
)
_IMUCAL = Layout(
    """{{
 "cal_type": "Ferraris",
 "_format_version": "2.0.0",
 "acc_unit": "m/s^2",
 "gyr_unit": "deg/s",
 "from_acc_unit": "m/s^2",
 "from_gyr_unit": "deg/s",
 "comment": {comment},
 "K_a": [[{K_a[0]}], [{K_a[1]}], [{K_a[2]}]],
 "R_a": [[{R_a[0]}], [{R_a[1]}], [{R_a[2]}]],
 "b_a": [{b_a[0]}, {b_a[1]}, {b_a[2]}],
 "K_g": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
 "R_g": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
 "K_ga": [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
 "b_g": [0.0, 0.0, 0.0]
}}
""",
    ("K_a", "R_a"),
    "b_a",
    inverse=True,
    scale_first=True,
)
_KALIBR = Layout(
    "{header}imu0:\n\n{noise}  model: scale-misalignment\n  accelerometers:\n    M:\n"
    "    - [{M[0]}]\n    - [{M[1]}]\n    - [{M[2]}]\n",
    ("M",),
    inverse=True,
    section="accelerometers:",
)
_ROS = Layout(
    "{header}SM: [{SM[0]}, {SM[1]}, {SM[2]}]\nbias: [{bias[0]}, {bias[1]}, {bias[2]}]\n", ("SM",), "bias", after=1.0
)
_MATLAB = Layout(
    "{header}% U: readings in rows, m/s^2. Specific force: C = U*A + b, as in accelcal.\n"
    "A = [{A[0]}; {A[1]}; {A[2]}];\nb = [{b[0]}, {b[1]}, {b[2]}];\n",
    ("A",),
    "b",
    after=-1.0,
    transposed=True,
    mark="%",
)

TARGETS = (
    Target(
        "matlab",
        "A and b of accelcal: C = U*A + b, readings in rows, m/s^2",
        partial(_write, _MATLAB),
        partial(_read, _MATLAB),
        LINEAR,
        "MATLAB, Navigation Toolbox, accelcal",
    ),
    Target(
        "kalibr",
        "imu.yaml: y = M C a + b; noise density and walk with --noise",
        partial(_write, _KALIBR),
        partial(_read, _KALIBR),
        frozenset({"cross terms"}),
        "Kalibr, IccSensors.py, scale-misalignment",
        ("Kalibr estimates the bias itself, over time; its C relates this frame to that of the IMU.",),
    ),
    Target(
        "imu_tk",
        "T K (X - B), m/s^2",
        partial(_write, _IMU_TK),
        partial(_read, _IMU_TK),
        LINEAR,
        "imu_tk, include/imu_tk/calibration.h",
        ("The T of imu_tk itself is upper triangular (a different frame); its loader accepts any T.",),
    ),
    Target(
        "imucal",
        "R^-1 K^-1 (A - b), m/s^2",
        partial(_write, _IMUCAL),
        _read_imucal,
        LINEAR,
        "imucal, ferraris_calibration_info.py, format 2.0.0",
        ("The gyroscope values are neutral: replace them by those of your gyroscope.",),
    ),
    Target(
        "ros",
        "SM A - bias, m/s^2 (imu_calib)",
        partial(_write, _ROS),
        partial(_read, _ROS),
        LINEAR,
        "imu_calib, accel_calib.cpp",
    ),
    Target(
        "vectornav",
        "register 25: C (A - B), m/s^2",
        _write_vectornav,
        _read_vectornav,
        LINEAR,
        "VectorNav manuals, register 25",
        ("It is applied after the factory calibration: record the readings with a neutral register 25.",),
    ),
)
