"""Noise that is not as assumed, together with effects, and noise from raw samples."""

import numpy as np
import pytest
from scipy import stats

import blind_instrument as blind
import blind_noise
from tumblecal.capture.reduction.position_samples import PositionSamples
from tumblecal.data import PositionSet
from tumblecal.diagnosis.detection import detect
from tumblecal.diagnosis.diagnose import Diagnoser
from tumblecal.diagnosis.screening.noise_change import screen_with_noise
from tumblecal.diagnosis.screening.screen import Screening
from tumblecal.estimation import problem_of
from tumblecal.estimation.mean_noise import sample_noises
from tumblecal.ground.errors import InputError
from tumblecal.noise import Dwells, Flicker, GaussMarkov, Noise, RandomWalk, White
from tumblecal.noise.sampling import dwell_records
from tumblecal.report.diagnosis_verdict import verdict_of_diagnosis


RATE, COUNT = 50.0, 3000
ONE = np.ones(3)


@pytest.fixture(scope="module")
def diagnoser():
    """Without the folds of the cross-validation, which nothing here looks at."""
    return Diagnoser(nested=False)


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


@pytest.mark.parametrize("kind", ["unequal", "coloured", "attitude"])
def test_p_values_hold_under_the_noise_found(kind, diagnoser, monkeypatch):
    """Nothing but the noise is wrong: after the correction p is uniform, to within what estimating the noise costs."""
    rng = np.random.default_rng([11, blind_noise.NOISES.index(kind)])
    monkeypatch.setattr(detect, "DRAWS", 500)
    values: list[float] = []
    while len(values) < 16:
        setup, readings, _ = blind_noise.case(rng, "3x8", kind, 0.0)
        data = blind_noise.position_set(setup, readings, known=False)
        model = diagnoser._model(None, data, lambda data=data: problem_of(data))
        problem = problem_of(data, model.nominal_chain)
        screening = Screening(model, diagnoser.references.of(model, problem))
        screened, noise_wrong, assumed_p = screen_with_noise(screening, problem)
        if noise_wrong:
            assert assumed_p < 0.05
            values.append(screened.detection.p_value)
    assert stats.kstest(values, "uniform").pvalue > 1e-3
    assert np.sum(np.array(values) < 0.02) <= 2


def test_sd_columns_that_the_scatter_contradicts(diagnoser, hidden):
    data = hidden(21, {}, noise=12 * blind.SIGMA)
    diagnosis = diagnoser(data)
    assert diagnosis.labels == ("noise_level",) and not diagnosis.problem.known
    factor = float(diagnosis.noise_words.removeprefix("every sd times ").split(":")[0])
    assert factor == pytest.approx(12, rel=0.25)
    assert diagnosis.screened.detection.p_value > 0.01 > diagnosis.assumed_p_value
    text = verdict_of_diagnosis(diagnosis).words()
    assert text.startswith("IDENTIFIED: The noise is not as assumed") and "under the noise as assumed" in text
    overstated = diagnoser(hidden(22, {}, noise=blind.SIGMA / 8))
    assert float(overstated.noise_words.removeprefix("every sd times ").split(":")[0]) == pytest.approx(1 / 8, rel=0.25)


def test_a_wrong_level_is_no_scatter_of_the_attitude(diagnoser):
    """White noise of twice the stated sd on twelve positions; two of these were called attitude, one an effect."""
    rng = np.random.default_rng([3, 20])
    for number in range(17):
        setup = blind.random_setup(rng, 3, 4)
        clean = blind.readings(setup, setup.nominal, {})
        data = blind_noise.position_set(setup, clean + 2 * blind.SIGMA * rng.normal(size=clean.shape), known=True)
        if number in (12, 14, 16):
            diagnosis = diagnoser(data)
            assert diagnosis.labels == ("noise_level",) and diagnosis.noise_words.startswith("every sd times ")


def test_a_stated_sd_that_is_too_small_by_half(diagnoser):
    """Five of these were called attitude, an outlying position or nothing at all."""
    rng, said = np.random.default_rng([1, 11, 1]), []
    for _ in range(6):
        setup = blind.random_setup(rng, 3, 8)
        clean = blind.readings(setup, setup.nominal, {})
        readings = clean + 1.5 * blind.SIGMA * rng.normal(size=clean.shape)
        said.append(diagnoser(blind_noise.position_set(setup, readings, known=True)).noise_words)
    assert sum(words.startswith("every sd times 1.") for words in said) >= 5


