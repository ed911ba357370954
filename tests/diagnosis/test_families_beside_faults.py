"""What acts on all three axes, beside an error of the head and mislabelled positions: small steps do not lead there."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
from blind_noise import position_set


@pytest.mark.parametrize("family", ["bias_drift", "bias_temperature"])
@pytest.mark.parametrize("seed", [3, 4])
def test_a_family_is_named_beside_two_labels_and_an_eccentric_index(diagnoser, family, seed):
    """It was a warm-up that lasts for days, or something without a name."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 4, 12)
    # As a room that warms and cools by some degrees.
    setup = replace(setup, temperature_degc=25 + 6 * np.sin(2 * np.pi * 1.3 * np.arange(48) / 48))
    projector, hidden = blind.unreachable(setup), {}
    for name, d in {"index_eccentricity": 100.0, **{f"{family}.{axis}": 60.0 for axis in "xyz"}}.items():
        drawn = blind.sized(setup, projector, name, d, rng)
        assert drawn is not None
        hidden[name] = drawn[0]
    wrong, stood = sorted(rng.choice(36, 2, replace=False).tolist()), setup.alpha.copy()
    setup.alpha[wrong] += np.radians(30)
    readings = blind.readings(setup, setup.nominal, hidden)
    setup.alpha = stood
    readings = readings + blind.SIGMA * rng.normal(size=readings.shape)
    diagnosis = diagnoser(position_set(setup, readings, known=bool(seed % 2)))
    named = {f"{family}.{axis}" for axis in "xyz"} | {"index_eccentricity"}
    assert set(diagnosis.best.labels) == named | {f"mislabelled_angle:{setup.names[k]}" for k in wrong}
    assert diagnosis.verdict == "identified" and not diagnosis.implausible and not diagnosis.noise_wrong
