"""The use of a calibration follows from its data and from the corrections that its file lacks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.data.calibration_use import Use, combined
from tumblecal.data.not_applied import NotApplied
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.effects.effect import OF_HEAD, OF_RUN
from tumblecal.estimation.intrinsic import matrix_and_bias
from tumblecal.estimation.methods import calibrate
from tumblecal.lab.corrected_reading import expanded_uncertainty
from tumblecal.lab.use import limits, systematic_g, use_of_diagnosis


@pytest.fixture(scope="module")
def fit(table1):
    return calibrate(table1).exact


def use(fit, *losses, terms=(), comments=None, degc=None):
    """The use that limits alone allow, U being the systematic errors alone."""
    data = replace(fit.data, temperature_degc=None if degc is None else np.resize(degc, len(fit.data)))
    data = replace(data, comments=comments or {})
    held = SimpleNamespace(losses=lambda degc: list(losses), thermal=any(term.thermal for term in terms))
    return combined(limits(data, held), systematic_g(data, held) or None)


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
    matrix, _, written = matrix_and_bias(fit)
    t_57 = 2.0434  # 95.45 %, both sides: tables of Student's t
    assert fit.dof == 57
    assert expanded_uncertainty(matrix, written, dof=57) == pytest.approx(t_57 * np.max(sd), rel=0.04)
    assert expanded_uncertainty(matrix, written) == pytest.approx(2 * np.max(sd), rel=0.04)
    # With 1 mg more of the bias of z alone, by matrix entry (3, 3) of about 1.
    written = written + np.diag([0.0] * 11 + [1e-6])
    assert expanded_uncertainty(matrix, written) == pytest.approx(2 * np.hypot(np.max(sd[:, 2]), 1e-3), rel=0.04)


def test_the_uncertainty_of_a_term_is_that_of_its_largest_contribution():
    """A square of x alone, and one that grows with the temperature, both known to 0.1 mg per unit."""
    square, thermal = Term("x", 7e-4, (2, 0, 0)), Term("y", 0.0, (0, 0, 0), degc_power=1, reference_degc=20.0)
    covariance = np.diag([0.0] * 12 + [1e-8, 1e-8])
    found = expanded_uncertainty(
        np.eye(3), covariance, terms=[square, thermal], temperature_degc=np.array([15.0, 28.0])
    )
    assert found == pytest.approx(2 * 8.0 * 1e-4, rel=1e-3)
    assert expanded_uncertainty(np.eye(3), covariance[:13, :13], terms=[square]) == pytest.approx(2e-4, rel=1e-3)


def test_a_correction_that_the_file_lacks_is_in_its_uncertainty(fit):
    drift = NotApplied("bias_drift.x", OF_RUN, 3.0, 1.0)
    assert use(fit).words == "yes"
    own = use(fit, drift)
    assert (own.answer, own.expanded_g) == ("yes", 3e-3)
    assert own.reason == f"bias_drift.x is not in this calibration ({OF_RUN}); U includes its largest size, 3 mg"
    # Two add up; of the head; of unknown size.
    assert use(fit, drift, replace(drift, effect="warm_up", largest_mg=1.0)).expanded_g == pytest.approx(4e-3)
    assert use(fit, NotApplied("index_gain", OF_HEAD, 50.0, 20.0)).words == "yes"
    assert use(fit, NotApplied("my_effect", "no form")).answer == "not tested"


def test_a_change_within_dwells_is_in_the_uncertainty(fit):
    comments = {"within_dwells": "The readings change ...", "within_dwells_temperature_mg": "99"}
    own = use(fit, comments=comments)
    assert (own.answer, own.expanded_g) == ("yes", pytest.approx(0.099))
    assert own.reason.startswith("the readings change within dwells with temperature; U includes")
    # The file corrects it; a file that does not state the size.
    thermal = Term("x", 1e-5, (0, 0, 0), degc_power=1, reference_degc=25.0)
    assert use(fit, comments=comments, terms=(thermal,)).expanded_g is None
    assert use(fit, comments={"within_dwells_time_mg": "3"}, terms=(thermal,)).expanded_g == pytest.approx(3e-3)
    assert use(fit, comments={"within_dwells": "x"}).answer == "not tested"


def explained(bias_x, K2):
    """A calibration with a bias and a square along x."""
    own = Calibration(np.eye(3), np.array([bias_x, 0, 0]), 1e-10 * np.eye(12))
    return own.with_terms([Term("x", K2, (2, 0, 0))])


def test_a_difference_between_the_explanations_is_in_the_uncertainty(fit):
    """A bias of 2 mg more, or a square along x of 2 mg. A square along x and the negative squares along y and z are the same
    at 1 g: then the average is valid for all."""
    used = SimpleNamespace(as_fit=fit, weighed=[SimpleNamespace(fit=fit)] * 2)
    diagnosis = SimpleNamespace(
        implausible=(), verdict="ambiguous", extended=fit, members=(), noise_wrong=(), data=fit.data, sigma_g=1e-4,
        in_use=used, best=SimpleNamespace(equivalents=()),
        screened=SimpleNamespace(detection=SimpleNamespace(p_value=1e-9)),
    )  # fmt: skip
    held = SimpleNamespace(losses=lambda degc: [], thermal=False)
    own = use_of_diagnosis(diagnosis, held, 1e-3, [explained(2e-3, 0.0), explained(0.0, 2e-3)])
    # Across the x axis they differ by 2 mg, along it not at all.
    assert own.answer == "yes" and own.expanded_g == pytest.approx(3e-3, rel=0.02)
    assert "do not separate correct the readings differently" in own.reason
    across = Calibration(np.eye(3), np.array([2e-3, 0, 0]), 1e-10 * np.eye(12))
    across = across.with_terms([Term("x", -2e-3, powers) for powers in ((0, 2, 0), (0, 0, 2))])
    same = use_of_diagnosis(diagnosis, held, 1e-3, [explained(0.0, 2e-3), across])
    assert same == Use("yes", expanded_g=1e-3)
