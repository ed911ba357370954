"""Any forward model as a chain."""

import jax.numpy as jnp
import numpy as np
import pytest

import tumblecal
from tumblecal import Problem
from tumblecal.chain import Unknown, forward_chain, settings


def ellipse(p, where):
    angle = where.alpha + p["zero"]
    return (1 + p["scale"]) * jnp.cos(angle), jnp.sin(angle), p["offset"] + 0.0 * angle


@pytest.fixture(scope="module")
def chain():
    return forward_chain(ellipse, {"zero": Unknown(0.2, "rad"), "scale": Unknown(), "offset": Unknown(unit="g")})


@pytest.fixture(scope="module")
def where():
    return settings(np.linspace(0.0, 6.0, 20), np.zeros(20))


def by_numpy(alpha, zero, scale, offset):
    angle = alpha + zero
    return np.column_stack([(1 + scale) * np.cos(angle), np.sin(angle), np.full(len(angle), offset)])


def test_the_chain_is_the_function_and_its_fit_the_parameters(chain, where):
    assert chain.names == ("zero", "scale", "offset") and chain.vector.tolist() == [0.2, 0.0, 0.0]
    readings = by_numpy(where.alpha, 0.21, 0.01, -0.003)
    assert np.allclose(chain.named({"zero": 0.21, "scale": 0.01, "offset": -0.003})(where), readings, atol=1e-15)
    problem = Problem.from_arrays(chain, where, readings, noise_sd=1e-4)
    assert tumblecal.fit(problem).values == pytest.approx([0.21, 0.01, -0.003], abs=1e-10)
    many = tumblecal.fit_many(problem, np.stack([readings, by_numpy(where.alpha, 0.19, -0.01, 0.0)]))
    assert many.values == pytest.approx(np.array([[0.21, 0.01, -0.003], [0.19, -0.01, 0.0]]), abs=1e-10)
