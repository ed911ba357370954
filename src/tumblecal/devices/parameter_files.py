"""Parameter files of autopilots: an offset and a scale factor for each axis, and the bias over temperature."""

import math
import re
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.polynomial import Polynomial

from tumblecal.data.calibration import Calibration
from tumblecal.devices.over_temperature import ORDER, bias_polynomials, export_degc, of_numbers, polynomial_terms
from tumblecal.devices.target import DIAGONAL, Export, Target, number
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


@dataclass(frozen=True)
class Names:
    """The names of an autopilot, with `{0}` for the axis, and its convention: `(A - thermal - offset) * scale`, m/s^2.

    - `line`: of a parameter, with its name and value. `first`: line before all. `enable`: line that enables the rest.
    - `low`, `high`, `stated`: temperature range, and the temperature of the offset. `power`: coefficient of the bias by a power
      (`{1}`) of the temperature minus `about_degc` (default: minus `stated`), axis `{0}` or its number `{2}`; `unit` of it.
    - `powers`: those that the file states. `offsets`, `scales`: ranges that the autopilot accepts.
    """

    line: str
    offset: str
    scale: str
    enable: str
    low: str
    high: str
    stated: str
    power: str
    powers: tuple[int, ...]
    about_degc: float | None = None
    unit: float = 1.0
    first: str = ""
    offsets: float = math.inf
    scales: tuple[float, float] = (-math.inf, math.inf)

    def coefficient(self, power: int, number: int) -> str:
        """The name of a coefficient of the bias."""
        return self.power.format(AXES[number].upper(), power, number)


# PX4 uses offsets (m/s^2), or scale factors, only if the vector differs by more than this from its present one (0, 1).
PX4_DEAD_BAND = 0.01
_PX4 = Names(
    line="1\t1\t{}\t{}\t9",  # 9, 6: types of MAVLink
    offset="CAL_ACC0_{}OFF",
    scale="CAL_ACC0_{}SCALE",
    enable="1\t1\tTC_A_ENABLE\t1\t6",
    low="TC_A0_TMIN",
    high="TC_A0_TMAX",
    stated="TC_A0_TREF",
    power="TC_A0_X{1}_{2}",
    powers=(0, 1, 2, 3),
    first="# Vehicle-Id Component-Id Name Value Type\n",
)
_ARDUPILOT = Names(
    line="{},{}",
    offset="INS_ACCOFFS_{}",
    scale="INS_ACCSCAL_{}",
    enable="INS_TCAL1_ENABLE,1",
    low="INS_TCAL1_TMIN",
    high="INS_TCAL1_TMAX",
    stated="INS_ACC1_CALTEMP",
    power="INS_TCAL1_ACC{1}_{0}",
    powers=(1, 2, 3),
    about_degc=35.0,  # TEMP_REFERENCE of AP_InertialSensor_tempcal.cpp
    unit=1e6,
    offsets=3.5,
    scales=(0.8, 1.2),
)


def _write(names: Names, export: Export) -> str:
    calibration, span, lines = export.calibration, export.temperatures_degc, list[str]()
    offset, scale, (low, high) = export.bias_ms2, np.diag(calibration.matrix), names.scales
    if np.any(np.abs(offset) > names.offsets) or np.any((scale < low) | (scale > high)):
        raise InputError(
            f"ArduPilot accepts offsets up to {names.offsets:g} m/s^2 and scale factors of {low:g} to {high:g}; this unit "
            f"has {np.max(np.abs(offset)):.3g} m/s^2 and {np.min(scale):.3g} to {np.max(scale):.3g}: use a different target"
        )
    values = {
        name.format(axis.upper()): float(array[k])
        for name, array in ((names.offset, offset), (names.scale, scale))
        for k, axis in enumerate(AXES)
    }
    if span is not None and any(term.thermal for term in calibration.terms):
        stated = export_degc(calibration, span)
        powers = bias_polynomials(calibration, stated if names.about_degc is None else names.about_degc)
        powers *= export.gravity_ms2 * names.unit
        lines.append(names.enable)
        values |= {names.low: span[0], names.high: span[1], names.stated: stated}
        values |= {names.coefficient(power, k): float(powers[power, k]) for power in names.powers for k in range(3)}
    lines += [names.line.format(name, number(value, float32=True)) for name, value in values.items()]
    return export.commented("#") + names.first + "\n".join(lines) + "\n"


