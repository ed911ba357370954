"""The chain against the independent one, its leaves by name and by vector, and its links' order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import independent
from independent import Instrument
from tumblecal.chain import Link, Place, coefficients, nominal_chain, settings
from tumblecal.chain.link import turned
from tumblecal.chain.plan import grid
from tumblecal.ground.frames import rotation_matrix


PLAN = grid(np.arange(12) * 30.0, [0.0, 30.0, 60.0, 90.0])
SEEDS = st.integers(0, 2**32 - 1)


def random_vector(seed: int, size: int, spread: float = 0.09) -> np.ndarray:
    """Angles, scale errors and biases of either sign up to 5 degrees (0.09)."""
    return np.random.default_rng(seed).uniform(-spread, spread, size)


@given(SEEDS)
def test_nominal_chain_equals_the_independent_chain(seed):
    where = settings(PLAN.alpha, PLAN.beta)
    vector = random_vector(seed, 16)
    ours = np.asarray(nominal_chain(where).at(vector)(where))
    setting = np.repeat(np.arange(4), 12)
    np.testing.assert_allclose(ours, independent.nominal(vector, PLAN.alpha, PLAN.beta, setting), rtol=0, atol=1e-14)


@given(SEEDS)
def test_leaves_of_runs_and_mounts_reach_their_rows_alone(seed):
    """dK by run, bias by run, dtheta by mount, dbeta by run, mount and pitch; two mounts, the second turned."""
    plan = grid([0, 80, 160, 240], [-20, 35, 70], mounts=["A", "B"], runs=3)
    where = settings(plan.alpha, plan.beta, run=plan.runs, mount=plan.mounts)
    turned_by = np.radians([[0, 0, 0], [20, -70, 130]])
    chain = nominal_chain(
        where,
        dbeta_by="run.mount.pitch",
        dtheta_by="mount",
        bias_by="run",
        scale_by="run",
        mount_nominal=np.stack([rotation_matrix(angles) for angles in turned_by]),
    )
    value = dict(zip(chain.names, random_vector(seed, len(chain.names)), strict=True))
    pitch = {beta: k for k, beta in enumerate((-20, 35, 70))}
    rows = list(zip(plan.runs, plan.mounts, plan.beta_deg, strict=True))
    true = Instrument(
        dK=np.array([[value[f"dK_{axis}@run={run}"] for axis in "xyz"] for run, _, _ in rows]),
        bias=np.array([[value[f"bias_{axis}@run={run}"] for axis in "xyz"] for run, _, _ in rows]),
        dtheta=np.array([[value[f"dtheta_{axis}@mount={mount}"] for axis in "xyz"] for _, mount, _ in rows]),
        gamma=np.array([value[f"gamma_{axes}"] for axes in ("21", "31", "32")]),
        dbeta=np.array([value[f"dbeta_{pitch[beta]}@mount={mount}@run={run}"] for run, mount, beta in rows]),
    )
    intended = independent.mount(np.stack([turned_by["AB".index(mount)] for _, mount, _ in rows]))
    theirs = independent.readings(plan.alpha, plan.beta, true, intended)
    assert len(value) == 9 + 9 + 6 + 3 + 18
    np.testing.assert_allclose(chain.named(value)(where), theirs, rtol=0, atol=1e-14)


def test_ideal_instrument_reads_what_the_paper_tabulates():
    """0-1 reads +z, the 90 degree setting reads -x whatever the spindle does, alpha = 90 degrees reads +y."""
    where = settings(np.radians([0, 90, 0, 123]), np.radians([0, 0, 90, 90]))
    expected = [[0, 0, 1], [0, 1, 0], [-1, 0, 0], [-1, 0, 0]]
    np.testing.assert_allclose(nominal_chain(where)(where), expected, atol=1e-15)


class Doubled(Link):
    """A link for the order test: multiplies the specific force."""

    place = Place.FIXTURE
    gain = coefficients("gain", unit="1")

    def __call__(self, state, where):
        return turned(state, tuple(2.0 * component for component in state.f))


def test_a_link_is_inserted_after_its_place():
    where = settings([0.0, 1.0, 2.0], [0.1, 0.1, 0.1])
    chain = nominal_chain(where)
    with_two = chain + Doubled() + Doubled()
    places = [link.place for link in with_two.links]
    assert places == sorted(places)
    assert [type(link).__name__ for link in with_two.links][3:5] == ["Doubled", "Doubled"]
    np.testing.assert_allclose(with_two(where), 4 * np.asarray(chain(where)), rtol=1e-15)
    assert len(chain.links) == 6


def test_names_units_and_order_are_the_papers():
    chain = nominal_chain(settings(PLAN.alpha, PLAN.beta))
    assert chain.names == (
        "dK_x", "dK_y", "dK_z", "bias_x", "bias_y", "bias_z", "dtheta_x", "dtheta_y", "dtheta_z",
        "gamma_21", "gamma_31", "gamma_32", "dbeta_0", "dbeta_1", "dbeta_2", "dbeta_3",
    )  # fmt: skip
    assert chain.units == ("1",) * 3 + ("g",) * 3 + ("rad",) * 10
    assert chain.scales.shape == chain.vector.shape == (16,)


def test_vector_named_and_at_agree():
    chain = nominal_chain(settings(PLAN.alpha, PLAN.beta))
    vector = random_vector(8, 16)
    np.testing.assert_array_equal(chain.at(vector).vector, vector)
    np.testing.assert_array_equal(chain.named(dict(zip(chain.names, vector, strict=True))).vector, vector)
    np.testing.assert_array_equal(chain.named({"gamma_31": 0.5}).vector, np.eye(16)[10] * 0.5)


def test_wrong_vectors_and_names_are_refused():
    chain = nominal_chain(settings(PLAN.alpha, PLAN.beta))
    with pytest.raises(ValueError, match="16 free parameters, the vector 17"):
        chain.at(np.zeros(17))
    with pytest.raises(KeyError, match="dK_q"):
        chain.named({"dK_q": 1.0})


def test_single_precision_is_refused():
    import jax

    where = settings([0.0], [0.0])
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(RuntimeError, match="enable_float64"):
            nominal_chain(where)
    finally:
        jax.config.update("jax_enable_x64", True)
