"""A calibration whose parameters follow temperature, against the forward model written out in numpy."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from tumblecal.data.calibration import Calibration, calibration_text, read_calibration
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.data.temperature_curves import Curve, Hysteresis, TemperatureCurves, order_of_covariance
from tumblecal.ground.errors import InputError
from tumblecal.ground.temperature_functions import TemperatureFunctions
from tumblecal.history.comparison import common_temperature


T0, RANGE = 22.0, (-10.0, 60.0)
VALUES = np.array([2e-3, -3e-3, 1e-3, 1e-3, -2e-3, 5e-4, 2e-3, -1e-3, 3e-3])
KNOTS = (5.0, 40.0)
# Coefficients of T - T0, its powers, and for the spline max(T - knot, 0)^3 - max(T0 - knot, 0)^3.
COEFFICIENTS = {
    "bias_x": [1e-4, -2e-6, 3e-8],
    "bias_z": [2e-4, 1e-6, -2e-8, 4e-8, -6e-8],
    "dK_y": [1e-4],
    "gamma_31": [-2e-5, 1e-7],
    "dK_z": [],
}


def parameters_at(degc, coefficients=COEFFICIENTS, values=VALUES):
    """The nine parameters, (rows, 9)."""
    above = np.asarray(degc, float) - T0
    parameters = np.tile(values, (len(above), 1))
    for name, numbers in coefficients.items():
        functions = [above, above**2, above**3] if name in ("bias_x", "bias_z") else [above, above**2]
        for knot in KNOTS if name == "bias_z" else ():
            functions.append(np.clip(above + T0 - knot, 0, None) ** 3 - max(T0 - knot, 0) ** 3)
        for number, function in zip(numbers, functions, strict=False):
            parameters[:, SENSOR.index(name)] += number * function
    return parameters


def forward(force, degc, *, square=0.0):
    readings = np.empty_like(force)
    for row, (f, p) in enumerate(zip(force, parameters_at(degc), strict=True)):
        u = np.array([[1, 0, 0], [p[6], 1, 0], [p[7], p[8], 1]]) @ f
        readings[row] = (1 + p[:3]) * u + p[3:6] + square * np.array([0, 0, u[2] ** 2])
    return readings


def functions_of(name, order=None):
    order = len(COEFFICIENTS[name]) if order is None else order
    return TemperatureFunctions(3 if name == "bias_z" else order, T0, RANGE, KNOTS if name == "bias_z" else ())


def curves(root=None, hysteresis=()):
    made = tuple(Curve(name, functions_of(name), np.array(numbers)) for name, numbers in COEFFICIENTS.items())
    order = order_of_covariance(made)
    root = np.zeros((len(order), 1)) if root is None else root
    return TemperatureCurves(made, root @ root.T, order, hysteresis)


@pytest.fixture(scope="module")
def root():
    """A root of the joint covariance: each entry has a size near that of its value."""
    sizes = np.concatenate([np.full(9, 3e-5), *(np.abs(numbers) / 30 for numbers in COEFFICIENTS.values())])
    return sizes[:, None] * np.random.default_rng(1).normal(size=(len(sizes), len(sizes))) / np.sqrt(len(sizes))


def calibration(temperature, **keys):
    triad = np.diag(1 + VALUES[:3]) @ np.array([[1, 0, 0], [VALUES[6], 1, 0], [VALUES[7], VALUES[8], 1]])
    parameters = SensorParameters(SENSOR, VALUES, temperature.covariance[:9, :9])
    zeros = np.zeros((12, 12))
    return Calibration(np.linalg.inv(triad), VALUES[3:6], zeros, parameters=parameters, temperature=temperature, **keys)


def test_the_inverse_is_exact_at_each_temperature_with_and_without_terms():
    rng = np.random.default_rng(2)
    force, degc = rng.uniform(-2, 2, (300, 3)), rng.uniform(*RANGE, 300)
    own = calibration(curves())
    np.testing.assert_allclose(own.corrected(forward(force, degc), degc), force, rtol=0, atol=1e-13)
    square = [{"axis": "z", "powers": [0, 0, 2], "coefficient": 4e-3}]
    with_term = replace(own, extra={"terms": square})
    back = with_term.corrected(forward(force, degc, square=4e-3), degc)
    np.testing.assert_allclose(back, force, rtol=0, atol=1e-13)
    one = own.corrected(forward(force, np.full(300, 31.0)), 31)
    np.testing.assert_allclose(one, force, rtol=0, atol=1e-13)
    # In a different frame the force is rotated with the matrix.
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turned *= np.linalg.det(turned)
    readings = forward(force, degc, square=4e-3)
    for parameters in (own.parameters, None):
        rotated = replace(with_term, matrix=turned @ own.matrix, parameters=parameters)
        np.testing.assert_allclose(rotated.corrected(readings, degc), force @ turned.T, rtol=0, atol=1e-13)


def test_the_calibration_at_one_temperature(root):
    own = calibration(curves(root))
    for degc in (-10.0, 22.0, 47.3):
        (truth,) = parameters_at([degc])
        at = own.at(degc)
        np.testing.assert_allclose(at.sensor.values, truth, rtol=0, atol=1e-15)
        triad = np.diag(1 + truth[:3]) @ np.array([[1, 0, 0], [truth[6], 1, 0], [truth[7], truth[8], 1]])
        np.testing.assert_allclose(at.matrix @ triad, np.eye(3), rtol=0, atol=1e-14)
        np.testing.assert_allclose(at.bias, truth[3:6], rtol=0, atol=1e-15)
        assert at.temperature is None and at.temperature_degc == degc
        np.testing.assert_allclose(at.corrected(np.eye(3)), own.corrected(np.eye(3), degc), rtol=0, atol=1e-14)
    assert replace(own, temperature=None).at(30.0).bias is own.bias


def test_the_covariance_is_that_of_sampled_coefficients(root):
    """Monte Carlo: parameters and coefficients from the joint covariance, through the forward model."""
    count, degc = 40_000, 55.0
    drawn = (root @ np.random.default_rng(5).normal(size=(len(root), count))).T
    samples, first = drawn[:, :9] + VALUES, 9
    above = degc - T0
    at_knots = [(degc - knot) ** 3 - max(T0 - knot, 0) ** 3 for knot in KNOTS]
    for name, numbers in COEFFICIENTS.items():
        functions = np.array([above, above**2, above**3, *at_knots])[: len(numbers)]
        samples[:, SENSOR.index(name)] += (drawn[:, first : first + len(numbers)] + numbers) @ functions
        first += len(numbers)
    own = calibration(curves(root, (Hysteresis("bias_y", 6e-5, "g"),)), provenance={"dof": 12})
    at = own.at(degc)
    expected = np.cov(samples.T)
    expected[4, 4] += (6e-5) ** 2 / 3
    sd = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(at.sensor.covariance / np.outer(sd, sd), expected / np.outer(sd, sd), rtol=0, atol=0.03)
    np.testing.assert_allclose(own.temperature.sd(np.array([degc]))[0], at.sensor.sd, rtol=1e-12)
    np.testing.assert_allclose(at.covariance[9:, 9:], at.sensor.covariance[3:6, 3:6], rtol=1e-12)
    # matrix_11 = 1 / (1 + dK_x)
    np.testing.assert_allclose(
        at.covariance[0, 0], at.sensor.covariance[0, 0] / (1 + at.sensor.values[0]) ** 4, rtol=1e-9
    )
    # Hysteresis is no part of the estimated noise (Welch and Satterthwaite), also at the reference temperature.
    noise = at.sensor.covariance[4, 4] - (6e-5) ** 2 / 3
    assert at.sensor.effective_dof[4] == pytest.approx(12 * (at.sensor.covariance[4, 4] / noise) ** 2)
    assert at.sensor.effective_dof[3] == pytest.approx(12)
    np.testing.assert_allclose(own.sensor.covariance, own.at(T0).sensor.covariance, rtol=1e-12, atol=1e-30)


def test_outside_the_range_is_an_error_unless_extrapolated(root):
    own = calibration(curves(root))
    readings, degc = np.ones((4, 3)), np.array([20.0, 70.0, 61.0, 60.0004])
    with pytest.raises(InputError, match=r"^2 of 4 temperatures outside the measured -10 to 60 degC \(61 to 70 degC\)"):
        own.corrected(readings, degc)
    with pytest.raises(InputError, match=r"1 of 1 temperature outside .* \(-11 degC\)"):
        own.at(-11.0)
    with pytest.raises(InputError, match="1 of 4 temperatures are not finite"):
        own.corrected(readings, np.array([20.0, np.nan, 30.0, 40.0]), extrapolate=True)
    with pytest.raises(InputError, match="has temperature terms: the data need a column temperature_degc"):
        own.corrected(readings)
    force = own.corrected(forward(readings, degc), degc, extrapolate=True)
    np.testing.assert_allclose(force, readings, rtol=0, atol=1e-13)
    sd = own.at(90.0, extrapolate=True).sensor.sd
    assert np.all(sd[[1, 3, 5, 7]] > own.at(60.0).sensor.sd[[1, 3, 5, 7]])


def test_the_file_is_read_and_written_without_a_change(tmp_path, root):
    own = calibration(curves(root, (Hysteresis("bias_x", 1e-4, "g"), Hysteresis("gamma_21", 1e-5, "rad"))))
    path = tmp_path / "calibration.json"
    text = calibration_text(own)
    path.write_text(text)
    back = read_calibration(path)
    assert calibration_text(back) == text
    assert json.loads(text)["temperature"]["curves"][1]["units"] == ["g/degC", "g/degC^2", *["g/degC^3"] * 3]
    words = (
        "at 22 degC; by temperature from -10 to 60 degC: bias_x order 3, bias_z cubic spline with 2 knots, dK_y order 1"
    )
    assert words in repr(back)
    np.testing.assert_array_equal(back.at(50.0).covariance, own.at(50.0).covariance)


def test_a_fault_names_the_key(tmp_path, root):
    path = tmp_path / "calibration.json"
    content = json.loads(calibration_text(calibration(curves(root, (Hysteresis("bias_x", 1e-4, "g"),)))))

    def faults(words, change):
        changed = json.loads(json.dumps(content))
        change(changed["temperature"])
        path.write_text(json.dumps(changed))
        with pytest.raises(InputError, match=rf"^{re.escape(str(path))}: temperature{words}") as error:
            read_calibration(path)
        assert len(error.value.faults) == 1

    def first(**keys):
        return lambda part: part["curves"][0].update(keys)

    def entry(row, column, value):
        return lambda part: (
            part["covariance"][row].__setitem__(column, value),
            part["covariance"][column].__setitem__(row, value),
        )

    faults(r"\.curves\.0\.parameter: must be one of dK_x", first(parameter="dtheta_x"))
    faults(r": curves\.0: bias_x: 2 coefficients, but its functions .* need 3", first(coefficients=[1e-4, 0.0]))
    faults(r": curves\.0: bias_x: the units must be g/degC, g/degC\^2", first(units=["mg/degC"] * 3))
    faults(r": curves\.0: knots 70 degC: they must increase within the range", first(knots_degc=[70.0]))
    faults(r": two curves of bias_x; state one", lambda part: part["curves"].append(part["curves"][0]))
    faults(r": the order of the covariance must be dK_x", lambda part: part["covariance_order"].reverse())
    # A correlation above 1 of two coefficients whose variances are far below the largest variance.
    large = 2 * np.sqrt(content["temperature"]["covariance"][14][14] * content["temperature"]["covariance"][15][15])
    faults(r": covariance must be positive semidefinite", entry(14, 15, large))
    faults(
        r"\.hysteresis\.0\.half_width: must be 0 or more", lambda part: part["hysteresis"][0].update(half_width=-1.0)
    )


def test_calibrations_are_compared_at_a_common_temperature(tumblecal, tmp_path, root):
    own = calibration(curves(root))
    (at_30,) = parameters_at([30.0])
    constant = replace(own.at(30.0), temperature_degc=30.0)
    for name, each in (("old", own), ("new", constant), ("hot", replace(constant, temperature_degc=70.0))):
        (tmp_path / f"{name}.json").write_text(calibration_text(each))
    outcome = tumblecal("compare", tmp_path / "old.json", tmp_path / "new.json")
    assert outcome.code == 0 and "both at 30 degC; the dependence on temperature is not compared" in outcome.out
    (line,) = [line for line in outcome.out.splitlines() if line.split()[:1] == ["bias_z"]]
    assert f"{1e3 * at_30[5]:.3f}" in line
    assert own.temperature.usual_degc == 25.0 and common_temperature(own, own) == T0
    outcome = tumblecal("compare", tmp_path / "old.json", tmp_path / "hot.json")
    assert outcome.code == 2 and len(outcome.lines) == 1 and "no common temperature" in outcome.lines[0]
