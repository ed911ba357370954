"""Faults of the procedure undone: what was hidden in exact readings is put right, and nothing else is touched."""

import numpy as np

import blind_instrument as blind
from blind_noise import position_set
from tumblecal.diagnosis.causes import exchanged_pairs
from tumblecal.diagnosis.causes.jumps import jumps
from tumblecal.diagnosis.causes.pool import Pool


def test_of_many_positions_any_two_that_were_exchanged(diagnoser, monkeypatch):
    """Rows more than 34 apart were no candidates: two outlier positions were named. 24 positions count as many here."""
    monkeypatch.setattr(exchanged_pairs, "MOST_PAIRS", 100)
    rng, effects = np.random.default_rng(17), {"index_eccentricity": [2e-3, -1e-3]}
    setup = blind.random_setup(rng, 3, 8)
    readings = blind.readings(setup, setup.nominal, effects)
    readings += blind.SIGMA * rng.normal(size=readings.shape)
    readings[[2, 21]] = readings[[21, 2]]
    diagnosis = diagnoser(position_set(setup, readings, True))
    assert set(diagnosis.best.labels) == {f"swapped_positions:{setup.names[2]}+{setup.names[21]}", *effects}


def test_signals_of_jumps_are_those_of_the_blind_instrument(hidden, diagnoser):
    """By central differences at the truth; the candidates are made at the fit, which differs by some tenths of a mrad."""
    at = diagnoser(hidden(2, {})).screened.at
    setup = blind.random_setup(np.random.default_rng(2), 3, 8)
    every = Pool(tuple(jumps(at)), at.dof).causes
    candidates = [cause for cause in every if cause.label.endswith(f":{setup.names[12]}")]
    assert [cause.words for cause in candidates if cause.words] == ["x axis", "y axis", "z axis"]
    for cause in candidates:
        effect = "?mount_slip" if cause.label.startswith("mount") else f"?step_half_way.{cause.words[0]}"
        for signal, unit in zip(cause.terms, np.eye(len(cause.terms)) * 1e-5, strict=True):
            there, back = (blind.readings(setup, setup.nominal, {effect: sign * unit}) for sign in (1, -1))
            expected = ((there - back) / 2e-5).ravel() / blind.SIGMA
            scale = at.model.scales[0] if effect == "?mount_slip" else 1.0
            np.testing.assert_allclose(signal / scale, expected, atol=1e-3 / blind.SIGMA)
            # The block spans what is left of them.
            rest = at.basis[: len(signal)].T @ signal
            assert np.linalg.norm(rest - cause.block @ (cause.block.T @ rest)) < 1e-9 * np.linalg.norm(rest)
