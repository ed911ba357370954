"""The noise model in positions.csv: `calibrate` and `diagnose` use it without an option, and refuse one that is none."""

import json

import numpy as np
import pytest
from capture_folder import means_of, wandering

from tumblecal.data import read_positions
from tumblecal.data.joined import joined
from tumblecal.estimation import exact
from tumblecal.estimation.linearised import linearised
from tumblecal.estimation.position_problem import problem_of
from tumblecal.noise import Covariance
from tumblecal.noise.recorded import recorded_covariance


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.fixture(scope="module")
def means(tmp_path_factory):
    """A null run in a wander of 80 ug and 60 s, seven times the white noise of a mean; reduced."""
    return means_of(wandering(tmp_path_factory.mktemp("lab") / "run", {}))


@pytest.mark.long
def test_diagnose_uses_it_without_an_option(tumblecal, tmp_path, means):
    outcome = tumblecal("diagnose", means, "--no-figures", "--out", tmp_path / "out")
    said = " ".join(outcome.out.split())
    assert outcome.code == 0 and f"Noise model of {means} (24 positions of 30 s): x white 42." in said
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert not [label for label in found["explanations"][0]["effects"] if not label.startswith("noise_")]
    assert found["samples"]["source"] == str(means)


def test_calibrate_fits_with_the_covariance_of_the_means(means):
    """Against generalised least squares in numpy, at the fit's own Jacobian."""
    data = read_positions(means)
    problem = problem_of(data)
    fitted = exact.fit(problem)
    covariance = Covariance.by_axis(recorded_covariance(data))
    _, white = (np.asarray(part) for part in linearised(problem, fitted.values))
    _, weighted = (np.asarray(part) for part in linearised(problem.independent, fitted.values))
    jacobian = weighted * data.sd.ravel()[:, None]
    inverse = np.linalg.inv(covariance.matrix)
    normal = jacobian.T @ inverse @ jacobian
    np.testing.assert_allclose(white.T @ white, normal, rtol=1e-6, atol=1e-6 * np.abs(normal).max())
    off = fitted.residuals.ravel()
    assert fitted.chi2 == pytest.approx(off @ inverse @ off, rel=1e-6)
    slope, size = jacobian.T @ inverse @ off, np.linalg.norm(jacobian.T @ inverse) * np.linalg.norm(off)
    assert np.linalg.norm(slope) < 1e-5 * size
    sd = np.sqrt(np.diag(np.linalg.inv(normal))) * problem.scales
    np.testing.assert_allclose(fitted.sd, sd, rtol=1e-4)


def test_joined_recordings_are_independent_of_each_other(means, tmp_path):
    other = tmp_path / "other.csv"
    text = means.read_text()
    other.write_text(text.replace('"recording": "', '"recording": "x'))
    both = joined([read_positions(means), read_positions(other)])
    covariance = recorded_covariance(both)
    alone = recorded_covariance(read_positions(means))
    np.testing.assert_allclose(covariance[:, :24, :24], alone, rtol=1e-9)
    np.testing.assert_allclose(covariance[:, 24:, 24:], alone, rtol=1e-6)
    assert np.all(covariance[:, :24, 24:] == 0)
    assert recorded_covariance(read_positions(means).chosen(range(5))).shape == (3, 5, 5)
