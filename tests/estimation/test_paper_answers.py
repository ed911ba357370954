"""The known answers of DESIGN section 3, to the digits given there."""

import numpy as np
import pytest
from rigs import measured

from tumblecal.data import paper
from tumblecal.estimation import harmonic, problem_of
from tumblecal.estimation.identifiability import identifiability
from tumblecal.estimation.linearised import linearised


TRUTH = np.array(list(paper.SIMULATION_TRUTH.values()))

# Table 1, exact fit: value and sd in mg, mrad or 1e-3, as DESIGN states them.
TABLE1 = {
    "dK_x": (0.354, 0.221), "dK_y": (-0.056, 0.045), "dK_z": (0.313, 0.045),
    "bias_x": (1.270, 0.205), "bias_y": (-0.768, 0.034), "bias_z": (0.848, 0.034),
    "dtheta_x": (0.201, 0.040), "dtheta_y": (-0.266, 0.040), "dtheta_z": (0.111, 0.040),
    "gamma_21": (0.101, 0.062), "gamma_31": (-0.020, 0.062), "gamma_32": (0.221, 0.056),
    "dbeta_0": (1.609, 0.207), "dbeta_1": (-1.740, 0.060), "dbeta_2": (-2.123, 0.035),
}  # fmt: skip


@pytest.fixture(scope="module")
def design(table1):
    problem = problem_of(table1)
    return problem, np.asarray(linearised(problem, np.zeros(15))[1])


def test_rank_at_zero_is_15_and_the_weakest_direction_is_the_x_axis(design):
    problem, jacobian = design
    seen = identifiability(jacobian, problem.chain.names, problem.scales)
    assert seen.rank == seen.free == 15 and not seen.unobservable
    weakest = seen.weak[0].coefficients
    assert set(weakest) == {"dK_x", "bias_x", "dbeta_0"}
    # Equal parts, to a tenth.
    np.testing.assert_allclose(np.abs(list(weakest.values())), 1.0, atol=0.1)


def test_table1_estimates_and_their_sd(table1_fit):
    assert table1_fit.names == tuple(TABLE1)
    for name, value, sd in zip(table1_fit.names, table1_fit.values * 1e3, table1_fit.sd * 1e3, strict=True):
        assert (name, round(float(value), 3), round(float(sd), 3)) == (name, *TABLE1[name])


def test_table1_residuals(table1_fit):
    assert round(float(np.sqrt(np.mean(table1_fit.residuals**2))) * 1e3, 4) == 0.0870
    assert round(table1_fit.sigma * 1e3, 4) == 0.0978
    assert table1_fit.dof == 57
    # DESIGN states predicted minus measured; a result holds measured minus predicted.
    assert round(float((-table1_fit.residuals).max()) * 1e3, 3) == 0.206
    assert round(float((-table1_fit.residuals).min()) * 1e3, 3) == -0.188


@pytest.mark.parametrize(("times", "bias"), [(1, "2.0e-06"), (3, "1.8e-05"), (10, "2.0e-04"), (30, "1.8e-03")])
def test_bias_of_the_first_order_equations_is_quadratic(times, bias):
    data = measured(TRUTH * times)
    error = harmonic.fit(problem_of(data)).values - TRUTH * times
    assert f"{np.max(np.abs(error)):.1e}" == bias
    if times == 1:
        assert np.argmax(np.abs(error)) == 0  # dK_x
