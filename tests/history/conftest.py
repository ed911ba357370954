"""Stored texts; the same random numbers for each test, whichever tests ran before it."""

import numpy as np
import pytest
import test_history

from snapshot_texts import snapshot as snapshot


@pytest.fixture(autouse=True)
def same_draws():
    test_history.RNG.bit_generator.state = np.random.default_rng(2).bit_generator.state
