"""Functions of temperature: nested, orthonormal over the range, zero at the reference; splines against scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from tumblecal.ground.errors import InputError
from tumblecal.ground.temperature_functions import TemperatureFunctions


KNOTS = (10.0, 30.0)


@given(order=st.integers(1, 5), low=st.floats(-60, 20), width=st.floats(5, 120), share=st.floats(-0.5, 1.5))
def test_combinations_are_nested_orthonormal_and_zero_at_the_reference(order, low, width, share):
    reference = low + share * width
    functions = TemperatureFunctions(order, reference, (low, low + width))
    grid = np.linspace(low, low + width, 201)
    mixed = functions.orthonormal(grid)
    assert np.allclose(mixed @ mixed.T / 201, np.eye(order), atol=1e-6)
    assert np.allclose(mixed, functions.combination @ functions.values(grid), atol=1e-6)
    assert np.allclose(functions.orthonormal(np.array([reference])), 0.0)
    lower = TemperatureFunctions(order - 1, reference, (low, low + width)).orthonormal(grid)
    assert np.allclose(mixed[:-1], lower, atol=1e-6)


def test_a_spline_with_knots_contains_every_cubic_spline_with_these_knots():
    functions = TemperatureFunctions(3, 20.0, (0.0, 40.0), KNOTS)
    spline = CubicSpline([0.0, *KNOTS, 40.0], [0.3, -0.2, 0.9, 0.1])
    degc = np.linspace(0.0, 40.0, 77)
    change = spline(degc) - spline(20.0)
    fitted, *_ = np.linalg.lstsq(functions.orthonormal(degc).T, change, rcond=None)
    assert np.allclose(fitted @ functions.orthonormal(degc), change, atol=1e-12)
    assert np.allclose((fitted @ functions.combination) @ functions.values(degc), change, atol=1e-12)


def test_jax_and_numpy_agree():
    import jax.numpy as jnp

    from tumblecal.ground.precision import enable_float64

    enable_float64()
    functions = TemperatureFunctions(3, 20.0, (0.0, 40.0), KNOTS)
    degc = np.linspace(0.0, 40.0, 9)
    assert np.allclose(np.asarray(functions.orthonormal(jnp.asarray(degc))), functions.orthonormal(degc), atol=1e-14)
    assert np.asarray(TemperatureFunctions(0, 20.0, (0.0, 40.0)).values(jnp.asarray(degc))).shape == (0, 9)


@pytest.mark.parametrize(
    ("order", "knots", "range_degc", "words"),
    [
        (6, (), (0.0, 40.0), "must be 0 to 5"),
        (2, (10.0,), (0.0, 40.0), "a cubic spline has order 3"),
        (3, (10.0, 10.1), (0.0, 40.0), "must increase within the range"),
        (3, (50.0,), (0.0, 40.0), "must increase within the range"),
        (1, (), (40.0, 40.0), "must be below the highest"),
    ],
)
def test_impossible_functions_are_rejected(order, knots, range_degc, words):
    with pytest.raises(InputError, match=words):
        TemperatureFunctions(order, 20.0, range_degc, knots)
