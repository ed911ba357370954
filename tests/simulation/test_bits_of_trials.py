"""Trials that do not depend on what is asked beside them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_batch import paper_experiment


pytestmark = pytest.mark.usefixtures("fully_compiled")


@pytest.fixture(scope="module")
def trials_of_block():
    """The trials of a block, compiled as a study does."""
    shared = paper_experiment()
    return jax.jit(lambda block: shared.trials(0, block))


@pytest.fixture(scope="module")
def values_of_blocks(trials_of_block):
    """The values of several blocks, in one program."""
    return jax.jit(lambda blocks: jax.lax.map(lambda block: trials_of_block(block).values, blocks))


@pytest.mark.long
@given(blocks=st.lists(st.integers(0, 10**6), min_size=5, max_size=5))
def test_a_trial_has_the_same_bits_whatever_is_asked_beside_it(trials_of_block, values_of_blocks, blocks):
    together = np.asarray(values_of_blocks(jnp.asarray(blocks)))
    np.testing.assert_array_equal(together[3], np.asarray(trials_of_block(blocks[3]).values))
