"""Hidden effects in data of the blind instrument (plain numpy, benchmarks/blind_instrument.py)."""

import numpy as np
import pytest

import blind_instrument as blind
from snapshot_texts import snapshot as snapshot
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser


class Hidden:
    """Makes position sets with hidden effects."""

    def __call__(self, seed, effects, *, plan=(3, 8), change=None, sd=True, columns=True, noise=blind.SIGMA, degc=25):
        rng = np.random.default_rng(seed)
        setup = blind.random_setup(rng, *plan)
        setup.temperature_degc += degc - 25
        readings = blind.readings(setup, setup.nominal, effects)
        readings = readings + noise * rng.normal(size=readings.shape)
        if change is not None:
            readings = change(readings.copy(), rng)
        extra = {"time_s": setup.time_s, "temperature_degc": setup.temperature_degc, "approach": setup.approach}
        return PositionSet(
            tuple(setup.names),
            np.degrees(setup.alpha),
            np.degrees(setup.beta),
            readings,
            sd=np.full(readings.shape, blind.SIGMA) if sd else None,
            **(extra if columns else {}),
        )


@pytest.fixture(scope="session")
def hidden():
    return Hidden()


@pytest.fixture(scope="session")
def diagnoser():
    """One for all tests, so that models are compiled once."""
    return Diagnoser(nested=False)
