"""What a plan alone decides; the answer for one file does not depend on the files before it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from tumblecal.diagnosis import Diagnoser
from tumblecal.diagnosis.detection import detect
from tumblecal.diagnosis.detection.detect import SIZE, null_distribution, statistics
from tumblecal.ground.program_cache import ProgramCache
from tumblecal.planning import NextPlan
from tumblecal.show.diagnosis import record


def test_files_before_do_not_matter(hidden):
    first = hidden(31, {"second_order.y": [8e-4]})
    second = hidden(32, {"index_eccentricity": [3e-4, 2e-4]})
    alone = record(Diagnoser(nested=False)(second), NextPlan())
    both = Diagnoser(nested=False)
    both(first)
    words, numbers = leaves(record(both(second), NextPlan()))
    words_alone, numbers_alone = leaves(alone)
    assert words == words_alone
    np.testing.assert_allclose(numbers, numbers_alone, rtol=1e-7, atol=1e-12)


def leaves(value):
    """All texts and all numbers of a record, in order."""
    if isinstance(value, dict):
        value = [item for pair in value.items() for item in pair]
    if isinstance(value, list | tuple):
        parts = [leaves(item) for item in value]
        return [text for texts, _ in parts for text in texts], [number for _, numbers in parts for number in numbers]
    return ([], [float(value)]) if isinstance(value, int | float) else ([str(value)], [])


@pytest.mark.long
def test_the_reference_stands_for_data_that_differ_by_small_angles_alone(diagnoser, hidden):
    """Their own null distribution is not drawn, however close the decision: it passes the plan's quantile as often."""
    plain = hidden(36, {}, columns=False)
    diagnosis = diagnoser(plain)
    reference, at = diagnoser.references.of(diagnosis.model, diagnosis.problem), diagnosis.screened.at
    assert reference.serves(at)
    own = null_distribution(diagnosis.screened.pool, diagnosis.screened.alternatives, True)
    # Two quantiles of 6000 draws each: 0.01 +- 0.0018.
    assert np.mean(own > np.quantile(reference.null, 0.99)) == pytest.approx(0.01, abs=0.005)
    for other in (
        hidden(36, {}),  # a temperature that wanders its own way
        replace(plain, sd=None),
        replace(plain, sd=plain.sd * np.where(np.arange(len(plain)) % 2, 1.0, 1.004)[:, None]),
        replace(plain, readings=Rotation.from_euler("y", 3, degrees=True).apply(plain.readings)),
    ):
        screened = diagnoser(other).screened
        assert not diagnoser.references.of(screened.at.model, screened.problem).serves(screened.at)


@pytest.mark.long
def test_p_values_are_uniform_when_nothing_is_wrong(diagnoser, hidden):
    diagnosis = diagnoser(hidden(36, {}))
    null = diagnoser.references.of(diagnosis.model, diagnosis.problem).null
    rng = np.random.default_rng(8)
    drawn = statistics(
        diagnosis.screened.pool,
        diagnosis.screened.alternatives,
        rng.normal(size=(2000, diagnosis.screened.at.dof)),
        True,
    )
    p_values = 1 - np.searchsorted(null, drawn) / len(null)
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    # 2000 trials of probability 0.0085: 17 +- 4.1, and what 6000 draws leave uncertain of the quantile.
    assert 4 <= np.sum(p_values < SIZE) <= 32


def test_a_null_distribution_is_drawn_once_for_a_plan(diagnoser, hidden, monkeypatch, tmp_path):
    """It is kept on disk for other processes; other plans, other levels of the noise and other causes have their own."""
    drawn, kept = [], ProgramCache(tmp_path)
    monkeypatch.setattr(detect, "program_cache", lambda: kept)
    monkeypatch.setattr(detect, "null_distribution", lambda *told: drawn.append(told) or null_distribution(*told, 300))
    pool, beside = (own := diagnoser(hidden(37, {})).screened).pool, own.alternatives
    first, again = (detect.kept_null(pool, beside, False) for _ in range(2))
    np.testing.assert_array_equal(first, null_distribution(pool, beside, False, 300))
    np.testing.assert_array_equal(first, again)
    assert len(drawn) == 1
    fewer = pool.only(np.arange(1, pool.size))
    first_tried, *others = beside.noise.listed
    rarer = replace(beside.noise, listed=(replace(first_tried, log_weight=-9.0), *others))
    quieter = replace(beside, noise=rarer)
    for told in ((pool, beside, True), (fewer, beside, False), (pool, quieter, False)):
        detect.kept_null(*told)
    assert len(drawn) == 4
    # A file that somebody changed is not believed.
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-8] + bytes(8))
    np.testing.assert_array_equal(detect.kept_null(pool, beside, False), first)
    assert len(drawn) == 5