def test_a_large_effect_under_a_stated_sd_that_is_too_small_is_told_with_the_level(diagnoser):
    """Under the stated sd it took a handful of causes, and heavy tails were named."""
    for seed in (0, 3):
        rng = np.random.default_rng([9, seed])
        setup = blind.random_setup(rng, 4, 12)
        name = ("cross_coupling.z.yz", "scale_drift.y", "fifth_order.x", "second_order.z")[seed]
        coefficients, *_ = blind.sized(setup, blind.unreachable(setup), name, (300, 100, 50, 20)[seed], rng)
        readings = blind.readings(setup, setup.nominal, {name: coefficients})
        readings += 2 * blind.SIGMA * rng.normal(size=readings.shape)
        diagnosis = diagnoser(blind_noise.position_set(setup, readings, known=True))
        assert set(diagnosis.labels) == {"noise_level", name} or (name,) in diagnosis.best.equivalents


def test_of_level_and_attitude_that_cannot_be_told_the_level_leads(diagnoser):
    """Twice the stated sd on twelve positions was called attitude, without a word of the level."""
    rng, alike = np.random.default_rng([1, 11, 0]), 0
    for _ in range(20):
        setup = blind.random_setup(rng, 3, 4)
        clean = blind.readings(setup, setup.nominal, {})
        readings = clean + 2 * blind.SIGMA * rng.normal(size=clean.shape)
        said = diagnoser(blind_noise.position_set(setup, readings, known=True)).noise_wrong
        assert "noise_attitude" not in said
        alike += "noise_attitude would explain it about as well" in "".join(fault.words for fault in said.values())
    assert alike > 0


@pytest.mark.parametrize("off", [1, 2])
def test_positions_off_where_the_stated_sd_is_too_small(diagnoser, off):
    """A position off by 50 sigma or more, the sd stated as half of what it is, was called heavy tails."""
    rng = np.random.default_rng([3, off])
    for number in (0, 3):
        setup = blind.random_setup(rng, 4, 12)
        readings = blind.readings(setup, setup.nominal, {})
        readings += 2 * blind.SIGMA * rng.normal(size=readings.shape)
        rows = rng.choice(len(readings), off, replace=False)
        readings[rows] += 100 * 4**number * blind.SIGMA * rng.choice([-1, 1], (off, 3))
        diagnosis = diagnoser(blind_noise.position_set(setup, readings, known=True))
        assert set(diagnosis.best.labels) == {f"outlier_position:{setup.names[row]}" for row in rows}
        assert [*diagnosis.noise_wrong] == ["noise_level"]
        assert diagnosis.noise_wrong["noise_level"].measured.startswith("every sd times")


def test_heavy_tails_beside_a_stated_sd_are_told_as_that(diagnoser):
    """Positions off are no better a word for the tails of Student's t where the sd is stated."""
    rng = np.random.default_rng(0)
    setup = blind.random_setup(rng, 4, 12)
    clean = blind.readings(setup, setup.nominal, {})
    readings = clean + blind.SIGMA * rng.standard_t(2.5, clean.shape)
    assert "noise_heavy_tail" in diagnoser(blind_noise.position_set(setup, readings, known=True)).noise_wrong


def test_positions_set_less_exactly_than_read(diagnoser):
    rng = np.random.default_rng(5)
    setup, readings, _ = blind_noise.case(rng, "3x8", "attitude", 0.0)
    diagnosis = diagnoser(blind_noise.position_set(setup, readings, True))
    assert "noise_attitude" in diagnosis.noise_wrong
    # One hundredfold variance of 1e-4 g: 1 mrad.
    said = float(diagnosis.noise_wrong["noise_attitude"].words.split("scatters by ")[1].split(" mrad")[0])
    assert said == pytest.approx(1.0, rel=0.3)


