"""Where several explanations are left, their mean is written; coverage is measured by benchmarks/decision_coverage.py."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.data.calibration import calibration_text
from tumblecal.diagnosis.causes.cause import NO_SLOT
from tumblecal.diagnosis.findings.decision import averaged, explanations_left, is_thermal
from tumblecal.diagnosis.findings.reference import moved_to_reference
from tumblecal.report.diagnosis_calibration import _reference


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
    content = json.loads(calibration_text(diagnosis.calibration))
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
    assert "averaged_over" not in diagnosis.calibration.provenance


def test_the_reference_is_a_time_only_where_the_parameters_are_those_of_one():
    """A drift of 2 per hour has its mean at the mean time; a parabola over 0 to 2 h has the mean 4/3, not the 1 of 1 h."""
    hours = np.linspace(0.0, 2.0, 25)
    assert np.polyval([2.0, 0.0], hours.mean()) == pytest.approx(np.mean(2.0 * hours))
    assert np.mean(hours**2) > 1.3 > hours.mean() ** 2

    def stated(*slots, value=0.0):
        causes = [SimpleNamespace(slot=slot) for slot in slots]
        fit = SimpleNamespace(value=lambda name: value)
        return _reference(
            SimpleNamespace(
                data=SimpleNamespace(time_s=3600.0 * hours, clock=None, temperature_degc=None),
                entries={},
                in_use=SimpleNamespace(weighed=[SimpleNamespace(members=causes, fit=fit)]),
            ), (), (),
        )  # fmt: skip

    slot = replace(NO_SLOT, needs=("time_s",), columns=(0,), names=("a",))
    drift, bend = replace(slot, order=1), replace(slot, order=2)
    decay = replace(slot, id="warm_up", shape=(1,), names=("a", "tau"))
    at, over = {"time_s": 3600.0}, {"mean_over_s": [0.0, 7200.0]}
    assert stated() == stated(drift) == at and stated(bend) == stated(drift, bend) == over
    assert stated(decay, value=7201.0) == over and stated(decay, value=600.0) == at | {"without": ["warm_up"]}
