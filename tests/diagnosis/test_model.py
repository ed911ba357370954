"""The chain with every effect in it: derivatives against differences, also for links that mix positions."""

import jax.numpy as jnp
import numpy as np
import pytest

from few_effects import few_entries
from tumblecal.chain import nominal_chain, settings
from tumblecal.effects import catalogue, output_effect
from tumblecal.full_model.full_model import model_of


@pytest.fixture(scope="module")
def where():
    rng = np.random.default_rng(3)
    count = 12
    return settings(
        rng.uniform(0, 6, count),
        np.repeat([0.1, 0.8, 1.3], 4),
        time_s=np.arange(count) * 60.0,
        temperature_degc=25 + rng.normal(size=count),
        approach=rng.choice([-1.0, 1.0], count),
    )


def by_differences(model, where, vector):
    """Central differences of the prediction by the scaled full vector."""
    columns = []
    for k, scale in enumerate(model.scales):
        ends = []
        for sign in (1, -1):
            moved = vector.copy()
            moved[k] += sign * 1e-4 * scale
            ends.append(model.predict(where, moved))
        columns.append((ends[0] - ends[1]) / 2e-4)
    return np.stack(columns, axis=-1)


def somewhere(model):
    """Away from zero, where inputs sit on the jump of a sign."""
    return model.start + 0.4 * model.scales * np.sin(1.0 + np.arange(len(model.scales)))


@pytest.mark.parametrize(
    ("by", "entries"), [({}, catalogue), ({"dtheta_by": "run", "bias_by": "run"}, few_entries)], ids=["plain", "by run"]
)
def test_jacobian_is_that_of_the_prediction(where, by, entries):
    model = model_of(nominal_chain(where, **by), where, entries())
    vector = somewhere(model)
    found = model.evaluate(where, vector)
    np.testing.assert_allclose(found.predicted, model.predict(where, vector), atol=1e-15)
    np.testing.assert_allclose(found.jacobian, by_differences(model, where, vector), atol=2e-10)
    # By the quick program: the other one is right for any model, and slower.
    assert "_by_position" in model.programs.evaluate.__qualname__


def test_an_effect_that_mixes_positions_is_differentiated_all_the_same(where):
    effect = output_effect(
        "shared_supply.x",
        "x",
        lambda u, where: u[0] - jnp.mean(u[0]),
        unit="mg/g",
        typical=1.0,
        physics="K (u - mean of u over all positions)",
        cause="The supply sags with the mean load.",
    )
    model = model_of(nominal_chain(where), where, {"shared_supply.x": effect})
    vector = somewhere(model)
    np.testing.assert_allclose(model.evaluate(where, vector).jacobian, by_differences(model, where, vector), atol=2e-10)
