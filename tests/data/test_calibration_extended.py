"""The inverse of an extended sensor model, against the forward model written out."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tumblecal.data.calibration import Calibration, read_calibration, write_calibration
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters
from tumblecal.data.temperature_curves import Curve, TemperatureCurves, order_of_covariance
from tumblecal.ground.errors import InputError
from tumblecal.ground.temperature_functions import TemperatureFunctions


SCALE = np.array([1.002, 0.997, 1.001])
TRIAD = np.array([[1, 0, 0], [2e-3, 1, 0], [-1e-3, 3e-3, 1]])
BIAS = np.array([1e-3, -2e-3, 5e-4])
TERMS = [
    {"axis": "x", "powers": [2, 0, 0], "coefficient": 4e-3},
    {"axis": "y", "powers": [0, 1, 0], "kind": "abs", "coefficient": -3e-3},
    {"axis": "z", "powers": [1, 1, 0], "coefficient": 2e-3},
    {"axis": "z", "powers": [0, 0, 1], "coefficient": 1e-4, "per_degc": True, "reference_degc": 25.0},
]


def forward(force, temperature):
    u = force @ TRIAD.T
    readings = u * SCALE + BIAS
    readings[:, 0] += 4e-3 * u[:, 0] ** 2
    readings[:, 1] += -3e-3 * np.abs(u[:, 1])
    readings[:, 2] += 2e-3 * u[:, 0] * u[:, 1] + 1e-4 * u[:, 2] * (temperature - 25)
    return readings


def calibration(terms):
    return Calibration(np.linalg.inv(np.diag(SCALE) @ TRIAD), BIAS, np.eye(12), extra={"terms": terms})


def test_inverse_is_exact():
    rng = np.random.default_rng(2)
    force, temperature = rng.uniform(-2, 2, (50, 3)), rng.uniform(-20, 60, 50)
    own = calibration(TERMS)
    np.testing.assert_allclose(own.corrected(forward(force, temperature), temperature), force, rtol=0, atol=1e-13)
    np.testing.assert_allclose(own.corrected(forward(force, 31.5), 31.5), force, rtol=0, atol=1e-13)
    with pytest.raises(InputError, match="need a column temperature_degc"):
        own.corrected(np.ones((4, 3)))
    with pytest.raises(InputError, match="cannot be inverted"):
        calibration([{"axis": "x", "powers": [3, 0, 0], "coefficient": 5.0}]).corrected(np.ones((4, 3)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axis": "w"}, r"terms\.1\.axis: must be one of x, y, z \(got 'w'\)"),
        ({"powers": [1, 0]}, r"terms\.1\.powers\.2: is missing"),
        ({"per_degc": True}, r"terms\.1: reference_degc is missing"),
        ({"per_degc": True, "degc_power": 2, "reference_degc": 25}, r"terms\.1: degc_power contradicts per_degc"),
    ],
)
def test_a_fault_of_a_term_names_the_file_the_key_and_what_is_allowed(tmp_path, change, words):
    path = tmp_path / "calibration.json"
    write_calibration(path, calibration([TERMS[0], TERMS[1] | change]))
    with pytest.raises(InputError, match=rf"^{re.escape(str(path))}: {words}"):
        read_calibration(path)
    write_calibration(path, calibration([TERMS[0], "x"]))
    with pytest.raises(InputError, match=r"calibration\.json: terms\.1: must be an object"):
        read_calibration(path)


def test_the_docs_ten_lines_are_what_apply_does(tmp_path, monkeypatch):
    """The blocks of docs/files.md, as they stand: with terms, and with parameters that follow temperature."""
    page = (Path(__file__).parents[2] / "docs" / "files.md").read_text(encoding="utf-8")
    block, of_curves = re.findall(r"^```python\n(.*?)^```", page, re.S | re.M)
    rng = np.random.default_rng(4)
    force, temperature = rng.uniform(-1, 1, (20, 3)), rng.uniform(0, 50, 20)
    readings = forward(force, temperature)
    write_calibration(tmp_path / "calibration.json", calibration(TERMS))
    monkeypatch.chdir(tmp_path)
    here = {"readings": readings, "temperature_degc": temperature}
    exec(block, here)
    np.testing.assert_allclose(here["force"], force, rtol=0, atol=1e-12)
    np.testing.assert_allclose(here["force"], calibration(TERMS).corrected(readings, temperature), rtol=0, atol=1e-12)
    curves = [
        Curve("bias_x", TemperatureFunctions(3, 22.0, (0.0, 50.0), (10.0, 30.0)), 1e-7 * np.arange(1.0, 6.0)),
        Curve("gamma_32", TemperatureFunctions(2, 22.0, (0.0, 50.0)), np.array([1e-5, -2e-7])),
    ]
    order = order_of_covariance(curves)
    followed = TemperatureCurves(tuple(curves), np.zeros((len(order), len(order))), order)
    values = np.concatenate([SCALE - 1, BIAS, TRIAD[[1, 2, 2], [0, 0, 1]]])
    parameters = SensorParameters(SENSOR, values, np.zeros((9, 9)))
    own = replace(calibration([]), extra={}, temperature=followed, parameters=parameters)
    write_calibration(tmp_path / "calibration.json", own)
    exec(block.partition("matrix, bias")[0], here)
    exec(of_curves, here)
    np.testing.assert_allclose(here["force"], own.corrected(readings, temperature), rtol=0, atol=1e-14)


def test_powers_of_the_temperature_about_several_references_are_inverted():
    degc_terms = [
        {"axis": "x", "powers": [0, 0, 0], "coefficient": 3e-6, "degc_power": 2, "reference_degc": 18.0},
        {"axis": "x", "powers": [0, 0, 0], "coefficient": -2e-8, "degc_power": 3, "reference_degc": 25.0},
        {"axis": "y", "powers": [0, 0, 1], "coefficient": 1e-7, "degc_power": 2, "reference_degc": 30.0},
    ]
    rng = np.random.default_rng(2)
    force, degc = rng.uniform(-1, 1, (50, 3)), rng.uniform(-20, 60, 50)
    u = force @ TRIAD.T
    readings = u * SCALE + BIAS
    readings[:, 0] += 3e-6 * (degc - 18) ** 2 - 2e-8 * (degc - 25) ** 3
    readings[:, 1] += 1e-7 * u[:, 2] * (degc - 30) ** 2
    np.testing.assert_allclose(calibration(degc_terms).corrected(readings, degc), force, rtol=0, atol=1e-13)


def test_a_reading_in_the_gap_of_a_sign_gets_its_middle():
    """A level triad reads near zero: the steps went to and fro there, and the whole file was refused."""
    jump = 1e-3
    own = calibration([{"axis": "y", "powers": [0, 1, 0], "kind": "sign", "coefficient": jump}])
    force = np.array([[0.2, 0.0, 0.9], [0.1, 0.4, 0.8], [0.3, -0.2, 0.7]])
    u = force @ TRIAD.T
    readings = u * SCALE + BIAS
    readings[1:, 1] += jump * np.sign(u[1:, 1])
    readings[0, 1] += 0.4 * jump - u[0, 1] * SCALE[1]
    made = own.corrected(readings)
    np.testing.assert_allclose(made[1:], force[1:], rtol=0, atol=1e-13)
    assert abs(made[0] @ TRIAD.T[:, 1]) < jump
