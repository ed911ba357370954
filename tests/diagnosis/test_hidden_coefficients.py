"""What coefficients that the positions do not show may do to the parameters beside them: held in the covariance, and said."""

import json
from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind import catalogue as study
from tumblecal.data.calibration import read_calibration
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.planning import next_plan
from tumblecal.show.diagnosis import write_diagnosis
from tumblecal.show.diagnosis_page import write_diagnosis_page


# Another bias of y at each pitch setting, g: what of it goes with the sine of the pitch angle is gamma_21.
BY_PITCH = {"bias_by_pitch.y": [-3e-3, 1e-3]}


def truth_of(setup):
    return np.concatenate([setup.nominal[leaf] for leaf in ("dK", "bias", "gamma")])


@pytest.fixture(scope="module")
def folder(hidden, diagnoser, tmp_path_factory):
    folder = tmp_path_factory.mktemp("by_pitch")
    diagnosis = diagnoser(hidden(3, BY_PITCH))
    assert diagnosis.labels == tuple(BY_PITCH)
    plan = next_plan(diagnosis)
    write_diagnosis(folder, diagnosis, plan, figures=False)
    write_diagnosis_page(folder / "diagnosis.html", diagnosis, plan, {})
    return folder


def test_the_written_calibration_holds_the_truth_of_what_is_not_determined(folder):
    content, own = json.loads((folder / "calibration.json").read_text()), read_calibration(folder / "calibration.json")
    said = dict(zip(content["parameters"]["names"], content["parameters"]["determined"], strict=True))
    assert not said["gamma_21"] and said["bias_x"] and said["dK_x"]
    sensor, truth = own.sensor.of(SENSOR), truth_of(blind.random_setup(np.random.default_rng(3), 3, 8))
    assert set(sensor.undetermined) == {name for name in SENSOR if not said[name]}
    assert np.all(np.abs(sensor.values - truth) < 3 * sensor.sd)
    # So does the matrix that a device applies: of what it makes of x in y.
    sd = np.sqrt(np.diag(own.covariance)[:9].reshape(3, 3))
    assert sd[1, 0] > 5e-3 > 5e-4 > sd[0, 0]


def test_what_is_hidden_changes_no_reading_at_the_positions_measured(hidden, diagnoser):
    """The shifts of parameters and coefficients together, in the blind instrument: none of the readings moves."""
    fit = diagnoser(hidden(3, BY_PITCH)).extended
    setup = blind.random_setup(np.random.default_rng(3), 3, 8)
    (shift,) = 0.01 * fit.unidentifiable.T
    by = dict(zip(fit.names, shift, strict=True))
    nominal = {leaf: values.copy() for leaf, values in setup.nominal.items()}
    for leaf in ("dK", "bias", "dtheta"):
        nominal[leaf] += [by[f"{leaf}_{axis}"] for axis in "xyz"]
    nominal["gamma"] += [by["gamma_21"], by["gamma_31"], by["gamma_32"]]
    nominal["dbeta"] += [by[f"dbeta_{k}"] for k in range(3)]
    there = np.array(BY_PITCH["bias_by_pitch.y"])
    moved = there + np.array([by["bias_by_pitch.y_1"], by["bias_by_pitch.y_2"]])
    before = blind.readings(setup, setup.nominal, {"bias_by_pitch.y": there})
    together = blind.readings(setup, nominal, {"bias_by_pitch.y": moved}) - before
    alone = blind.readings(setup, nominal, {"bias_by_pitch.y": there}) - before
    assert np.linalg.norm(together) < 0.03 * np.linalg.norm(alone)


@pytest.mark.long
def test_intervals_of_the_sensor_hold_the_truth_whatever_effect_is_fitted():
    """95 % intervals of dK, bias and gamma beside effects of 30 to 300 sigma with coefficients that do not show."""
    rng, bench, inside, undetermined = np.random.default_rng(41), study.Bench(), [], []
    setup = blind.random_setup(rng, 3, 8)
    projector, clean = blind.unreachable(setup), blind.readings(setup, setup.nominal, {})
    measured = clean + blind.SIGMA * np.random.default_rng(99).normal(size=clean.shape)
    screened, noise_wrong = bench(study.Hidden(setup, measured, (), clean, {}), known=True)
    assert noise_wrong == () and screened.problem.known
    for id in ("bias_by_pitch.y", "bias_by_pitch.z", "spindle_wobble_1", "fixture_flexure", "cross_axis_square.x"):
        cause = screened.pool.causes[screened.pool.labels.index(id)]
        for number in range(60):
            sized = blind.sized(setup, projector, id, (30, 100, 300)[number % 3], rng, least_share=0.02)
            if sized is None:
                continue
            readings = blind.readings(setup, setup.nominal, {id: sized[0]}) + blind.SIGMA * rng.normal(size=clean.shape)
            fit = fit_with(replace(screened.at, problem=replace(screened.at.problem, readings=readings)), [cause])
            here = [fit.names.index(name) for name in SENSOR]
            inside.append(np.abs(fit.values[here] - truth_of(setup)) < 1.96 * fit.sd[here])
            undetermined.append([name in fit.undetermined for name in SENSOR])
    held, undetermined = np.array(inside), np.array(undetermined)
    assert len(held) > 250 and undetermined.sum() > 200
    # 95 % within four standard deviations of so many; what is assumed holds more than that of what is not determined, less of
    # none: all of a file's together.
    assert 0.925 < np.mean(held[~undetermined]) < 0.975
    assert np.mean(held[undetermined]) > 0.92
