"""Parameter files of PX4 and ArduPilot: an offset and a scale factor for each axis, and the bias over temperature."""

import math
import re

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.devices.target import Export, Numbers, Target, number
from tumblecal.devices.temperature import bias_polynomials, export_degc
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# PX4 uses offsets (m/s^2), or scale factors, only if the vector differs by more than this from its present one (0, 1).
PX4_DEAD_BAND = 0.01
# Limits of ArduPilot: offset (m/s^2), scale factor.
ARDUPILOT_OFFSET, ARDUPILOT_SCALE = 3.5, (0.8, 1.2)
_FLOAT, _INTEGER = 9, 6  # types of MAVLink
# Reference of the polynomials of ArduPilot, degC (TEMP_REFERENCE of AP_InertialSensor_tempcal.cpp).
ARDUPILOT_REFERENCE_DEGC = 35.0
_MICRO = 1e6  # unit of thermal coefficients in ArduPilot
_DIAGONAL = frozenset({"bias", "bias temperature"})


def _polynomials_ms2(export: Export, about_degc: float | None = None) -> tuple[np.ndarray, float] | None:
    """Coefficients (4, 3) of the bias over temperature, m/s^2, by powers of the temperature minus a reference, and the
    temperature of the stated bias; None if nothing depends on the temperature, or if the range is unknown.

    **Arguments:**

    - `about_degc`: reference of the powers. Default: the temperature of the stated bias.
    """
    calibration, span = export.calibration, export.temperatures_degc
    if span is None or not any(term.thermal for term in calibration.terms):
        return None
    stated_degc = export_degc(calibration, span)
    about_degc = stated_degc if about_degc is None else about_degc
    return bias_polynomials(calibration, about_degc) * export.gravity_ms2, stated_degc


def _px4(export: Export) -> str:
    lines = [export.commented("#") + "# Vehicle-Id Component-Id Name Value Type"]
    scale = np.diag(export.calibration.matrix)
    values = {f"CAL_ACC0_{axis.upper()}OFF": export.bias_ms2[k] for k, axis in enumerate(AXES)}
    values |= {f"CAL_ACC0_{axis.upper()}SCALE": scale[k] for k, axis in enumerate(AXES)}
    if thermal := _polynomials_ms2(export):
        low, high = export.temperatures_degc or (0.0, 0.0)
        lines.append(f"1\t1\tTC_A_ENABLE\t1\t{_INTEGER}")
        values |= {"TC_A0_TREF": thermal[1], "TC_A0_TMIN": low, "TC_A0_TMAX": high}
        values |= {f"TC_A0_X{power}_{k}": thermal[0][power, k] for power in range(4) for k in range(3)}
    lines += [f"1\t1\t{name}\t{number(value, float32=True)}\t{_FLOAT}" for name, value in values.items()]
    return "\n".join(lines) + "\n"


def _read_px4(text: str, gravity_ms2: float) -> Numbers:
    names = [axis.upper() for axis in AXES]
    offset = np.array([_parameter(text, f"CAL_ACC0_{axis}OFF") for axis in names])
    scale = np.array([_parameter(text, f"CAL_ACC0_{axis}SCALE") for axis in names])
    powers = np.array([[_parameter(text, f"TC_A0_X{power}_{k}", 0.0) for k in range(3)] for power in range(4)])
    return _numbers(scale, offset + powers[0], powers, _parameter(text, "TC_A0_TREF", 25.0), gravity_ms2)


def _in_px4(calibration: Calibration, export: Export) -> tuple[Calibration, str]:
    """The calibration that PX4 applies: offsets and scale factors whose vector is within the dead band are ignored."""
    offset, scale = calibration.bias * export.gravity_ms2, np.diag(calibration.matrix)
    far_offset, far_scale = float(np.linalg.norm(offset)), float(np.linalg.norm(scale - 1))
    applied = Calibration(
        calibration.matrix if far_scale > PX4_DEAD_BAND else np.eye(3),
        calibration.bias if far_offset > PX4_DEAD_BAND else np.zeros(3),
        calibration.covariance,
        extra=calibration.extra,
    )
    dropped = [f"the offsets ({far_offset:.2g} m/s^2)"] if far_offset <= PX4_DEAD_BAND else []
    dropped += [f"the scale factors ({far_scale:.2g} from 1)"] if far_scale <= PX4_DEAD_BAND else []
    return applied, f"PX4's dead band of {PX4_DEAD_BAND:g}, which drops {' and '.join(dropped) or 'nothing here'}"


