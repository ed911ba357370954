"""Slow noise and repeatability that a rig states: the fit of a problem is generalised least squares."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tumblecal import fit
from tumblecal.chain.head_ability import HeadAbility, SlowNoise
from tumblecal.chain.rig_file import rig_of
from tumblecal.estimation import problem_of
from tumblecal.estimation.position_problem import where_of
from tumblecal.estimation.slow_noise import slow_noise_of, with_slow_noise
from tumblecal.estimation.visits import with_repeatability
from tumblecal.simulation.position_means import simulated


SD, WALK, DRIFT = 1e-4, 4e-6, 1e-3
SLOW = SlowNoise(random_walk_g_per_rts=WALK, drift_g_per_h=DRIFT)
TABLE = {
    "schema": "tumblecal.rig/1",
    "plan": {"alpha_deg": {"start": 0, "step": 45, "count": 8}, "beta_deg": [0, 45, 90], "interval_s": 75},
    "chain": {"leaves": {"dbeta": {"by": "pitch_visit"}}},
    "noise": {"sd": "0.1 mg"},
    "priors": {"dbeta": "3 arcmin"},
    "head": {
        "repeatability": {"pitch": "30 arcsec"},
        "noise": {"random_walk_g_per_rts": WALK, "drift": "1 mg/h"},
    },
}


def covariance(time_s):
    """Of means of dwells of 60 s: the walk begins with the first dwell and is summed sample by sample, one a second."""
    since = time_s - time_s.min()
    samples = since[:, None] + np.arange(60)
    walk = np.minimum(samples[:, :, None, None], samples[None, None]).mean(axis=(1, 3))
    centred = (since - since.mean()) / 3600
    return SD**2 * np.eye(len(since)) + WALK**2 * walk + DRIFT**2 * np.outer(centred, centred)


def test_fit_is_generalised_least_squares():
    """Near the truth the chain is linear: estimates and covariance agree with numpy's solution of the normal equations."""
    rig = rig_of(TABLE, Path("rig.toml"))
    data = simulated(rig, seed=3)
    chain = rig.chain(where_of(data))
    where = where_of(data, chain)
    assert rig.ability is not None
    priors = with_repeatability(rig.priors, rig.ability.repeatability, chain, where)
    found = fit(with_slow_noise(problem_of(data, chain, noise_sd=SD, priors=priors), rig.ability))

    jacobian = np.zeros((24, 3, len(chain.names)))
    for k in range(len(chain.names)):
        step = 1e-6 * np.eye(len(chain.names))[k]
        jacobian[:, :, k] = np.asarray(chain.at(step)(where) - chain.at(-step)(where)) / 2e-6
    precision = np.linalg.inv(covariance(data.time_s))
    normal = np.einsum("pai,pq,qaj->ij", jacobian, precision, jacobian)
    residual = data.readings - np.asarray(chain.at(np.zeros(len(chain.names)))(where))
    towards = np.einsum("pai,pq,qa->i", jacobian, precision, residual)
    arcmin = np.radians(1 / 60)
    of_pitch = [number for number, name in enumerate(chain.names) if name.startswith("dbeta")]
    normal[of_pitch, of_pitch] += 1 / ((3 * arcmin) ** 2 + (0.5 * arcmin) ** 2)
    assert found.covariance == pytest.approx(np.linalg.inv(normal), rel=2e-2, abs=2e-2 * SD**2)
    assert found.values == pytest.approx(np.linalg.solve(normal, towards), abs=0.02 * np.min(found.sd))


def test_noise_starts_again_with_each_clock():
    """Positions of different clocks have no slow noise in common; without times there is none."""
    ability, data = HeadAbility((0.0,), (0.0,), slow_noise=SLOW), simulated(rig_of(TABLE, Path("rig.toml")), seed=3)
    assert data.time_s is not None
    parts = replace(data, clock=("1",) * 10 + ("2",) * 14)
    total = slow_noise_of(ability, where_of(parts))
    assert total is not None
    assert np.all(total[:, :10, 10:] == 0)
    assert total[0, 10:, 10:] == pytest.approx(covariance(data.time_s[10:]) - SD**2 * np.eye(14), rel=1e-6, abs=1e-16)
    assert slow_noise_of(ability, where_of(replace(data, time_s=None))) is None
