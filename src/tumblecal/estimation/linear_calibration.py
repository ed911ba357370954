"""The calibration of a fit without the terms of effects: matrix and bias of the sensor, its curves over temperature, origin."""

from datetime import UTC, datetime

import numpy as np

from tumblecal.data.calibration import Calibration
from tumblecal.data.position_comments import ATTITUDES, BY_HAND, UNKNOWN
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, correction_slope, leaf_of, triad_of
from tumblecal.data.source_of import SourceRecord
from tumblecal.data.temperature_curves import TemperatureCurves
from tumblecal.estimation.curves_of_fit import curves_of
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import sensor_of
from tumblecal.ground.frames import rotation_matrix


def linear_calibration(result: Fit) -> Calibration:
    """Matrix and bias of the sensor alone; if they follow temperature, at the reference temperature, with the curves.

    **Raises:** `KeyError` when the sensor's parameters are not one for all data.
    """
    estimated = [name for name in result.names if name in SENSOR or leaf_of(name) == "dtheta"]
    names = (*estimated, *(name for name in SENSOR if name not in estimated))
    return calibration_with(result, sensor_of(result, names), curves_of(result))


def _attitudes(result: Fit) -> dict[str, str]:
    """How the attitudes were set, for a chain with tilts: near stated angles if the tilts have a prior."""
    tilts = np.array([leaf_of(name) == "tilt" for name in result.problem.chain.names], bool)
    if not np.any(tilts):
        return {}
    return {ATTITUDES: BY_HAND if np.any(result.problem.prior_root[:, tilts]) else UNKNOWN}


def calibration_with(result: Fit, parameters: SensorParameters, curves: TemperatureCurves | None) -> Calibration:
    """The calibration of a fit with these parameters, of which some may be from elsewhere, and curves."""
    data, degc, sensor = result.data, result.data.temperature_degc, parameters.of(SENSOR)
    slope = correction_slope(sensor.values)
    turned = [result.value(name) for name in ("dtheta_x", "dtheta_y", "dtheta_z") if name in result.names]
    return Calibration(
        matrix=np.linalg.inv(triad_of(sensor.values)),
        bias=sensor.values[3:6],
        covariance=slope @ sensor.covariance @ slope.T,
        alignment=rotation_matrix(np.array(turned)).T if len(turned) == 3 else None,
        temperature_degc=curves.reference_degc if curves else None if degc is None else float(np.mean(degc)),
        serial_number=data.serial_number,
        gravity=data.gravity,
        provenance={
            **SourceRecord.of(data).plain(),
            **_attitudes(result),
            "method": result.method,
            "code": result.code.name,
            "sigma_g": float(result.sigma) if np.isfinite(result.sigma) else None,
            "dof": result.dof if result.noise == "estimated" else None,
            **({} if degc is None else {"temperature_range_degc": [float(np.min(degc)), float(np.max(degc))]}),
            "date_utc": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        },
        parameters=parameters,
        temperature=curves,
    )
