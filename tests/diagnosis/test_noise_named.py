"""Noise that is not as assumed: named as noise and with its level, and nothing invented beside it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import blind_instrument as blind
import blind_noise
from blind import plans as blind_plans
from blind_sets import measured
from tumblecal.diagnosis.screening.noise_change import screen_with_noise
from tumblecal.diagnosis.screening.screen import Screening
from tumblecal.estimation import problem_of
from tumblecal.show.diagnosis import verdict_of_diagnosis


def level(diagnosis) -> float:
    """The factor by which the noise exceeds the stated sd."""
    return float(diagnosis.noise_words.split("every sd times ")[1].split(":")[0])


def test_sd_columns_that_the_scatter_contradicts(diagnoser, hidden):
    diagnosis = diagnoser(hidden(21, {}, noise=12))
    assert diagnosis.labels == ("noise_level",) and not diagnosis.problem.known
    assert level(diagnosis) == pytest.approx(12, rel=0.25)
    assert diagnosis.screened.detection.p_value > 0.01 > diagnosis.assumed_p_value
    text = verdict_of_diagnosis(diagnosis).words()
    assert text.startswith("IDENTIFIED: The noise is not as assumed") and "under the noise as assumed" in text
    assert level(diagnoser(hidden(22, {}, noise=1 / 8))) == pytest.approx(1 / 8, rel=0.25)


@pytest.mark.parametrize("kind", blind_noise.NOISES)
def test_an_effect_in_noise_that_is_not_as_assumed(diagnoser, kind):
    named, noise_named = 0, 0
    rng = np.random.default_rng([3, blind_noise.NOISES.index(kind)])
    for _ in range(3):
        setup, readings, name = blind_noise.case(rng, "3x8", kind, 12.0)
        diagnosis = diagnoser(blind_noise.position_set(setup, readings, known=False))
        own = tuple(label for label in diagnosis.best.labels if not label.startswith(blind_noise.excused(kind)))
        named += own == (name,) or (name,) in diagnosis.best.equivalents
        noise_named += blind_noise.LABELS[kind] in diagnosis.labels
    assert named >= 2
    # A few readings of Student's t need not look heavy-tailed.
    assert noise_named >= 2 or kind == "heavy"


@pytest.mark.long
@pytest.mark.parametrize("kind", ["unequal", "coloured", "attitude"])
def test_p_values_hold_under_the_noise_found(kind, diagnoser):
    """Nothing but the noise is wrong: after the correction p is uniform, to within what estimating the noise costs."""
    rng = np.random.default_rng([11, blind_noise.NOISES.index(kind)])
    values: list[float] = []
    while len(values) < 16:
        setup, readings, _ = blind_noise.case(rng, "3x8", kind, 0.0)
        data = blind_noise.position_set(setup, readings, known=False)
        model = diagnoser._model(None, data, lambda data=data: problem_of(data))
        problem = problem_of(data, model.nominal_chain)
        screening = Screening(model)
        screened, noise_wrong, assumed_p = screen_with_noise(screening, problem)
        if noise_wrong:
            assert assumed_p < 0.05
            values.append(screened.detection.p_value)
    assert stats.kstest(values, "uniform").pvalue > 1e-3
    assert np.sum(np.array(values) < 0.02) <= 2


# Repeats are pure error: an error that comes back when an attitude is repeated is one of the model, not noise.
def of_the_attitude(rng, clean):
    own = 3 * rng.normal(size=(len(clean) // 2, 3))
    return np.vstack([own, own])


def of_the_attitude_on_one_axis(rng, clean):
    """About 14 sigma together."""
    own = 2 * rng.normal(size=(len(clean) // 2, 1)) * (np.arange(3) == rng.integers(3))
    return np.vstack([own, own])


def of_the_reading(rng, clean):
    return 3 * np.cross(rng.normal(size=clean.shape), clean)


@pytest.mark.long
@pytest.mark.parametrize(
    ("how", "known", "seed", "error", "label"),
    [
        ("one run", True, 1, of_the_attitude, "unexplained"),
        ("one run", False, 4, of_the_attitude_on_one_axis, "unexplained"),
        ("two runs", True, 4, of_the_attitude_on_one_axis, "unexplained"),
        ("two runs", False, 1, of_the_attitude, "unexplained"),
        ("one run", True, 1, of_the_reading, "noise_attitude"),
        ("two runs", False, 2, of_the_reading, "noise_attitude"),
        ("one run", True, 0, lambda rng, clean: 0.0, None),
    ],
)
def test_an_error_that_comes_back_is_no_noise_and_one_that_does_not_is(diagnoser, how, known, seed, error, label):
    rng = np.random.default_rng(seed)
    setup = blind_plans.twice(blind.random_setup(rng, 3, 8), how)
    clean = blind.readings(setup, setup.nominal, {})
    readings = clean + blind.SIGMA * (rng.normal(size=clean.shape) + error(rng, clean))
    runs = tuple("1" * 24 + "2" * 24) if how == "two runs" else None
    diagnosis = diagnoser(replace(blind_noise.position_set(setup, readings, known), run=runs))
    assert diagnosis.labels == ((label,) if label else ())
    assert ("repeats of an attitude agree" in verdict_of_diagnosis(diagnosis).words()) == (label == "unexplained")


@pytest.mark.parametrize("digits", [3, 4])
def test_rounding_that_exceeds_the_stated_noise_is_named_and_counts(diagnoser, digits):
    """Repeats that agreed exactly, or every reading its own cause: "every sd times 1e-12", unexplained, three outliers."""
    rng = np.random.default_rng([31, 1])
    data = measured(blind.random_setup(rng, 3, 8), {}, rng)
    diagnosis = diagnoser(replace(data, readings=np.round(data.readings, digits)))
    if digits == 4:
        assert diagnosis.verdict == "adequate"
        return
    assert set(diagnosis.labels) == {"quantisation.x", "quantisation.y", "quantisation.z"}
    # Of independent rounding errors of 1 mg and the noise.
    assert diagnosis.nominal.rms == pytest.approx(np.hypot(1e-3 / np.sqrt(12), blind.SIGMA), rel=0.5)
