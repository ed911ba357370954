"""What a plan cannot determine is named, and the cures work."""

import numpy as np
import pytest
from rigs import measured, random_vector, setting

import independent
from tumblecal import InputError
from tumblecal.estimation import default_chain, exact, problem_of
from tumblecal.estimation.identifiability import identifiability
from tumblecal.estimation.linearised import linearised


TWO_PITCHES = (np.tile(np.arange(8) * 45.0, 2), np.repeat([0.0, 45.0], 8))


def seen_of(data):
    problem = problem_of(data)
    jacobian = np.asarray(linearised(problem, problem.chain.vector)[1])
    return identifiability(jacobian, problem.chain.names, problem.scales)


def test_a_single_pitch_setting_is_refused_with_names():
    data = measured(random_vector(1, 13, 1e-3), np.arange(8) * 45.0, np.full(8, 30.0), sd=1e-4)
    with pytest.raises(InputError) as refused:
        exact.fit(problem_of(data))
    (line,) = refused.value.faults
    seen = seen_of(data)
    assert 0 < seen.rank < 13
    assert len(seen.unobservable) == 13 - seen.rank
    assert all(name in line for name in seen.undetermined)
    assert "bias_x" in seen.undetermined and "dK_x" in seen.undetermined
    assert f"rank {seen.rank}" in line and "--fix" in line and "--prior" in line


def test_named_directions_are_really_invisible_and_the_others_are_not():
    """Moving along each named direction changes no reading of the independent chain, to first order."""
    alpha, beta = TWO_PITCHES
    data = measured(np.zeros(14), alpha, beta)
    seen = seen_of(data)
    assert [set(direction.coefficients) for direction in seen.unobservable] == [{"dK_x", "bias_x", "dbeta_0"}]
    names = problem_of(data).chain.names
    direction = np.array([seen.unobservable[0].coefficients.get(name, 0.0) for name in names])
    clean = independent.nominal(np.zeros(14), data.alpha, data.beta, setting(beta))

    def moved(vector):
        return np.max(np.abs(independent.nominal(vector * 1e-6, data.alpha, data.beta, setting(beta)) - clean))

    assert moved(direction) < 2e-12
    assert moved(direction * np.where(direction == 1.0, -1.0, 1.0)) > 1e-7  # with another sign it is seen


def test_fixing_or_a_prior_cures_it_and_the_rest_is_estimated():
    alpha, beta = TWO_PITCHES
    truth = random_vector(2, 14, 1e-3)
    truth[12:] = 0.0
    data = measured(truth, alpha, beta, sd=1e-6)
    chain = default_chain(data)
    with pytest.raises(InputError):
        exact.fit(problem_of(data))
    fixed = exact.fit(problem_of(data, chain.fixed({"dbeta"})))
    np.testing.assert_allclose(fixed.values, truth[:12], atol=1e-5)
    known = exact.fit(problem_of(data, noise_sd=1e-6, priors={"dbeta": (0.0, 1e-5)}))
    np.testing.assert_allclose(known.values, truth, atol=1e-4)
    # What the data cannot say is as uncertain as the prior, no less.
    assert known.sd[known.names.index("dbeta_0")] == pytest.approx(1e-5, rel=0.05)
