"""The angles of a plan by gradient."""

import jax.numpy as jnp
import numpy as np
import pytest

from tumblecal import InputError, Problem
from tumblecal.chain import nominal_chain, settings
from tumblecal.planning import optimise_plan


def problem(noise_sd=1e-4):
    where = settings(np.tile(np.arange(8) * np.pi / 4, 3), np.repeat([0.0, 0.5, 1.0], 8))
    return Problem.from_arrays(nominal_chain(where), where, np.zeros((24, 3)), noise_sd=noise_sd)


def sd_of(problem, where):
    """Standard deviations at a plan by central differences in numpy."""
    vector, step = problem.chain.vector, 1e-6
    columns = []
    for k in range(len(vector)):
        shift = step * np.eye(len(vector))[k]
        ends = [np.asarray(problem.chain.at(vector + sign * shift)(where)).ravel() for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * step) / 1e-4)
    jacobian = np.stack(columns, axis=1)
    return np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))


def test_the_paper_s_axis_becomes_as_good_as_the_others_and_the_sd_are_those_of_the_plan():
    start = problem()
    better = optimise_plan(start)
    assert better.sd_before == pytest.approx(sd_of(start, start.where), rel=1e-4)
    assert better.sd_after == pytest.approx(sd_of(start, better.where), rel=1e-4)
    assert better.sd_after[0] < 0.3 * better.sd_before[0]  # dK_x
    settings_of = np.asarray(better.where.index("pitch"))
    assert all(np.ptp(np.asarray(better.where.beta)[settings_of == k]) == 0 for k in range(3))


def test_a_criterion_of_one_parameter_and_a_limit_are_respected():
    better = optimise_plan(
        problem(), parameters=["bias_x"], criterion=lambda covariance: jnp.log(covariance[0, 0]), beta_deg=(-30.0, 60.0)
    )
    beta = np.degrees(np.asarray(better.where.beta))
    assert beta.min() >= -30.0 - 1e-9 and beta.max() <= 60.0 + 1e-9
    assert better.sd_after[better.names.index("bias_x")] < better.sd_before[better.names.index("bias_x")]


def test_wrong_arguments_are_one_message():
    with pytest.raises(InputError, match="no parameter 'bias_q'"):
        optimise_plan(problem(), parameters=["bias_q"])
    with pytest.raises(InputError, match="the noise is unknown"):
        optimise_plan(problem(noise_sd=None))
