"""Diagnosis of parameters that follow the temperature, and of hysteresis: independent simulator (numpy), soaks up and down."""

import numpy as np
import pytest

import tumblecal
from independent import specific_force
from tumblecal.data import PositionSet
from tumblecal.diagnosis.coefficients import about_one_reference, temperature_orders
from tumblecal.lab.diagnosed import extended_calibration


SD = 1e-4
UP = [-10.0, 8.0, 25.0, 43.0, 60.0]
ALPHA, BETA = (grid.ravel() for grid in np.meshgrid([0.0, 90.0, 180.0, 270.0], [0.0, 45.0, 90.0]))
SCALE, BIAS = np.array([2e-4, -1e-4, 3e-4]), np.array([1.1e-3, -0.8e-3, 0.8e-3])
# Of the share (T - 25)/35: bias of third order on every axis, g.
CUBIC = np.array([[3e-3, -2e-3, 4e-3], [-2e-3, 3e-3, -3e-3], [2.5e-3, 2e-3, 3e-3]])
HYSTERESIS_Y = 0.5e-3


def bias(degc):
    share = (np.asarray(degc)[:, None] - 25.0) / 35.0
    return BIAS + sum(CUBIC[:, power - 1] * share**power for power in (1, 2, 3))


@pytest.fixture(scope="module")
def data():
    """Twelve positions at each of nine soaks, up and down; a cubic bias, and hysteresis of y."""
    rng = np.random.default_rng(3)
    soaks = np.array(UP + UP[-2::-1])
    direction = np.array([0, 1, 1, 1, 1, -1, -1, -1, -1])
    count = len(ALPHA)
    alpha, beta = np.tile(ALPHA, len(soaks)), np.tile(BETA, len(soaks))
    degc = np.repeat(soaks, count) + 0.05 * rng.normal(size=len(alpha))
    time = 60.0 * np.arange(len(alpha)) + 1800.0 * np.repeat(np.arange(len(soaks)), count)
    readings = (1 + SCALE) * specific_force(np.radians(alpha), np.radians(beta)) + bias(degc)
    readings[:, 1] += HYSTERESIS_Y * np.repeat(direction, count)
    readings += SD * rng.normal(size=readings.shape)
    names = tuple(f"p{k}" for k in range(len(alpha)))
    return PositionSet(names, alpha, beta, readings, time_s=time, temperature_degc=degc)


@pytest.fixture(scope="module")
def diagnosis(data):
    return tumblecal.diagnose(data, noise_sd=SD)


@pytest.mark.long
def test_a_cubic_bias_is_one_cause_per_axis_and_hysteresis_has_its_name(diagnosis):
    cubic = tuple(f"bias_temperature_cubic.{axis}" for axis in "xyz")
    assert diagnosis.verdict == "identified"
    assert set(diagnosis.labels) == {*cubic, "bias_hysteresis.y"}
    assert temperature_orders(diagnosis.members) == {"bias_x": 3, "bias_y": 3, "bias_z": 3}
    fit = diagnosis.extended
    for row, axis in enumerate("xyz"):
        for power in (1, 2, 3):
            k = fit.names.index(f"bias_temperature_cubic.{axis}" + (f"^{power}" if power > 1 else ""))
            assert abs(fit.values[k] - CUBIC[row, power - 1] / 35.0**power) < 5 * fit.sd[k]
    k = fit.names.index("bias_hysteresis.y")
    assert abs(fit.values[k] - HYSTERESIS_Y) < 5 * fit.sd[k]
    (first,) = (cause for cause in diagnosis.members if cause.label == cubic[0])
    sizes, reference = about_one_reference(diagnosis, [first])
    assert [size.unit for size in sizes] == ["mg/degC", "ug/degC^2", "ug/degC^3"] and reference == 25


@pytest.mark.long
def test_the_calibration_corrects_left_out_temperatures_to_the_noise(diagnosis):
    calibration = extended_calibration(diagnosis)
    assert calibration is not None
    degc = np.repeat([0.0, 17.0, 34.0, 51.0], len(ALPHA))
    f = np.tile(specific_force(np.radians(ALPHA), np.radians(BETA)), (4, 1))
    corrected = calibration.corrected((1 + SCALE) * f + bias(degc), degc)
    assert np.sqrt(np.mean((corrected - f) ** 2)) < 0.6 * SD  # 1.6 mg without terms of temperature
    (loss,) = (loss for loss in calibration.not_applied if loss.effect == "bias_hysteresis.y")
    assert "direction in which the temperature was reached" in loss.reason
