"""Diagnosis of parameters that follow the temperature, and of hysteresis: independent simulator (numpy), soaks up and down."""

import numpy as np
import pytest

import tumblecal
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser
from tumblecal.diagnosis.causes.identities import one_function_at_1_g
from tumblecal.diagnosis.coefficients import about_one_reference, temperature_orders
from tumblecal.diagnosis.sets.classes import other_orders
from tumblecal.effects import catalogue
from tumblecal.estimation import problem_of
from tumblecal.full_model.full_model import model_of
from tumblecal.lab.diagnosed import extended_calibration


SD = 1e-4
UP = [-10.0, 8.0, 25.0, 43.0, 60.0]
ALPHA, BETA = (grid.ravel() for grid in np.meshgrid([0.0, 90.0, 180.0, 270.0], [0.0, 45.0, 90.0]))
SCALE, BIAS = np.array([2e-4, -1e-4, 3e-4]), np.array([1.1e-3, -0.8e-3, 0.8e-3])
# Of the share (T - 25)/35: bias of third order on every axis, g.
CUBIC = np.array([[3e-3, -2e-3, 4e-3], [-2e-3, 3e-3, -3e-3], [2.5e-3, 2e-3, 3e-3]])
HYSTERESIS_Y = 0.5e-3


def specific_force(alpha, beta):
    """`Rx(alpha) Ry(beta) (0, 0, 1)`."""
    across = np.cos(beta)
    return np.column_stack([-np.sin(beta), across * np.sin(alpha), across * np.cos(alpha)])


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


@pytest.mark.long
def test_a_lag_between_thermometer_and_sensor_has_its_name():
    """Ramps up and down at 0.9 degC a minute; the sensor follows with 15 minutes (steps of a second, numpy)."""
    rng, count, tau = np.random.default_rng(5), 108, 900.0
    fine = np.arange(0.0, 90.0 * count)
    degc = np.interp(fine, [0.0, 45.0 * (count - 1), 90.0 * (count - 1)], [-10.0, 60.0, -10.0])
    sensor = degc.copy()
    for n in range(1, len(fine)):
        sensor[n] = sensor[n - 1] + (degc[n - 1] - sensor[n - 1]) / tau
    time, alpha, beta = 90.0 * np.arange(count), np.tile(ALPHA, 9), np.tile(BETA, 9)
    thermometer, warm = (np.interp(time, fine, of)[:, None] for of in (degc, sensor - 25.0))
    slopes = np.array([2e-4, -1e-4, 1.5e-4])
    readings = (1 + SCALE + 1e-4 * warm) * specific_force(np.radians(alpha), np.radians(beta)) + BIAS + slopes * warm
    readings += SD * rng.normal(size=readings.shape)
    names = tuple(f"p{k}" for k in range(count))
    data = PositionSet(names, alpha, beta, readings, time_s=time, temperature_degc=thermometer[:, 0])
    diagnosis = Diagnoser(nested=False)(data, noise_sd=SD)
    assert diagnosis.verdict == "identified"
    linear = {f"{of}_temperature.{axis}" for of in ("bias", "scale") for axis in "xyz"}
    assert set(diagnosis.labels) == {*linear, "temperature_lag"}
    fit = diagnosis.extended
    true = {"temperature_lag_tau": tau, "temperature_lag_scale_z": -1e-4}
    true |= {f"temperature_lag_bias_{axis}": -slope for axis, slope in zip("xyz", slopes, strict=True)}
    for name, value in true.items():
        k = fit.names.index(name)
        assert abs(fit.values[k] - value) < 4 * fit.sd[k]


@pytest.mark.long
def test_orders_of_one_parameter_are_one_explanation(data):
    problem = problem_of(data, noise_sd=SD)
    slots = model_of(problem.chain, problem.where, catalogue()).slots
    of = {slot.id: number for number, slot in enumerate(slots)}
    cubic, quartic = of["bias_temperature_cubic.x"], of["bias_temperature_quartic.x"]
    pair = [of["bias_temperature.x"], of["bias_temperature_square.x"]]
    scale = of["scale_temperature_cubic.x"]
    linear, square = pair
    rows = [[cubic], [quartic], pair, [linear], [square], [scale], [cubic, scale]]
    sets = np.array([row + [-1] * (3 - len(row)) for row in rows])
    same = other_orders(slots, sets)
    assert np.flatnonzero(same[0]).tolist() == [1, 2, 3, 4]
    assert np.flatnonzero(same[3]).tolist() == [0, 1]  # one power and another alone are two causes
    assert not one_function_at_1_g([slots[cubic]], [slots[quartic]])
