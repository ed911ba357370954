"""The whole diagnosis on data with one thing hidden."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.diagnosis.coefficients import coefficients
from tumblecal.diagnosis.findings.gain import folds
from tumblecal.estimation import exact, problem_of
from tumblecal.ground.errors import InputError
from tumblecal.planning import NextPlan
from tumblecal.show.diagnosis import verdict_of_diagnosis
from tumblecal.show.diagnosis_page import write_diagnosis_page


def names(diagnosis):
    """The chosen causes and everything equal to them."""
    return [set(diagnosis.labels), *(set(labels) for labels in diagnosis.best.equivalents)]


def test_table_1_is_adequate(diagnoser, table1, table1_fit):
    diagnosis = diagnoser(table1)
    assert diagnosis.verdict == "adequate" and diagnosis.labels == ()
    assert diagnosis.screened.detection.p_value > 0.05
    np.testing.assert_allclose(diagnosis.nominal.rms, 0.0870e-3, atol=5e-8)
    np.testing.assert_allclose(diagnosis.nominal.vector[: diagnosis.model.nominal], table1_fit.values, atol=1e-9)


def test_what_table_1_could_not_have_shown(diagnoser, table1):
    diagnosis = diagnoser(table1)
    whole = {"second_order.x", "third_order.x", "scale_asymmetry.x", "gravity_value"}
    assert whole <= set(diagnosis.invisible) and not whole & set(diagnosis.limits)
    assert diagnosis.invisible["second_order.x"].absorbed_by[0] in {"dK_x", "bias_x", "dbeta_0"}
    # Two of the four directions of the wobble and equal flexure vanish (DESIGN section 4).
    assert {"spindle_wobble_1", "fixture_flexure"} <= set(diagnosis.invisible) & set(diagnosis.limits)
    assert "no column approach" in diagnosis.model.not_testable["index_backlash"]


def test_one_effect_is_named_measured_and_gained_from(diagnoser, hidden):
    data = hidden(1, {"cross_coupling.y.yz": [7e-4]})
    diagnosis = diagnoser(data)
    assert {"cross_coupling.y.yz"} in names(diagnosis)
    (member,) = diagnosis.members
    (size,) = coefficients(diagnosis, member)
    assert size.unit == "mg/g^2" and abs(size.value - 0.7) < 4 * size.sd < 0.4
    assert diagnosis.gain.cv_rms_after_g < diagnosis.gain.cv_rms_before_g
    assert diagnosis.gain.delta_bic < -20 and diagnosis.gain.f_p_value < 1e-6
    assert diagnosis.extended.chi2 / diagnosis.extended.dof == pytest.approx(1, abs=0.6)
    # The extended fit is the exact fit of the extended chain.
    again = exact.fit(problem_of(data, diagnosis.chain))
    assert diagnosis.extended.names == again.names
    np.testing.assert_allclose(diagnosis.extended.values, again.values, atol=1e-9)
    np.testing.assert_allclose(diagnosis.extended.sd, again.sd, rtol=1e-5)


def swapped(readings, rng):
    readings[[3, 10]] = readings[[10, 3]]
    return readings


def test_swapped_positions_and_an_effect(diagnoser, hidden):
    diagnosis = diagnoser(hidden(5, {"index_eccentricity": [4e-4, -3e-4]}, change=swapped))
    assert {"swapped_positions:0-4+1-3", "index_eccentricity"} in names(diagnosis)
    assert diagnosis.extended.rms < 1.5e-4


def test_mislabelled_angle(diagnoser, hidden):
    data = hidden(7, {})
    alpha = data.alpha_deg.copy()
    alpha[5] = (alpha[5] + 45) % 360
    diagnosis = diagnoser(replace(data, alpha_deg=alpha))
    assert diagnosis.labels == ("mislabelled_angle:0-6",)
    assert diagnosis.extended.rms < 1.3e-4


@pytest.mark.long
def test_an_entry_that_looks_like_an_effect_in_no_entry_is_stated_with_the_probability_of_the_latter(diagnoser, hidden):
    diagnosis = diagnoser(hidden(8, {"?square_times_sine.y": [1e-3]}, plan=(4, 12)))
    best = diagnosis.best
    share = dict(best.less_probable)[("unexplained",)]
    assert 0.02 < share < 1 - best.probability
    said = f"an effect that is not in the catalogue (probability {share:.2f})"
    assert said in verdict_of_diagnosis(diagnosis).words()


def test_implausible_parameters_speak_up_before_the_verdict(diagnoser, hidden, tmp_path):
    diagnosis = diagnoser(hidden(9, {}, change=lambda readings, rng: readings + np.array([0, 0.8, 0])))
    assert diagnosis.verdict == "unexplained" and diagnosis.labels == ()
    text = verdict_of_diagnosis(diagnosis).words()
    assert text.startswith("UNEXPLAINED: Implausible parameter values: ") and "\nFound: 1. bias_y = " in text
    # The test of the residuals does not contradict the lines before it.
    assert "Nominal model not rejected" not in text and "this does not confirm them" in text
    write_diagnosis_page(tmp_path / "diagnosis.html", diagnosis, NextPlan(), {})
    assert "Implausible parameter values: " in (tmp_path / "diagnosis.html").read_text()
    with pytest.raises(InputError, match=r"axis z reads the negative of axis x"):
        diagnoser(hidden(9, {}, change=lambda readings, rng: readings[:, [0, 1, 0]] * [1, 1, -1]))


def test_folds_of_a_held_out_run(hidden):
    both = replace(hidden(11, {}), run=("1",) * 12 + ("2",) * 12)
    numbers, words = folds(both, ("run", "2"))
    assert words == "run 2 left out"
    np.testing.assert_array_equal(numbers, np.repeat([-1, 0], 12))
    for wrong, said in ((("run", "9"), "name one of several"), (("mount", "A"), "no column mount")):
        with pytest.raises(InputError, match=said):
            folds(both, wrong)


def test_too_few_positions_are_refused_before_their_plan_is_compiled(diagnoser, table1, monkeypatch):
    monkeypatch.setattr("tumblecal.full_model.full_model.programs_of", None)
    with pytest.raises(InputError, match="too few"):
        diagnoser(table1.chosen([0, 1]))
    with pytest.raises(InputError, match="cannot determine"):
        diagnoser(table1.chosen(np.arange(8)))


def test_priors_that_alone_are_contradicted_are_said_and_left_out(diagnoser):
    """Pitch settings set anew since the head was measured were something "constant at a pitch setting" without a name."""
    rng = np.random.default_rng(61)
    setup = blind.random_setup(rng, 3, 8)
    setup.nominal["dbeta"] = np.array([1.1e-3, -0.9e-3, 0.02e-3])
    readings = blind.readings(setup, setup.nominal, {})
    data = position_set(setup, readings + blind.SIGMA * rng.normal(size=readings.shape), known=False)
    diagnosis = diagnoser(data, noise_sd=blind.SIGMA, priors={"dbeta": (0.0, 3e-5)})
    told = {unusual.parameter: unusual.stated_sd for unusual in diagnosis.implausible}
    assert set(told) == {"dbeta_0", "dbeta_1"} and told["dbeta_0"] == pytest.approx(0.03)
    assert diagnosis.labels == () and diagnosis.screened.detection.p_value > 1e-3
    assert (
        "without these stated values the data are consistent with the nominal model"
        in verdict_of_diagnosis(diagnosis).words()
    )
    kept = diagnosis.problem
    assert kept.priors == 1 and kept.prior_root @ np.ones(len(kept.chain.names)) == pytest.approx([1 / 3e-5])
