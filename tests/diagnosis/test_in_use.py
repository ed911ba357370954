"""What a calibration states is meant for the middle of what was measured, and its uncertainty holds what is left open."""

import numpy as np
import pytest

import blind_instrument as blind
from tumblecal.data.sensor_parameters import SENSOR


def in_use(diagnosis):
    """Values and sd of the nine parameters of a written calibration, and the axes whose bias and scale factor have a term of
    temperature."""
    calibration = diagnosis.calibration
    own = calibration.parameters
    at = [own.names.index(name) for name in SENSOR]
    terms = calibration.extra.get("terms", [])
    with_term = {(term["axis"], sum(term["powers"])) for term in terms if term.get("per_degc")}
    return own.values[at], np.sqrt(np.diag(own.covariance))[at], with_term


def test_a_bias_that_drifts_is_written_for_the_mean_time(diagnoser, hidden):
    rate = 3e-3 / 1500
    setup = blind.random_setup(np.random.default_rng(6), 3, 8)
    passed = setup.time_s - setup.time_s[0]
    diagnosis = diagnoser(hidden(6, {"bias_drift.y": [rate]}))
    assert diagnosis.labels == ("bias_drift.y",)
    values, sd, _ = in_use(diagnosis)
    at_mean, own = setup.nominal["bias"][1] + rate * np.mean(passed), SENSOR.index("bias_y")
    assert abs(values[own] - at_mean) < 4 * sd[own] < 0.3 * rate * np.mean(passed)
    assert diagnosis.extended.value("bias_y") == pytest.approx(setup.nominal["bias"][1], abs=4e-4)


def test_where_nothing_is_wrong_and_the_temperature_is_not_known_the_covariance_is_that_of_the_fit(diagnoser, hidden):
    diagnosis = diagnoser(hidden(2, {}, columns=False))
    assert diagnosis.verdict == "adequate"
    np.testing.assert_allclose(diagnosis.in_use.values, diagnosis.extended.values, atol=1e-14)
    ratio = np.diag(diagnosis.in_use.covariance) / np.diag(diagnosis.extended.covariance)
    assert np.all(ratio > 0.99) and np.median(ratio) < 1.3
