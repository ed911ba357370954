"""Effects added to the catalogue, many diagnoses, results as bytes."""

import pickle

import numpy as np
import pytest

import tumblecal
from few_effects import few_entries
from tumblecal import InputError
from tumblecal.effects import catalogue, output_effect, with_effects


FOURTH = output_effect(
    "fourth_order.y", "y", lambda u, where: u[1] ** 4, unit="mg/g^4", typical=0.2, physics="K4 u^4", cause="test"
)


@pytest.fixture(scope="module")
def sets():
    rig = tumblecal.read_rig("hidden_effect")
    return [tumblecal.simulate(rig, seed=seed, noise_sd=0.1e-3) for seed in (4, 5)]


def test_effects_are_added_and_nothing_is_replaced_silently():
    entries = with_effects([FOURTH])
    assert len(entries) == len(catalogue()) + 1 and entries["fourth_order.y"] is FOURTH
    for wrong, words in (
        ({"fourth_order.y": FOURTH}, "entries replaces it"),
        ([3], "an entry of type int"),
        ([FOURTH, FOURTH], "fourth_order.y is in the catalogue already"),
    ):
        with pytest.raises(InputError, match=words):
            with_effects(wrong)
    with pytest.raises(InputError, match="entries: an empty catalogue"):
        tumblecal.diagnosis.Diagnoser(entries={})


def test_many_diagnoses_are_the_single_ones(sets):
    few = tumblecal.PositionSet.from_arrays(np.eye(3)[:2], [0, 90], [0, 0], unit="deg")
    first, refused = tumblecal.diagnose_many([sets[0], few], [FOURTH], entries=few_entries(), noise_sd=0.1e-3)
    assert isinstance(refused, InputError) and "too few" in str(refused)
    assert first.labels == ("bias_drift.x", "second_order.z") and "fourth_order.y" in first.limits
    in_processes = tumblecal.diagnose_many([sets[0], few], [FOURTH], entries=few_entries(), noise_sd=0.1e-3, workers=2)
    assert [getattr(each, "labels", None) for each in in_processes] == [first.labels, None]
    calibrated = tumblecal.calibrate(sets[0], noise_sd=0.1e-3)
    assert np.array_equal(pickle.loads(pickle.dumps(calibrated)).exact.values, calibrated.exact.values)


def test_an_unknown_option_is_refused(sets):
    with pytest.raises(TypeError, match="nose_sd"):
        tumblecal.diagnose(sets[0], nose_sd=3)  # type: ignore[call-arg]
