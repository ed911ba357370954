"""Where several explanations are left, their mean is written; coverage is measured by benchmarks/decision_coverage.py."""

import json

import numpy as np
import pytest

from tumblecal.data.calibration import calibration_text
from tumblecal.diagnosis.findings.decision import averaged, explanations_left, is_thermal
from tumblecal.diagnosis.findings.reference import moved_to_reference
from tumblecal.report.diagnosis_calibration import extended_calibration


def average_of(screened, acted_on=None):
    left = explanations_left(screened)
    ids = {slot.id for slot in screened.at.model.slots}
    added = moved_to_reference(screened.at, ids, thermal=is_thermal(screened.members))
    return averaged(screened, left, added, acted_on)


@pytest.fixture(scope="module")
def ambiguous(diagnoser, hidden):
    """A second order of one axis, which a product of two inputs imitates."""
    for seed in range(30):
        diagnosis = diagnoser(hidden(seed, {"second_order.z": [3.5e-4]}))
        average = average_of(diagnosis.screened)
        if diagnosis.verdict == "ambiguous" and average is not None and average.weighed[0].share < 0.8:
            return diagnosis, average
    raise AssertionError("no ambiguous set among thirty")


def test_mean_and_spread_are_those_of_the_mixture(ambiguous):
    """By a million draws of the mixture itself."""
    diagnosis, average = ambiguous
    assert sum(own.share for own in average.weighed) == pytest.approx(1.0)
    names = [name for name in diagnosis.nominal.names if not name.startswith("dbeta")]
    rng, draws = np.random.default_rng(1), []
    for own in average.weighed:
        here = [own.fit.names.index(name) for name in names]
        block = own.fit.covariance[np.ix_(here, here)]
        draws.append(rng.multivariate_normal(own.fit.values[here], block, int(2e5 * own.share)))
    draws = np.concatenate(draws)
    here = [average.names.index(name) for name in names]
    sd = np.sqrt(np.diag(average.covariance)[here])
    np.testing.assert_allclose(average.values[here], draws.mean(axis=0), atol=0.02 * sd.max())
    np.testing.assert_allclose(sd, draws.std(axis=0), rtol=0.02)
    assert np.all(
        sd >= 0.999 * np.min([own.fit.sd[[own.fit.names.index(n) for n in names]] for own in average.weighed], 0)
    )


def test_calibration_is_the_average(ambiguous):
    diagnosis, average = ambiguous
    content = json.loads(calibration_text(extended_calibration(diagnosis)))
    told = content["provenance"]["averaged_over"]
    assert [own["causes"] for own in told] == [list(own.labels) for own in average.weighed]
    assert content["bias"][0] == pytest.approx(diagnosis.in_use.value("bias_x"), abs=1e-9)
    for term in content["terms"]:
        whole = [
            own.fit.value(name) for own in average.weighed for name in own.fit.names if name.startswith(term["effect"])
        ]
        assert abs(term["coefficient"]) < max(map(abs, whole))


def test_the_fit_that_was_made_is_that_of_the_explanation_acted_on(ambiguous):
    diagnosis, average = ambiguous
    again = average_of(diagnosis.screened, diagnosis.extended)
    assert any(own.fit is diagnosis.extended for own in again.weighed)
    np.testing.assert_array_equal(again.values, average.values)
    np.testing.assert_array_equal(again.covariance, average.covariance)


def test_one_explanation_is_not_averaged(diagnoser, hidden):
    diagnosis = diagnoser(hidden(1, {"index_eccentricity": [1e-3, 0.0]}))
    assert diagnosis.verdict == "identified"
    assert "averaged_over" not in extended_calibration(diagnosis).provenance
