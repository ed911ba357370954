"""The use of a calibration follows from its data and from the corrections that its file lacks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.data.calibration_use import combined
from tumblecal.data.not_applied import NotApplied
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.effects.effect import OF_HEAD, OF_RUN
from tumblecal.estimation.intrinsic import matrix_and_bias
from tumblecal.estimation.methods import calibrate
from tumblecal.report.calibration_judgements import use_of
from tumblecal.report.calibration_limits import expanded_uncertainty, limits
from tumblecal.report.diagnosis_calibration import use_of_diagnosis


@pytest.fixture(scope="module")
def fit(table1):
    return calibrate(table1).exact


def use(fit, *losses, terms=(), comments=None, degc=None):
    """The use that limits alone allow."""
    degc = None if degc is None else np.resize(degc, len(fit.data))
    problem = replace(fit.problem, data=replace(fit.data, temperature_degc=degc, comments=comments or {}))
    held = SimpleNamespace(losses=lambda degc: list(losses), thermal=any(term.thermal for term in terms))
    return combined(limits(replace(fit, problem=problem), held))


def corrected_1g(parameters, readings):
    """Forces of readings by scale factor errors, biases and non-orthogonalities."""
    dK, bias, (g21, g31, g32) = parameters[:3], parameters[3:6], parameters[6:]
    triad = np.array([[1, 0, 0], [g21, 1, 0], [g31, g32, 1]])
    return (readings - bias) @ np.linalg.inv(np.diag(1 + dK) @ triad).T


def test_the_uncertainty_of_corrected_readings(fit):
    """Against draws of the parameters; the largest of all axes and directions is along an edge or corner of the cube."""
    places = [fit.names.index(name) for name in SENSOR]
    values, covariance = fit.values[places], fit.covariance[np.ix_(places, places)]
    cube = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
    cube /= np.linalg.norm(cube, axis=1)[:, None]
    dK, bias, (g21, g31, g32) = values[:3], values[3:6], values[6:]
    readings = cube @ np.array([[1, 0, 0], [g21, 1, 0], [g31, g32, 1]]).T * (1 + dK) + bias
    drawn = np.random.default_rng(5).multivariate_normal(values, covariance, 4000)
    sd = np.std([corrected_1g(own, readings) for own in drawn], axis=0)
    t_57 = 2.0025  # 95 %, both sides: tables of Student's t
    assert fit.dof == 57 and expanded_uncertainty(fit) == pytest.approx(t_57 * np.max(sd), rel=0.04)
    # With 1 mg more of the bias of z alone, by matrix entry (3, 3) of about 1.
    written = matrix_and_bias(fit)[2] + np.diag([0.0] * 11 + [1e-6])
    assert expanded_uncertainty(fit, written) == pytest.approx(t_57 * np.hypot(np.max(sd[:, 2]), 1e-3), rel=0.04)


def test_a_correction_that_the_file_lacks_limits_the_use_to_its_size(fit):
    drift = NotApplied("bias_drift.x", OF_RUN, 3.0, 1.0)
    assert use(fit).words == "yes"
    own = use(fit, drift)
    assert (own.answer, own.size_g) == ("within", 3e-3)
    assert own.words == f"yes, to about 3 mg: bias_drift.x is not in this calibration ({OF_RUN})"
    # Less than the uncertainty; of the head; of unknown size.
    below = 0.9e3 * expanded_uncertainty(fit)
    assert use(fit, replace(drift, largest_mg=below)).words == "yes"
    assert use(fit, replace(drift, largest_mg=1.3 * below)).answer == "within"
    assert use(fit, NotApplied("index_gain", OF_HEAD, 50.0, 20.0)).words == "yes"
    assert use(fit, NotApplied("my_effect", "no form")).words == "yes: my_effect is not in this calibration (no form)"


def test_a_change_within_dwells_limits_the_use_to_its_size(fit):
    comments = {"within_dwells": "The readings change ...", "within_dwells_temperature_mg": "99"}
    own = use(fit, comments=comments)
    assert (own.answer, own.size_g) == ("within", pytest.approx(0.099))
    assert own.words == "yes, to about 99 mg: the readings change within dwells with temperature"
    # The file corrects it; small; of a file that does not state the size.
    thermal = Term("x", 1e-5, (0, 0, 0), degc_power=1, reference_degc=25.0)
    assert use(fit, comments=comments, terms=(thermal,)).answer == "yes"
    assert use(fit, comments={"within_dwells_time_mg": "3"}, terms=(thermal,)).size_g == pytest.approx(3e-3)
    assert use(fit, comments={"within_dwells_time_mg": "0.001"}).words == "yes"
    assert use(fit, comments={"within_dwells": "x"}).words.startswith("yes: the readings change within dwells with")


def test_an_unconfirmed_identity_is_in_the_reason(fit):
    own = use(fit, comments={"identity_not_confirmed": "position p3: no serial number stated"})
    assert own.words == "yes: identity of the instrument not confirmed: position p3: no serial number stated"


@pytest.mark.parametrize(("degc", "words"), [
    ([25.0], "yes: measured at about 25 degC; a dependence on temperature was not measured"),
    ([24.9, 25.2], "yes: measured at about 25.05 degC; a dependence on temperature was not measured"),
    ([24.0, 26.5], "yes, from 24 to 26.5 degC only: a dependence on temperature outside this range was not measured"),
])  # fmt: skip
def test_one_temperature_is_no_range(fit, degc, words):
    assert use(fit, degc=degc).words == words


def test_the_strictest_of_judgements_and_limits_reaches_the_file(table1):
    """The reading of one position in error by 80 sd is `no`, whatever the limits."""
    comments = {"within_dwells_time_mg": "4"}
    own = use_of(calibrate(replace(table1, comments=comments)))
    assert (own.answer, own.size_g) == ("within", pytest.approx(4e-3))
    readings = table1.readings.copy()
    readings[7, 1] += 0.05
    assert use_of(calibrate(replace(table1, readings=readings, comments=comments))).answer == "no"


def explained(bias_x, K2):
    """A calibration with a bias and a square along x."""
    own = Calibration(np.eye(3), np.array([bias_x, 0, 0]), 1e-10 * np.eye(12))
    return own.with_terms([Term("x", K2, (2, 0, 0))])


def test_an_ambiguous_verdict_allows_the_parameters_in_which_the_explanations_agree(fit):
    """A bias of 2 mg more, or a square along x of 2 mg: both agree in all but the bias of x. A square along x and the negative
    squares along y and z are the same at 1 g: then the average holds for all."""
    used = SimpleNamespace(as_fit=fit, weighed=[SimpleNamespace(fit=fit)] * 2)
    diagnosis = SimpleNamespace(
        implausible=(), verdict="ambiguous", extended=fit, members=(), noise_wrong=(), data=fit.data, sigma_g=1e-4,
        in_use=used, best=SimpleNamespace(equivalents=()),
    )  # fmt: skip
    held = SimpleNamespace(losses=lambda degc: [], thermal=False)
    own = use_of_diagnosis(diagnosis, held, None, [explained(2e-3, 0.0), explained(0.0, 2e-3)])
    assert own.answer == "only" and own.parameters == tuple(name for name in SENSOR if name != "bias_x")
    # Across the x axis they differ by 2 mg, along it not at all.
    assert own.size_g == pytest.approx(2e-3, rel=0.02)
    assert own.reason == "the explanations that these data do not separate correct the readings differently"
    across = Calibration(np.eye(3), np.array([2e-3, 0, 0]), 1e-10 * np.eye(12))
    across = across.with_terms([Term("x", -2e-3, powers) for powers in ((0, 2, 0), (0, 0, 2))])
    same = use_of_diagnosis(diagnosis, held, None, [explained(0.0, 2e-3), across])
    assert same.answer == "yes" and same.size_g is None
