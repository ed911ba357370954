"""What a plan alone decides; the answer for one file does not depend on the files before it."""

import numpy as np
import pytest
from scipy import stats

from tumblecal.diagnosis import Diagnoser
from tumblecal.diagnosis.detect import SIZE, null_distribution, statistics
from tumblecal.diagnosis.reference import References
from tumblecal.planning import NextPlan
from tumblecal.report.diagnosis_file import record


@pytest.fixture(autouse=True)
def own_references(monkeypatch):
    """Every diagnoser decides by itself what a plan decides, as it does for users."""
    monkeypatch.setattr(References, "of", References.of.__wrapped__)


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


def test_one_reference_serves_all_data_of_a_plan(hidden):
    diagnoser = Diagnoser(nested=False)
    diagnoser(hidden(33, {}))
    diagnoser(hidden(34, {}))
    assert len(diagnoser.references._made) == 1
    diagnoser(hidden(34, {}, sd=False))
    assert len(diagnoser.references._made) == 2


def test_the_reference_stands_for_the_data_sets_own(diagnoser, hidden):
    """The plan's null distribution and that of data of the plan are the same to within what 3000 draws can tell."""
    diagnosis = diagnoser(hidden(35, {}))
    reference = diagnoser.references.of(diagnosis.model, diagnosis.problem)
    own = null_distribution(diagnosis.screened.pool, diagnosis.screened.alternatives, True)
    assert stats.ks_2samp(own, reference.null).pvalue > 1e-3
    high = np.quantile(own, 0.95)
    assert 0.03 < np.mean(reference.null > high) < 0.075


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
