"""Angles that an encoder read, otherwise in every row: the setting is what was commanded, the angle what was read."""

import numpy as np
from rigs import PAPER_ALPHA, PAPER_BETA, positions, random_vector

import independent
from tumblecal.estimation import closed_form, exact, problem_of
from tumblecal.ground.angle_settings import setting_index


SETTING = np.repeat([0, 1, 2], 8)
REPEATED = np.repeat([0.0, 30.0, 60.0], 8)


def index(*angles_deg, held=True):
    return setting_index(np.radians(np.concatenate(angles_deg)), held=held).tolist()


def read(alpha_deg=PAPER_ALPHA, beta_deg=PAPER_BETA, spread=0.02, seed=1):
    """The angles with what an encoder adds, to a thousandth of a degree."""
    rng = np.random.default_rng(seed)
    return tuple(np.round(own + rng.normal(0.0, spread, len(own)), 3) for own in (alpha_deg, beta_deg))


def of_instrument(vector, alpha_deg, beta_deg, sd=0.0, setting=SETTING):
    readings = independent.nominal(vector, np.radians(alpha_deg), np.radians(beta_deg), setting)
    return positions(alpha_deg, beta_deg, readings + sd * np.random.default_rng(7).normal(size=readings.shape))


def test_angles_read_about_a_setting_are_one():
    for spread in (0.003, 0.02, 0.08):
        assert index(read(beta_deg=REPEATED, spread=spread)[1]) == SETTING.tolist()
    # As shown to a hundredth: values come again, now and then.
    shown = np.round(REPEATED + np.random.default_rng(2).normal(0, 0.008, 24), 2)
    assert 3 < len(np.unique(shown)) < 13 and index(shown) == SETTING.tolist()


def test_a_spindle_read_on_both_sides_of_zero_is_at_one_angle():
    around = [359.996, 90.003, 180.001, 269.998]
    alpha = [*around, 0.004, 89.998, 180.004, 270.003, 0.001, 90.001, 179.996, 270.001]
    assert index(alpha, held=False) == [0, 1, 2, 3] * 3
    # A turn that ends where it began was commanded so.
    assert index([0, 90, 180, 270, 360] * 3, held=False) == [0, 1, 2, 3, 4] * 3


def test_each_position_is_fitted_at_the_angle_that_was_read():
    """One dbeta a setting: as plain scipy finds them."""
    vector, (alpha, beta) = random_vector(3, 15, 2e-3), read()
    problem = problem_of(of_instrument(vector, alpha, beta))
    assert [name for name in problem.chain.names if "dbeta" in name] == ["dbeta_0", "dbeta_1", "dbeta_2"]
    np.testing.assert_allclose(exact.fit(problem).values, vector, rtol=0, atol=1e-10)
    data = of_instrument(vector, alpha, beta, sd=1e-4)
    fit = exact.fit(problem_of(data))
    other, _ = independent.scipy_fit(data.readings, np.radians(alpha), np.radians(beta), SETTING)
    np.testing.assert_allclose(fit.values, other, rtol=0, atol=1e-10)
    np.testing.assert_allclose(closed_form.estimate(data), other, rtol=0, atol=1e-10)
