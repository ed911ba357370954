"""The answer for one file does not depend on the files before it; p-values of the global test."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from few_effects import few_entries
from tumblecal.data import PositionSet
from tumblecal.data.positions import attitudes_of
from tumblecal.diagnosis import Diagnoser
from tumblecal.diagnosis.detection.detect import SIZE, statistics, weight_of
from tumblecal.diagnosis.detection.null_curve import log_p_value, threshold
from tumblecal.diagnosis.noise.alternatives import NoiseAlternatives
from tumblecal.estimation.position_problem import problem_of, where_of
from tumblecal.full_model.evidence import log_evidence_of_noise
from tumblecal.full_model.full_model import model_of
from tumblecal.full_model.tangent import robust_start, tangent
from tumblecal.ground.json_file import json_text
from tumblecal.planning import NextPlan
from tumblecal.show.diagnosis import record


def test_files_before_do_not_matter(hidden):
    first = hidden(31, {"second_order.y": [8e-4]})
    second = hidden(32, {"index_eccentricity": [3e-4, 2e-4]})
    alone = written(Diagnoser(nested=False)(second))
    both = Diagnoser(nested=False)
    both(first)
    words, numbers = leaves(written(both(second)))
    words_alone, numbers_alone = leaves(alone)
    assert words == words_alone
    np.testing.assert_allclose(numbers, numbers_alone, rtol=1e-7, atol=1e-12)


def written(diagnosis):
    return json.loads(json_text(record(diagnosis, NextPlan())))


def leaves(value):
    """All texts and all numbers of a record, in order."""
    if isinstance(value, dict):
        value = [item for pair in value.items() for item in pair]
    if isinstance(value, list | tuple):
        parts = [leaves(item) for item in value]
        return [text for texts, _ in parts for text in texts], [number for _, numbers in parts for number in numbers]
    return ([], [float(value)]) if isinstance(value, int | float) else ([str(value)], [])


@pytest.mark.long
def test_p_values_are_uniform_when_nothing_is_wrong(diagnoser, hidden):
    of = diagnoser(hidden(36, {})).screened
    drawn = statistics(of.pool, of.alternatives, np.random.default_rng(8).normal(size=(2000, of.at.dof)), True)
    p_values = np.exp(log_p_value(drawn, of.at.dof, True, weight_of(of.pool, of.alternatives)))
    for level in (0.5, 0.2, 0.05, SIZE):
        # Four standard deviations of a count, and a tenth for the curve.
        apart = 4 * np.sqrt(2000 * level * (1 - level)) + 200 * level
        assert np.sum(p_values < level) == pytest.approx(2000 * level, abs=apart)


@given(st.integers(3, 2000), st.booleans(), st.floats(0.3, 1.4), st.floats(1e-6, 0.3))
def test_a_threshold_has_its_size(dof, known, weight, size):
    least = threshold(size, dof, known, weight)
    assert np.exp(log_p_value(np.array(least), dof, known, weight)) == pytest.approx(size, rel=1e-3)
    statistic = np.linspace(-5, 40, 500)
    log_p = log_p_value(statistic, dof, known, weight)
    assert np.all(np.diff(log_p) <= 0)
    # Ville's inequality for a mean of Bayes factors.
    assert np.all(log_p <= np.minimum(0.0, np.log(weight) - statistic) + 1e-12)


@pytest.mark.parametrize("known", [True, False])
def test_unequal_leverages_are_no_heavy_tails(known):
    """Of unknown attitudes a position leaves one residual, which its three readings share: the mean Bayes factor of Student's t
    was 240 for white noise."""
    units = np.random.default_rng(1).normal(size=(40, 3))
    readings = units / np.linalg.norm(units, axis=1, keepdims=True) + 1e-4 * np.random.default_rng(2).normal(
        size=(40, 3)
    )
    names, sd = tuple(map(str, range(40))), np.full((40, 3), 1e-4) if known else None
    data = PositionSet(names, *attitudes_of(readings), readings, sd=sd, comments={"attitudes": "unknown"})
    problem = problem_of(data)
    model = model_of(problem.chain, where_of(data), few_entries())
    noise = NoiseAlternatives.of(tangent(model, problem, robust_start(model, problem)))
    z = np.random.default_rng(3).normal(size=(3000, noise.at.dof))
    white = log_evidence_of_noise(np.vecdot(z, z), noise.at.dof, known)
    gain = (noise.log_evidence(z, known) - noise.log_weights).T - white
    tails = np.array([model.tail is not None for model in noise.listed])
    assert np.any(tails) and np.all(np.mean(np.exp(gain[tails]), axis=1) < 1.5)
