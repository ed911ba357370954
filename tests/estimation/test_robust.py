"""Other solvers and robust losses of the exact fit."""

import numpy as np
import pytest
from scipy.optimize import least_squares

import tumblecal
from tumblecal import Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.estimation.robust import cauchy, huber


SD = 1e-4  # g
WHERE = (np.tile(np.arange(12) * np.pi / 6, 4), np.repeat([-0.8, 0.0, 0.5, 1.0], 12))


def with_gross_errors(rng, share=0.05):
    """Noise with some gross errors of 20 sd."""
    noise = rng.normal(scale=SD, size=(48, 3))
    return noise + np.where(rng.random(noise.shape) < share, rng.normal(scale=20 * SD, size=noise.shape), 0.0)


@pytest.fixture(scope="module")
def chain():
    return nominal_chain(settings(*WHERE))


def problem_of_noise(chain, noise, *, known=True):
    where = settings(*WHERE)
    return Problem.from_arrays(chain, where, np.asarray(chain(where)) + noise, noise_sd=SD if known else None)


@pytest.mark.parametrize(
    ("loss", "name", "threshold"),
    [pytest.param(huber(), "huber", 1.345, marks=pytest.mark.long), (cauchy(), "cauchy", 2.385)],
)
def test_the_estimate_is_that_of_scipy(chain, loss, name, threshold):
    problem = problem_of_noise(chain, with_gross_errors(np.random.default_rng(2)))
    fit = tumblecal.fit(problem, loss=loss)
    scipy = least_squares(
        lambda scaled: np.asarray(problem.residual(1e-3 * scaled)),
        np.zeros(len(chain.names)), loss=name, f_scale=threshold, xtol=1e-14, ftol=1e-14, gtol=1e-14,
    )  # fmt: skip
    assert fit.code.good and np.max(np.abs(fit.values - 1e-3 * scipy.x) / fit.sd) < 1e-3
    assert fit.method.startswith(f"exact, {name.capitalize()} loss")


@pytest.mark.long
@pytest.mark.parametrize(("known", "sets"), [(True, 25), pytest.param(False, 6, marks=pytest.mark.long)])
def test_intervals_contain_the_truth_where_some_readings_are_wrong(chain, known, sets):
    rng, contained, plain = np.random.default_rng(3), [], []
    for _ in range(sets):
        problem = problem_of_noise(chain, with_gross_errors(rng), known=known)
        for loss, listed in ((huber(), contained), (None, plain)):
            low, high = tumblecal.fit(problem, loss=loss).interval(0.95).T
            listed.append((low <= chain.vector) & (chain.vector <= high))
    # 400 or 96 intervals, those of one data set correlated.
    assert 0.95 - (0.06 if known else 0.12) < np.mean(contained) < 0.995
    assert np.mean(plain) < 0.6 if known else True