def _ardupilot(export: Export) -> str:
    offset, scale = export.bias_ms2, np.diag(export.calibration.matrix)
    low, high = ARDUPILOT_SCALE
    if np.any(np.abs(offset) > ARDUPILOT_OFFSET) or np.any((scale < low) | (scale > high)):
        raise InputError(
            f"ArduPilot accepts offsets up to {ARDUPILOT_OFFSET:g} m/s^2 and scale factors of {low:g} to {high:g}; this unit "
            f"has {np.max(np.abs(offset)):.3g} m/s^2 and {np.min(scale):.3g} to {np.max(scale):.3g}: use a different target"
        )
    values = {f"INS_ACCOFFS_{axis.upper()}": offset[k] for k, axis in enumerate(AXES)}
    values |= {f"INS_ACCSCAL_{axis.upper()}": scale[k] for k, axis in enumerate(AXES)}
    if thermal := _polynomials_ms2(export, ARDUPILOT_REFERENCE_DEGC):
        low, high = export.temperatures_degc or (0.0, 0.0)
        values |= {"INS_TCAL1_ENABLE": 1, "INS_TCAL1_TMIN": low, "INS_TCAL1_TMAX": high, "INS_ACC1_CALTEMP": thermal[1]}
        for power, powers in enumerate(thermal[0] * _MICRO):
            if power:
                values |= {f"INS_TCAL1_ACC{power}_{axis.upper()}": powers[k] for k, axis in enumerate(AXES)}
    lines = [f"{name},{number(value, float32=True)}" for name, value in values.items()]
    return export.commented("#") + "\n".join(lines) + "\n"


def _read_ardupilot(text: str, gravity_ms2: float) -> Numbers:
    names = [axis.upper() for axis in AXES]
    offset = np.array([_parameter(text, f"INS_ACCOFFS_{axis}") for axis in names])
    scale = np.array([_parameter(text, f"INS_ACCSCAL_{axis}") for axis in names])
    powers = np.zeros((4, 3))
    for power in (1, 2, 3):
        powers[power] = [_parameter(text, f"INS_TCAL1_ACC{power}_{axis}", 0.0) / _MICRO for axis in names]
    # The vehicle uses the difference of the polynomial from its value at the temperature of the calibration.
    calibrated_degc = _parameter(text, "INS_ACC1_CALTEMP", 25.0)
    step = calibrated_degc - ARDUPILOT_REFERENCE_DEGC
    moved = np.array([sum(math.comb(p, k) * step ** (p - k) * powers[p] for p in range(k, 4)) for k in range(4)])
    return _numbers(scale, offset, moved, calibrated_degc, gravity_ms2)


def _numbers(
    scale: np.ndarray, offset: np.ndarray, powers: np.ndarray, reference_degc: float, gravity_ms2: float
) -> Numbers:
    thermal = [
        Term(axis, float(powers[power, k] / gravity_ms2), degc_power=power, reference_degc=reference_degc)
        for k, axis in enumerate(AXES)
        for power in (1, 2, 3)
        if powers[power, k]
    ]
    stated_degc = reference_degc if thermal else None
    return Numbers(np.diag(scale), offset / gravity_ms2, thermal, temperature_degc=stated_degc)


def _parameter(text: str, name: str, default: float | None = None) -> float:
    """The value of a parameter: the text after its name up to a blank, or up to the type in a table with commas.

    **Raises:** `InputError` if it is missing without a default, or is not a finite number.
    """
    line = re.search(rf"^(?![ \t]*#)(.*)\b{name}\b(?: *[\t,=:] *| *)(\S*)", text, re.MULTILINE)
    if line is None and default is None:
        raise InputError(f"{name} is missing; add it to the file")
    if line is None:
        return float(default or 0.0)
    stated = re.sub(r",\d*$", "", line[2]) if "," in line[1] else line[2].rstrip(",;")
    try:
        value = float(stated)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{name}: {stated!r} is not a number (a point is its decimal mark)")
    return value


TARGETS = (
    Target(
        "px4",
        ".params",
        "CAL_ACC0_*: (A - thermal - OFF) * SCALE, m/s^2",
        _px4,
        _read_px4,
        _DIAGONAL,
        "PX4-Autopilot, src/lib/sensor_calibration/Accelerometer.cpp",
        (
            "CAL_ACC0_ID (and TC_A0_ID for thermal terms) must be that of the sensor; otherwise PX4 ignores the set.",
            "The axes are those of the sensor, not of the vehicle: the board rotation is applied afterwards.",
        ),
        _in_px4,
        (1.0, "the thermal offset is updated after a change of 1 degC at the latest"),
    ),
    Target(
        "ardupilot",
        ".parm",
        "INS_ACCOFFS_*, INS_ACCSCAL_*: (A - OFFS) * SCAL, m/s^2",
        _ardupilot,
        _read_ardupilot,
        _DIAGONAL,
        "ArduPilot, libraries/AP_InertialSensor",
        (
            "INS_ACC_ID must be that of the sensor. Very old firmware scaled before it subtracted, and accepted only "
            "temperature ranges with a middle above 0 degC.",
            "The axes are those of the sensor, before board rotation.",
        ),
    ),
)