def _read(names: Names, text: str, gravity_ms2: float) -> Calibration:
    offset, scale = (
        np.array([_parameter(text, name.format(axis.upper())) for axis in AXES]) for name in (names.offset, names.scale)
    )
    powers = np.zeros((ORDER + 1, len(AXES)))
    for power in names.powers:
        powers[power] = [_parameter(text, names.coefficient(power, k), 0.0) / names.unit for k in range(3)]
    # The device uses the difference of the polynomial from its value at the temperature of the offset.
    stated, terms = _parameter(text, names.stated, 25.0), []
    step = Polynomial([0.0 if names.about_degc is None else stated - names.about_degc, 1.0])
    for k, axis in enumerate(AXES):
        terms += polynomial_terms(axis, np.asarray(Polynomial(powers[:, k] / gravity_ms2)(step).coef), stated)
    read = of_numbers(np.diag(scale), (offset + powers[0]) / gravity_ms2, terms)
    return replace(read, temperature_degc=stated if terms else None)


def _parameter(text: str, name: str, default: float | None = None) -> float:
    """The value of a parameter: the text after its name up to a blank, or up to the type in a table with commas.

    **Raises:** `InputError` if it is missing without a default, or is not a finite number.
    """
    line = re.search(rf"^(?![ \t]*#)(.*)\b{name}\b(?: *[\t,=:] *| *)(\S*)", text, re.MULTILINE)
    if line is None and default is not None:
        return default
    if line is None:
        raise InputError(f"{name} is missing; add it to the file")
    stated = re.sub(r",\d*$", "", line[2]) if "," in line[1] else line[2].rstrip(",;")
    try:
        value = float(stated)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{name}: {stated!r} is not a number (a point is its decimal mark)")
    return value


def _in_px4(calibration: Calibration, export: Export) -> tuple[Calibration, str]:
    """The calibration that PX4 applies: offsets and scale factors whose vector is within the dead band are ignored."""
    far_offset = float(np.linalg.norm(calibration.bias * export.gravity_ms2))
    far_scale, dropped = float(np.linalg.norm(np.diag(calibration.matrix) - 1)), list[str]()
    if far_offset <= PX4_DEAD_BAND:
        calibration = replace(calibration, bias=np.zeros(3))
        dropped.append(f"the offsets ({far_offset:.2g} m/s^2)")
    if far_scale <= PX4_DEAD_BAND:
        calibration = replace(calibration, matrix=np.eye(3))
        dropped.append(f"the scale factors ({far_scale:.2g} from 1)")
    return calibration, f"PX4's dead band of {PX4_DEAD_BAND:g}, which drops {' and '.join(dropped) or 'nothing here'}"


TARGETS = (
    Target(
        "px4",
        "CAL_ACC0_*: (A - thermal - OFF) * SCALE, m/s^2",
        partial(_write, _PX4),
        partial(_read, _PX4),
        DIAGONAL,
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
        "INS_ACCOFFS_*, INS_ACCSCAL_*: (A - OFFS) * SCAL, m/s^2",
        partial(_write, _ARDUPILOT),
        partial(_read, _ARDUPILOT),
        DIAGONAL,
        "ArduPilot, libraries/AP_InertialSensor",
        (
            "INS_ACC_ID must be that of the sensor. Very old firmware scaled before it subtracted, and accepted only "
            "temperature ranges with a middle above 0 degC.",
            "The axes are those of the sensor, before board rotation.",
        ),
    ),
)
