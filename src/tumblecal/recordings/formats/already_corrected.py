"""Logs of autopilots whose readings are already corrected for temperature, as their parameters state.

PX4: `TC_A_ENABLE` and `TC_An_ID`. `sensor_accel` is what the driver measured; `sensor_combined`, `vehicle_imu` and
`vehicle_acceleration` contain `calibration::Accelerometer::Correct(data) = (data - thermal - offset) * scale`
(PX4-Autopilot, src/lib/sensor_calibration/Accelerometer.hpp, src/modules/sensors/vehicle_imu and vehicle_acceleration;
docs.px4.io, msg_docs/SensorCombined: "scaled and offset-compensated").

ArduPilot: `INS_TCALn_ENABLE` = 1. All logged accelerations are those after `_rotate_and_correct_accel`
(libraries/AP_InertialSensor/AP_InertialSensor_Backend.cpp); Tools/scripts/tempcal_IMU.py undoes the correction for this reason.
"""

from collections.abc import Collection, Mapping

from tumblecal.recordings.damage import DamageRecord


# The statement of a table, and of the samples that are written from it: parameters; remedy.
TEMPERATURE_CORRECTED_BY = "temperature_corrected_by"
PX4_CORRECTED_TOPICS = frozenset(("sensor_combined", "vehicle_imu", "vehicle_acceleration"))
_PX4_IDS = [f"TC_A{k}_ID" for k in range(4)]


def px4_correction(
    parameters: Mapping[str, float], selected: Collection[int], topics: Collection[str]
) -> dict[str, str]:
    """The statement of a corrected topic of PX4; none if the thermal correction is disabled, or for other sensors.

    **Arguments:**

    - `selected`: device ids of the selected accelerometers; none if the log does not state them. `topics`: of the log.
    """
    ids = [
        f"{name} {number}"
        for name in _PX4_IDS
        if (number := int(parameters.get(name, 0))) in (selected or {number}) and number
    ]
    if parameters.get("TC_A_ENABLE") != 1 or not ids:
        return {}
    raw = "read --topic sensor_accel, which is not corrected, or " if "sensor_accel" in topics else ""
    return {TEMPERATURE_CORRECTED_BY: f"TC_A_ENABLE 1, {', '.join(ids)}; {raw}record again with TC_A_ENABLE 0"}


def ardupilot_correction(enabled: Collection[int], instance: int) -> dict[str, str]:
    """The statement of the table of an instance of a sensor, from 0; none if its `INS_TCALn_ENABLE` is not 1.

    **Arguments:**

    - `enabled`: the numbers n of `INS_TCALn_ENABLE` with the value 1.
    """
    name = f"INS_TCAL{instance + 1}_ENABLE"
    return {TEMPERATURE_CORRECTED_BY: f"{name} 1; record again with {name} 0"} if instance + 1 in enabled else {}


def already_corrected(stated: Mapping[str, str]) -> list[DamageRecord]:
    """The record of a table that states a correction for temperature; none otherwise."""
    by, _, remedy = stated.get(TEMPERATURE_CORRECTED_BY, "").partition("; ")
    finding = f"the device has corrected these readings for temperature ({by}), so a calibration corrects them twice"
    return [DamageRecord("corrected", f"{finding}: {remedy}")] if by else []