def recorded(seed, parts, effects=(), extra=0.0):
    """Means and raw samples of a run with a noise model, 60 s dwells every 80 s."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    clean = blind.readings(setup, setup.nominal, dict(effects))
    dwells = Dwells(np.arange(24) * 80.0, COUNT, 1 / RATE)
    records = list(dwell_records(Noise(parts), dwells, seed, clean + extra * rng.normal(size=clean.shape)))
    middle = dwells.start_s + 30.0
    means = np.array([force.mean(0) for force in records])
    data = PositionSet(
        tuple(setup.names),
        np.degrees(setup.alpha),
        np.degrees(setup.beta),
        means,
        time_s=middle,
        temperature_degc=setup.temperature_degc,
        approach=setup.approach,
        source="means",
    )
    times = dict(zip(setup.names, middle.tolist(), strict=True))
    return data, PositionSamples(dict(zip(setup.names, records, strict=True)), times, RATE, "raw"), dwells


def against_neighbours(covariance):
    """Sd of a mean against the next, from the covariance of all."""
    diagonal = np.array([np.diag(own) for own in covariance])
    steps = diagonal[:, 1:] + diagonal[:, :-1] - 2 * np.array([np.diag(own, 1) for own in covariance])
    return np.sqrt(np.mean(steps, axis=1) / 2)


def test_covariance_of_means_is_that_of_the_true_noise():
    parts = (White(100e-6 * ONE), Flicker(60e-6 * np.array([1.0, 2.0, 3.0])))
    data, samples, dwells = recorded(1, parts)
    noises = {noise.lasts: noise for noise in sample_noises(samples, data) if noise.level == 1}
    truth = Noise(parts).mean_covariance(dwells)
    np.testing.assert_allclose(against_neighbours(noises["flicker"].covariance), against_neighbours(truth), rtol=0.2)
    np.testing.assert_allclose(np.median(noises["flicker"].sd, axis=0), against_neighbours(truth), rtol=0.2)
    far = truth[2, 0, 0] + truth[2, 23, 23] - 2 * truth[2, 0, 23]
    lasting = noises["flicker"].covariance[2]
    assert lasting[0, 0] + lasting[23, 23] - 2 * lasting[0, 23] == pytest.approx(far, rel=0.4)
    np.testing.assert_allclose(np.median(noises["white"].sd, axis=0), 100e-6 / np.sqrt(60), rtol=0.05)


def test_white_raw_samples_change_nothing(diagnoser):
    data, samples, _ = recorded(2, (White(100e-6 * ONE),))
    diagnosis = diagnoser(data, samples=samples)
    assert diagnosis.verdict == "adequate" and diagnosis.problem.known and not diagnosis.problem.correlated
    np.testing.assert_allclose(diagnosis.problem.sd, 100e-6 / np.sqrt(60), rtol=0.05)
    assert "This is the noise of independent samples" in diagnosis.samples.words()


def test_slow_noise_of_raw_samples_weighs_the_positions(diagnoser):
    data, samples, _ = recorded(3, (White(100e-6 * ONE), Flicker(60e-6 * ONE)), {"second_order.y": [1.5e-3]})
    diagnosis = diagnoser(data, samples=samples)
    assert diagnosis.samples.lasts == "flicker" and diagnosis.problem.correlated
    assert {"second_order.y"} in [set(diagnosis.best.labels), *map(set, diagnosis.best.equivalents)]
    text = verdict_of_diagnosis(diagnosis).words()
    assert "times too small" in text and "correlated" in text and "treated as unknown" in text
    assert 0.6 < diagnosis.extended.level < 1.6


@pytest.mark.parametrize(
    "parts", [(RandomWalk(4e-6 * ONE),), (Flicker(60e-6 * ONE),), (GaussMarkov(50e-6 * ONE, 20.0),)]
)
def test_slow_noise_is_no_effect(diagnoser, parts):
    data, samples, _ = recorded(31, (White(100e-6 * ONE), *parts))
    diagnosis = diagnoser(data, samples=samples)
    assert not [label for label in diagnosis.labels if not label.startswith("noise_")]


def test_repeatability_that_raw_samples_do_not_show(diagnoser):
    data, samples, _ = recorded(4, (White(100e-6 * ONE),), extra=2e-4)
    diagnosis = diagnoser(data, samples=samples)
    assert "noise_level" in diagnosis.labels and not diagnosis.problem.known
    assert float(diagnosis.noise_words.split("times ")[1].split(":")[0]) == pytest.approx(
        2e-4 * np.sqrt(60) / 100e-6, rel=0.25
    )


def test_samples_of_something_else_are_refused(diagnoser):
    data, samples, _ = recorded(5, (White(100e-6 * ONE),))
    other = PositionSamples({**samples.force, "1-3": samples.force["1-4"]}, {}, RATE, "raw")
    with pytest.raises(InputError, match="position 1-3: the samples' mean of axis"):
        sample_noises(other, data)
    fewer = {name: force for name, force in samples.force.items() if name != "2-2"}
    with pytest.raises(InputError, match="no samples of position 2-2 of means"):
        sample_noises(PositionSamples(fewer, {}, RATE, "raw"), data)
