"""A setting that was put right, and that the fit turns back, stood where it was written."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.data import PositionSet
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.setup_error import undone_by_fit


def measured(stood_deg):
    """Readings of a perfect triad (numpy alone), settings written as 0, 35 and 70 deg of which the first stood elsewhere."""
    alpha, written = np.tile(np.arange(0.0, 360.0, 45.0), 3), np.repeat([0.0, 35.0, 70.0], 8)
    a, b = np.radians(alpha), np.radians(np.where(written == 0.0, stood_deg, written))
    readings = np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
    readings += np.random.default_rng(3).normal(scale=1e-4, size=readings.shape)
    return PositionSet(tuple(f"p{k}" for k in range(24)), alpha, written, readings)


@pytest.mark.parametrize(("stood_deg", "expected"), [(0.0, True), (-0.5, True), (-5.0, False), (-4.0, False)])
def test_a_slip_is_taken_back_where_the_pitch_error_undoes_it(stood_deg, expected):
    written = measured(stood_deg)
    correct_setup_errors = replace(written, beta_deg=np.where(written.beta_deg == 0.0, -5.0, written.beta_deg))
    assert undone_by_fit(written, exact.fit(problem_of(correct_setup_errors))) == expected
