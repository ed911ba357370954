"""What each export target computes from its own file: the formulas of the devices and programs, in plain numpy.

Nothing of tumblecal is imported: every function parses the exported text and applies it as the target does. The sources are
cited at each function. Tests call `applied`.
"""

import ctypes
import json
import re
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np


# (text of the file, readings (n, 3) in m/s^2, temperatures (n,) in degC, one g in m/s^2) -> specific force (n, 3) in m/s^2.
Formula = Callable[[str, np.ndarray, np.ndarray, float], np.ndarray]

# PX4 ignores a vector of offsets (m/s^2), and scale factors (from 1), up to this norm.
PX4_DEAD_BAND = 0.01
# ArduPilot's thermal polynomials count from here, degC, and are kept in millionths.
ARDUPILOT_REFERENCE_DEGC, ARDUPILOT_UNIT = 35.0, 1e-6


def applied(
    target: str, text: str, readings_g: np.ndarray, temperature_degc: np.ndarray | float, gravity_ms2: float
) -> np.ndarray:
    """The specific force (n, 3) in g that a target makes of readings.

    **Arguments:**

    - `target`: a key of `FORMULAS`. `text`: the exported file. `readings_g`: (n, 3). `temperature_degc`: (n,), or one for all.
    - `gravity_ms2`: what one g was in the export.
    """
    readings = np.asarray(readings_g, float) * gravity_ms2
    degc = np.broadcast_to(np.asarray(temperature_degc, float), (len(readings),))
    return FORMULAS[target](text, readings, degc, gravity_ms2) / gravity_ms2


def numbers(text: str, key: str, count: int) -> np.ndarray:
    """The first numbers after a key."""
    return np.array(re.findall(r"[-+]?\d[\d.eE+-]*", text.split(key, 1)[1])[:count], float)


def parameters(text: str) -> dict[str, float]:
    """A parameter file: `NAME,value` (Mission Planner), or MAVLink's five columns with tabs (QGroundControl)."""
    lines = [re.split(r"[\t,]", line) for line in text.splitlines() if line[:1] not in ("#", "")]
    return {row[-3] if len(row) == 5 else row[0]: float(row[-2] if len(row) == 5 else row[1]) for row in lines}


