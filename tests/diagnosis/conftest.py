"""Hidden effects in data of the blind instrument (plain numpy, benchmarks/blind_instrument.py)."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_sets import measured
from snapshot_texts import snapshot as snapshot
from tumblecal.diagnosis import Diagnoser


@pytest.fixture(scope="session")
def hidden():
    """Makes position sets with hidden effects."""

    def made(seed, effects, *, plan=(3, 8), change=None, sd=True, columns=True, noise=1.0, degc=25):
        rng = np.random.default_rng(seed)
        setup = blind.random_setup(rng, *plan)
        setup.temperature_degc += degc - 25
        data = measured(setup, effects, rng, known=sd, noise=noise, columns=columns)
        return data if change is None else replace(data, readings=change(data.readings.copy(), rng))

    return made


@pytest.fixture(scope="session")
def diagnoser():
    """One for all tests, so that models are compiled once."""
    return Diagnoser(nested=False)
