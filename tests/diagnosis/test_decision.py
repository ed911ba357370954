"""Where several explanations are left, their mean is written; coverage is measured by benchmarks/decision_coverage.py."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.data.calibration import calibration_text
from tumblecal.diagnosis.causes.cause import NO_SLOT
from tumblecal.report.diagnosis_calibration import _reference


@pytest.fixture(scope="module")
def ambiguous(diagnoser, hidden):
    """A second order of one axis, which a product of two inputs imitates."""
    for seed in range(30):
        diagnosis = diagnoser(hidden(seed, {"second_order.z": [3.5e-4]}))
        weighed = diagnosis.in_use.weighed
        if diagnosis.verdict == "ambiguous" and len(weighed) > 1 and weighed[0].share < 0.8:
            return diagnosis, weighed
    raise AssertionError("no ambiguous set among thirty")


def test_shares_are_in_proportion_to_the_probabilities(ambiguous):
    """Of those with a name: an error without a name may also be a process, which has no parameters."""
    diagnosis, weighed = ambiguous
    weighed = [explanation for explanation in weighed if "unexplained" not in explanation.labels]
    own = {explanation.labels: explanation.own_probability for explanation in diagnosis.screened.explanations}
    for explanation in diagnosis.screened.explanations:
        own |= dict(zip(explanation.equivalents, explanation.shares, strict=True))
    probabilities = np.array([own[explanation.labels] for explanation in weighed])
    shares = np.array([explanation.share for explanation in weighed])
    np.testing.assert_allclose(shares / shares.sum(), probabilities / probabilities.sum(), rtol=1e-6)


def test_the_average_lies_between_the_explanations_and_its_uncertainty_includes_their_difference(ambiguous):
    diagnosis, weighed = ambiguous
    used = diagnosis.in_use
    values = np.array([[explanation.fit.value(name) for explanation in weighed] for name in diagnosis.nominal.names])
    difference = np.ptp(values, axis=1)
    here = [used.names.index(name) for name in diagnosis.nominal.names]
    moved = np.flatnonzero(difference > 1.5 * diagnosis.nominal.sd)
    assert len(moved) and np.all(used.sd[here][moved] > 0.3 * difference[moved])


def test_calibration_is_the_average(ambiguous):
    diagnosis, weighed = ambiguous
    content = json.loads(calibration_text(diagnosis.calibration))
    told = content["provenance"]["averaged_over"]
    assert [own["causes"] for own in told] == [list(own.labels) for own in weighed]
    assert content["bias"][0] == pytest.approx(diagnosis.in_use.value("bias_x"), abs=1e-9)
    for term in content["terms"]:
        whole = [own.fit.value(name) for own in weighed for name in own.fit.names if name.startswith(term["effect"])]
        assert abs(term["coefficient"]) < max(map(abs, whole))


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
