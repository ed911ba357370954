"""Kalibr, imu_tk, imucal and ROS (imu_calib): matrices with the scale and misalignment convention of each."""

import json

import numpy as np

from tumblecal.devices.plain import json_numbers, json_object
from tumblecal.devices.target import Export, Numbers, Target, inverse, listed, number, numbers_after
from tumblecal.ground.errors import InputError


_LINEAR = frozenset({"cross terms", "bias"})


def _kalibr(export: Export) -> str:
    lines = [f"{export.commented('#')}imu0:\n"]
    lines += [f"  {line}\n" for line in _kalibr_noise(export)]
    lines.append("  model: scale-misalignment\n  accelerometers:\n    M:\n")
    lines += [f"    - [{listed(row)}]\n" for row in np.linalg.inv(export.calibration.matrix)]
    return "".join(lines)


def _kalibr_noise(export: Export) -> list[str]:
    """Noise density and random walk of the noisiest axis: Kalibr has one value for three axes."""
    if not export.noise:
        return ["# accelerometer_noise_density, accelerometer_random_walk: give --noise reduction.json"]
    density, walk = (
        max(axis.get(key, 0.0) for axis in export.noise) * export.gravity_ms2
        for key in ("white_g_per_rthz", "walk_g_per_rts")
    )
    found = f"accelerometer_random_walk: {number(walk)}  # m/s^3/sqrt(Hz)"
    not_found = (
        "# accelerometer_random_walk: not found in the recording (too short, or only flicker); Kalibr needs a value"
    )
    return [f"accelerometer_noise_density: {number(density)}  # m/s^2/sqrt(Hz)", found if walk > 0 else not_found]


def _read_kalibr(text: str, gravity_ms2: float) -> Numbers:
    accelerometers = text[max(text.find("accelerometers:"), 0) :]
    return Numbers(inverse(numbers_after(accelerometers, "M", 9).reshape(3, 3), "M"), np.zeros(3))


def _imu_tk(export: Export) -> str:
    scale = np.diag(np.diag(export.calibration.matrix))
    misalignment = export.calibration.matrix @ np.linalg.inv(scale)
    parts = (misalignment, scale, export.bias_ms2[:, None])
    return "\n".join("".join(" ".join(map(number, row)) + "\n" for row in part) for part in parts)


def _read_imu_tk(text: str, gravity_ms2: float) -> Numbers:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise InputError(f"imu_tk: {error}") from error
    if len(values) != 21 or not np.all(np.isfinite(values)):
        raise InputError(f"imu_tk: {len(values)} numbers; there must be 21 (misalignment, scale, bias)")
    return Numbers(values[:9].reshape(3, 3) @ values[9:18].reshape(3, 3), values[18:] / gravity_ms2)


def _imucal(export: Export) -> str:
    forward = np.linalg.inv(export.calibration.matrix)
    scale = np.diag(np.diag(forward))
    still = np.zeros((3, 3)).tolist()
    content = {
        "cal_type": "Ferraris",
        "_format_version": "2.0.0",
        "acc_unit": "m/s^2",
        "gyr_unit": "deg/s",
        "from_acc_unit": "m/s^2",
        "from_gyr_unit": "deg/s",
        "comment": "; ".join(export.header),
        "K_a": scale.tolist(),
        "R_a": (np.linalg.inv(scale) @ forward).tolist(),
        "b_a": export.bias_ms2.tolist(),
        "K_g": np.eye(3).tolist(),
        "R_g": np.eye(3).tolist(),
        "K_ga": still,
        "b_g": [0.0, 0.0, 0.0],
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _read_imucal(text: str, gravity_ms2: float) -> Numbers:
    content = json_object(text)
    forward = json_numbers(content, "K_a", (3, 3)) @ json_numbers(content, "R_a", (3, 3))
    unit = content.get("from_acc_unit")
    if unit not in ("m/s^2", "g"):
        raise InputError(f"from_acc_unit is {unit!r}; it must be m/s^2 or g")
    bias = json_numbers(content, "b_a", (3,))
    matrix = inverse(forward, "K_a R_a")
    if content.get("acc_unit") != unit:
        raise InputError("acc_unit and from_acc_unit differ; units of readings and force must be the same")
    return Numbers(matrix, bias / (gravity_ms2 if unit == "m/s^2" else 1.0))


def _ros(export: Export) -> str:
    matrix = export.calibration.matrix
    return f"{export.commented('#')}SM: [{listed(matrix)}]\nbias: [{listed(matrix @ export.bias_ms2)}]\n"


def _read_ros(text: str, gravity_ms2: float) -> Numbers:
    matrix = numbers_after(text, "SM:", 9).reshape(3, 3)
    return Numbers(matrix, inverse(matrix, "SM") @ numbers_after(text, "bias:", 3) / gravity_ms2)


TARGETS = (
    Target(
        "kalibr",
        ".yaml",
        "imu.yaml: y = M C a + b; noise density and walk with --noise",
        _kalibr,
        _read_kalibr,
        frozenset({"cross terms"}),
        "Kalibr, IccSensors.py, scale-misalignment",
        ("Kalibr estimates the bias itself, over time; its C relates this frame to that of the IMU.",),
    ),
    Target(
        "imu_tk",
        ".calib",
        "T K (X - B), m/s^2",
        _imu_tk,
        _read_imu_tk,
        _LINEAR,
        "imu_tk, include/imu_tk/calibration.h",
        ("The T of imu_tk itself is upper triangular (a different frame); its loader accepts any T.",),
    ),
    Target(
        "imucal",
        ".json",
        "R^-1 K^-1 (A - b), m/s^2",
        _imucal,
        _read_imucal,
        _LINEAR,
        "imucal, ferraris_calibration_info.py, format 2.0.0",
        ("The gyroscope values are neutral: replace them by those of your gyroscope.",),
    ),
    Target("ros", ".yaml", "SM A - bias, m/s^2 (imu_calib)", _ros, _read_ros, _LINEAR, "imu_calib, accel_calib.cpp"),
)
