"""Many fits at once, and simulated calibrations with the user's own samplers."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import tumblecal
from tumblecal import Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.noise import Covariance
from tumblecal.simulation import coverage, monte_carlo
from tumblecal.simulation.experiment import experiment_of


pytestmark = pytest.mark.usefixtures("quickly_compiled")
SD = 1e-4  # g


@pytest.fixture(scope="module")
def problem():
    where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
    chain = nominal_chain(where)
    return Problem.from_arrays(chain, where, np.asarray(chain(where)), noise_sd=SD)


@pytest.fixture(scope="module")
def readings(problem):
    return problem.readings + np.random.default_rng(0).normal(scale=SD, size=(1500, 24, 3))


def single(problem, readings, **changes):
    retained = changes.pop("retained", None)
    return tumblecal.fit(
        replace(Problem.from_arrays(problem.chain, problem.where, readings, **changes), retained=retained)
    )


@pytest.mark.parametrize("path", ["harmonic", "chain"])
def test_each_fit_is_the_single_fit(problem, readings, path):
    many = tumblecal.fit_many(problem, readings, path=path)
    assert len(many) == 1500 and many.converged.all() and {code.value for code in many.codes} == {"converged"}
    for number in (0, 1023, 1024, 1499):
        fit = single(problem, readings[number], noise_sd=SD)
        assert np.max(np.abs(many.values[number] - fit.values)) < 1e-11
        assert many.chi2[number] == pytest.approx(fit.chi2, rel=1e-7)
        assert many.sd[number] == pytest.approx(fit.sd, rel=0.02)


def test_excluded_positions_have_no_part_in_many_fits(problem, readings):
    moved = np.array(readings[:2])
    moved[:, 3] += 1.0
    some = problem.without((3, 17))
    many, fit = tumblecal.fit_many(some, moved), single(problem, readings[1], noise_sd=SD, retained=some.retained)
    assert many.dof == fit.dof == 51 and np.max(np.abs(many.values[1] - fit.values)) < 1e-11


def heavy(key):
    return 1e-3 * jax.random.t(key, 4.0, (15,))


def test_a_trial_depends_on_seed_and_number_alone(problem):
    whole = monte_carlo(problem, 3000, seed=5, truth=heavy)
    part = monte_carlo(problem, 1500, seed=5, truth=heavy, first=1024)
    assert np.array_equal(whole.values[1024:2524], part.values) and np.array_equal(whole.truth[1024:2524], part.truth)
    assert not np.array_equal(whole.values[:1500], monte_carlo(problem, 1500, seed=6, truth=heavy).values)


@pytest.mark.parametrize("path", ["auto", "chain"])
def test_intervals_contain_the_drawn_truth(problem, path):
    runs = monte_carlo(problem, 4096, seed=1, truth=heavy, path=path)
    assert runs.converged.all() and np.all(np.abs(runs.coverage(0.95) - 0.95) < 0.016)
    assert runs.truth.std(axis=0) == pytest.approx(1e-3 * np.sqrt(2), rel=0.15)  # Student's t with 4 degrees of freedom


@pytest.mark.long
@pytest.mark.parametrize("known", [True, False])
def test_coverage_is_that_of_the_same_trials(problem, known):
    """Stated noise: normal quantiles; unknown: Student's t, and the noise's own sd is the predicted one."""
    stated = problem if known else Problem.from_arrays(problem.chain, problem.where, problem.readings)
    drawn = None if known else lambda key: 2 * SD * jax.random.normal(key, (24, 3))
    table, runs = (made(stated, 3000, seed=4, truth=heavy, noise=drawn) for made in (coverage, monte_carlo))
    errors = runs.values - runs.truth
    kinds = {column for column in table.columns if column.startswith("covered_95")}
    assert kinds == {"covered_95_estimated"} | ({"covered_95_stated"} if known else set())
    np.testing.assert_allclose(
        table[f"covered_95_{'stated' if known else 'estimated'}"], runs.coverage(0.95), atol=1e-9
    )
    np.testing.assert_allclose(table["bias"], errors.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(table["sd"], errors.std(axis=0, ddof=1), rtol=1e-9)
    np.testing.assert_allclose(table["predicted_sd"], runs.table()["predicted_sd"], rtol=1e-9)
    assert table["trials"][0] == 3000 and table["failed"][0] == 0
    assert table["sd_over_predicted"].to_numpy() == pytest.approx(1, abs=5 / np.sqrt(2 * 3000))


def test_drawn_noise_has_the_covariance_of_the_problem(problem):
    level = np.eye(24) + 0.5 * np.ones((24, 24))
    for noise in (
        Covariance.by_axis(SD**2 * np.stack([level, level, 4 * level])),
        Covariance(np.kron(level, np.diag([1.0, 1.0, 4.0])) * SD**2, "full"),
        Covariance.of_sd(SD * np.repeat([1.0, 2.0, 3.0], 8)[:, None] * np.ones(3)),
    ):
        one = experiment_of(problem.with_noise(noise, known=True), path="chain")
        white = noise.whiten(np.asarray(one.noise(jax.random.key(1))).reshape(72, -1))
        # Of 1024 draws: variances 1 and covariances 0 within five standard deviations.
        assert np.max(np.abs(white @ white.T / 1024 - np.eye(72))) < 5 * np.sqrt(2 / 1024)


def test_an_effect_in_the_readings_alone_biases_the_fits(problem):
    from tumblecal.effects import catalogue
    from tumblecal.simulation.experiment import with_known_coefficients
    from tumblecal.simulation.inject import with_sizes

    (link,) = catalogue()["second_order.y"].make(problem.where)
    simulated = problem.chain + with_known_coefficients(with_sizes(link, [1e-3]))
    runs = monte_carlo(problem, 2048, seed=3, simulated=simulated)
    expected = single(problem, np.asarray(simulated(problem.where)), noise_sd=SD).values
    assert np.max(np.abs(runs.values.mean(axis=0) - expected) / runs.sd[0]) < 0.1
