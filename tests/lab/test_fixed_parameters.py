"""A parameter that is fixed at its nominal value is a part of the calibration, without uncertainty."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tumblecal.data import read_positions
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.estimation.intrinsic import matrix_and_bias, one_sensor, sensor_of
from tumblecal.estimation.methods import calibrate
from tumblecal.estimation.position_problem import default_chain
from tumblecal.ground.gravity import STANDARD, comments_of
from tumblecal.lab.use import gravity_findings


BIAS, SCALE = np.array([4e-3, 4e-4, -1.9e-3]), np.array([3e-4, 2e-4, 1.7e-3])
FACES = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)


@pytest.fixture
def faces(tmp_path):
    """Six faces of unknown attitude, tilted by a few degrees, with an exact sensor (g)."""
    tilted = FACES + np.random.default_rng(3).normal(0.0, 0.05, (6, 3)) * (FACES == 0)
    readings = tilted / np.linalg.norm(tilted, axis=1)[:, None] * (1 + SCALE) + BIAS
    rows = [f"{name},{x:.9f},{y:.9f},{z:.9f}" for name, (x, y, z) in zip("abcdef", readings, strict=True)]
    text = "\n".join(["# attitudes: unknown", "position,ax_g,ay_g,az_g", *rows, ""])
    (tmp_path / "hand.csv").write_text(text, encoding="utf-8")
    return read_positions(tmp_path / "hand.csv")


def test_six_faces_without_degrees_of_freedom_are_written_as_not_tested(tumblecal, faces, tmp_path):
    cal = tmp_path / "cal"
    outcome = tumblecal(
        "calibrate", faces.source, "--fix", "gamma", "--noise-sd", "0.1mg", "--out", cal, "--no-figures"
    )
    assert outcome.code == 0 and "calibration.json: not tested: 18 readings for 18 parameters" in outcome.out
    content = json.loads((cal / "calibration.json").read_text(encoding="utf-8"))
    assert content["use"]["answer"] == "not tested"
    np.testing.assert_allclose(content["bias"], BIAS, atol=1e-6)
    np.testing.assert_allclose(np.array(content["matrix"]), np.diag(1 / (1 + SCALE)), atol=1e-6)
    applied = tumblecal("apply", cal / "calibration.json", faces.source, "--out", tmp_path / "x.csv")
    assert applied.code == 0 and "not tested" in " ".join([applied.out, *applied.lines])


def test_a_fixed_parameter_has_no_uncertainty_and_is_not_listed_as_determined(faces):
    fit = calibrate(faces, chain=default_chain(faces).fixed({"gamma"}), noise_sd=1e-4).exact
    assert one_sensor(fit)
    sensor = sensor_of(fit)
    assert sensor.names == SENSOR and np.all(sensor.values[6:] == 0.0) and np.all(sensor.sd[6:] == 0.0)
    np.testing.assert_allclose(sensor.sd[:6], 1e-4 / np.sqrt(2), rtol=0.05)
    assert matrix_and_bias(fit)[0][1, 0] == 0.0
    assumed = replace(faces, comments=faces.comments | comments_of(STANDARD))
    (finding,) = gravity_findings(calibrate(assumed, chain=fit.problem.chain, noise_sd=1e-4).exact)
    assert finding.use.parameters == ("bias_x", "bias_y", "bias_z")
