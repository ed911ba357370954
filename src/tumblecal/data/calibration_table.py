"""The lookup table of a calibration: sensor parameters with their standard uncertainty over temperature."""

from collections.abc import Sequence

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SENSOR, UNITS
from tumblecal.ground.errors import InputError


_NAMED = {name: name if UNITS[name] == "1" else f"{name}_{UNITS[name]}" for name in SENSOR}
# Names of the columns: `temperature_degc`, then `dK_x`, `u_dK_x`, ..., `bias_x_g`, `u_bias_x_g`, ..., `u_gamma_32_rad`.
COLUMNS = ("temperature_degc", *(column for name in _NAMED.values() for column in (name, f"u_{name}")))


def calibration_table(
    calibration: Calibration, temperatures_degc: Sequence[float], *, extrapolate: bool = False
) -> list[dict[str, float]]:
    """A row for each temperature, with the keys `COLUMNS`; uncertainties include hysteresis.

    **Raises:** `InputError` if the parameters do not follow temperature, and for temperatures outside the measured range
    unless `extrapolate` is set.

    Examples:
        >>> from tumblecal.data.temperature_curves import Curve, TemperatureCurves, order_of_covariance
        >>> from tumblecal.ground.temperature_functions import TemperatureFunctions
        >>> curve = Curve("bias_x", TemperatureFunctions(1, 25.0, (0.0, 60.0)), np.array([1e-4]))
        >>> curves = TemperatureCurves((curve,), np.diag([1e-10] * 9 + [0.0]), order_of_covariance([curve]))
        >>> calibration = Calibration(np.eye(3), np.zeros(3), np.zeros((12, 12)), temperature=curves)
        >>> row = calibration_table(calibration, [35.0])[0]
        >>> round(row["bias_x_g"], 9), round(row["u_bias_x_g"], 9)
        (0.001, 1e-05)
    """
    curves, degc = calibration.temperature, np.array(temperatures_degc, float)
    if curves is None:
        raise InputError(
            "the parameters of this calibration do not follow temperature: it has no table over temperature"
        )
    curves.require_range(degc, extrapolate=extrapolate)
    values, sd = calibration.sensor.of(SENSOR).values + curves.at(degc), curves.sd(degc)
    numbers = np.column_stack([degc, np.stack([values, sd], axis=2).reshape(len(degc), -1)])
    return [dict(zip(COLUMNS, row, strict=True)) for row in numbers.tolist()]
