"""Where several explanations are left, their mean is written; coverage is measured by benchmarks/blind use --effects one."""

import json

import numpy as np
import pytest

from tumblecal.data.calibration import calibration_text


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