def px4(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`(A - thermal - OFF) * SCALE`, `thermal = X0 + X1 d + X2 d^2 + X3 d^3`, d = T kept within TMIN..TMAX less TREF.

    PX4-Autopilot: `calibration::Accelerometer::Correct`, `set_offset`, `set_scale` (src/lib/sensor_calibration/
    Accelerometer.hpp and .cpp), `TemperatureCompensation::calc_thermal_offsets_3D` (src/modules/temperature_compensation).
    """
    p = parameters(text)
    offset, scale = (np.array([p[f"CAL_ACC0_{axis}{name}"] for axis in "XYZ"]) for name in ("OFF", "SCALE"))
    offset = offset if np.linalg.norm(offset) > PX4_DEAD_BAND else np.zeros(3)
    scale = scale if np.linalg.norm(scale - 1) > PX4_DEAD_BAND else np.ones(3)
    thermal = np.zeros_like(a)
    if p.get("TC_A_ENABLE") == 1:
        step = np.clip(degc, p["TC_A0_TMIN"], p["TC_A0_TMAX"]) - p["TC_A0_TREF"]
        for power in range(4):
            thermal += np.array([p[f"TC_A0_X{power}_{k}"] for k in range(3)]) * step[:, None] ** power
    return (a - thermal - offset) * scale


def ardupilot(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`(A - p(T) + p(CALTEMP) - OFFS) * SCAL`, `p(T) = (c1 + (c2 + c3 d) d) d 1e-6`, d = T kept within TMIN..TMAX less 35.

    ArduPilot: `AP_InertialSensor::TCal::correct_sensor`, `polynomial_eval` (AP_InertialSensor_tempcal.cpp),
    `AP_InertialSensor_Backend::_rotate_and_correct_accel` (libraries/AP_InertialSensor).
    """
    p = parameters(text)
    offset, scale = (np.array([p[f"INS_ACC{name}_{axis}"] for axis in "XYZ"]) for name in ("OFFS", "SCAL"))
    corrected = a
    if p.get("INS_TCAL1_ENABLE") == 1:
        c1, c2, c3 = (np.array([p[f"INS_TCAL1_ACC{order}_{axis}"] for axis in "XYZ"]) for order in (1, 2, 3))

        def polynomial(t: np.ndarray) -> np.ndarray:
            step = (np.clip(t, p["INS_TCAL1_TMIN"], p["INS_TCAL1_TMAX"]) - ARDUPILOT_REFERENCE_DEGC)[:, None]
            return (c1 + (c2 + c3 * step) * step) * step * ARDUPILOT_UNIT

        corrected = a - polynomial(degc) + polynomial(np.full(len(a), p["INS_ACC1_CALTEMP"]))
    return (corrected - offset) * scale


def kalibr(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`y = M C a + b` solved for `C a`, b zero: Kalibr estimates it along time.

    Kalibr: aslam_offline_calibration/kalibr/python/kalibr_imu_camera_calibration/IccSensors.py, `IccScaledMisalignedImu`.
    """
    return a @ np.linalg.inv(numbers(text, " M:", 9).reshape(3, 3)).T


def imu_tk(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`T K (X - B)`. imu_tk: include/imu_tk/calibration.h, `CalibratedTriad_::unbiasNormalize`."""
    values = np.array(text.split(), float)
    misalignment, scale, bias = values[:9].reshape(3, 3), values[9:18].reshape(3, 3), values[18:]
    return (a - bias) @ (misalignment @ scale).T


def imucal(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`R^-1 K^-1 (A - b)`. imucal: ferraris_calibration_info.py, `FerrarisCalibrationInfo._calibrate_acc`."""
    own = {key: np.array(value) for key, value in json.loads(text).items() if key.endswith("_a")}
    return (a - own["b_a"]) @ (np.linalg.inv(own["R_a"]) @ np.linalg.inv(own["K_a"])).T


def ros(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`SM A - bias`. imu_calib (ROS): src/accel_calib.cpp, `AccelCalib::applyCalib`."""
    return a @ numbers(text, "SM:", 9).reshape(3, 3).T - numbers(text, "bias:", 3)


def vectornav(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`C (A - B)`, float32. VectorNav VN-100 user manual, register 25 (acceleration compensation)."""
    sent, checksum = re.search(r"\$([^*]*)\*(..)", text).groups()  # pyright: ignore[reportOptionalMemberAccess]
    if int(checksum, 16) != np.bitwise_xor.reduce(np.frombuffer(sent.encode(), np.uint8)):
        raise ValueError("the checksum of register 25 is wrong: the device ignores the command")
    values = np.array(sent.split(",")[2:], np.float32).astype(float)
    return (a - values[9:]) @ values[:9].reshape(3, 3).T


def matlab(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`C = U*A + b`. MATLAB Navigation Toolbox, `accelcal`."""
    code = "\n".join(line for line in text.splitlines() if line[:1] != "%")
    return a @ numbers(code, "A =", 9).reshape(3, 3) + numbers(code, "b =", 3)


def in_csv(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`M (A - b)`, a row for each axis, b in g; of a table over temperature the parameters at the temperature, by linear
    interpolation (docs/devices.md)."""
    lines = [line for line in text.splitlines() if line[:1] != "#"]
    if lines[0].startswith("temperature_degc"):
        table = np.array([line.split(",") for line in lines[1:]], float)
        parameters_at = [np.interp(degc, table[:, 0], table[:, 1 + 2 * k]) for k in range(9)]
        return _of_parameters(a / gravity_ms2, np.array(parameters_at).T) * gravity_ms2
    rows = np.array([line.split(",")[1:] for line in text.splitlines() if line[:2] in ("x,", "y,", "z,")], float)
    return ((a / gravity_ms2 - rows[:, 3]) @ rows[:, :3].T) * gravity_ms2


def in_json(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`f = M (A - b - terms(u, T))`, u the inputs along the sensitive axes, by fixed-point steps; the parameters may be curves
    of the temperature (docs/files.md)."""
    content = json.loads(text)
    matrix, bias, readings = np.array(content["matrix"]), np.array(content["bias_g"]), a / gravity_ms2
    forward = np.linalg.inv(matrix)
    if "temperature" in content:
        scale = np.diag(forward)
        gamma = (forward / scale[:, None])[[1, 2, 2], [0, 0, 1]]
        values = np.concatenate([scale - 1, bias, gamma]) + _curves(content["temperature"], degc)
        return _of_parameters(readings, values) * gravity_ms2
    to_inputs = (forward / np.diag(forward)[:, None]).T
    force = (readings - bias) @ matrix.T
    for _ in range(60):
        force = (readings - bias - _terms(content.get("terms", []), force @ to_inputs, degc)) @ matrix.T
    return force * gravity_ms2


_PARAMETERS = (*(f"{leaf}_{axis}" for leaf in ("dK", "bias") for axis in "xyz"), "gamma_21", "gamma_31", "gamma_32")


def _curves(stated: dict, degc: np.ndarray) -> np.ndarray:
    """Changes (n, 9) of the parameters since the reference temperature (docs/files.md)."""
    changes, reference = np.zeros((len(degc), 9)), stated["reference_degc"]
    for curve in stated["curves"]:
        order, coefficients = curve["order"], curve["coefficients"]
        functions = [(degc - reference) ** power for power in range(1, order + 1)]
        functions += [
            np.clip(degc - knot, 0, None) ** order - max(reference - knot, 0) ** order
            for knot in curve.get("knots_degc", [])
        ]
        changes[:, _PARAMETERS.index(curve["parameter"])] = np.array(coefficients) @ np.array(functions)
    return changes


def _of_parameters(readings: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Specific force (n, 3) of readings in g: the equations of each row solved as a linear system."""
    triad = np.tile(np.eye(3), (len(values), 1, 1))
    triad[:, [1, 2, 2], [0, 0, 1]] = values[:, 6:]
    return np.linalg.solve((1 + values[:, :3])[:, :, None] * triad, (readings - values[:, 3:6])[:, :, None])[:, :, 0]


def _terms(terms: list[dict], u: np.ndarray, degc: np.ndarray) -> np.ndarray:
    """What the terms of a calibration add to the readings, g (docs/files.md)."""
    kinds = {"product": lambda value: value, "abs": np.abs, "sign": np.sign}
    added = np.zeros_like(u)
    for term in terms:
        if term.get("per_hour"):
            raise ValueError("a term that counts the hours has no place in an export")
        value = term["coefficient"] * kinds[term.get("kind", "product")](np.prod(u ** np.array(term["powers"]), axis=1))
        power = term.get("degc_power", int(bool(term.get("per_degc"))))
        if power:
            value = value * (degc - term["reference_degc"]) ** power
        added[:, "xyz".index(term["axis"])] += value
    return added


_RUN = """
#define TUMBLECAL_REAL double
#include "calibration.h"
void run(long count, const double *in, const double *degc, double *out) {
    long k; (void)degc;
    for (k = 0; k < count; ++k) tumblecal_apply(in + 3 * k, THERMAL out + 3 * k);
}
"""


def c_header(text: str, a: np.ndarray, degc: np.ndarray, gravity_ms2: float) -> np.ndarray:
    """`tumblecal_apply` in double precision, compiled by the C compiler `cc` of this machine (docs/devices.md)."""
    thermal = re.search(r"tumblecal_apply\([^)]*temperature_degc", text) is not None
    readings, force = np.ascontiguousarray(a / gravity_ms2), np.empty_like(a)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "calibration.h").write_text(text)
        Path(folder, "run.c").write_text(_RUN.replace("THERMAL", "degc[k]," if thermal else ""))
        library = Path(folder, "run.so")
        subprocess.run(
            ["cc", "-std=c99", "-O1", "-shared", "-fPIC", "run.c", "-o", str(library)], cwd=folder, check=True
        )
        run = ctypes.CDLL(str(library)).run
    arrays = [array.ctypes.data_as(ctypes.c_void_p) for array in (readings, np.ascontiguousarray(degc), force)]
    run(ctypes.c_long(len(a)), *arrays)
    return force * gravity_ms2


FORMULAS: dict[str, Formula] = {
    "c-header": c_header,
    "json": in_json,
    "csv": in_csv,
    "matlab": matlab,
    "px4": px4,
    "ardupilot": ardupilot,
    "kalibr": kalibr,
    "imu_tk": imu_tk,
    "imucal": imucal,
    "ros": ros,
    "vectornav": vectornav,
}
