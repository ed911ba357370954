"""A null instrument with a strong drift: adequate if the rig states the drift as noise, and not without the statement."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from few_effects import few_entries
from tumblecal.chain.rig_file import rig_of
from tumblecal.diagnosis import Diagnoser
from tumblecal.estimation.position_problem import where_of
from tumblecal.estimation.visits import with_repeatability
from tumblecal.planning import next_plan
from tumblecal.simulation.position_means import simulated


RIG = rig_of(
    {
        "schema": "tumblecal.rig/1",
        "plan": {"alpha_deg": {"start": 0, "step": 45, "count": 8}, "beta_deg": [0, 45, 90], "interval_s": 75},
        "chain": {"leaves": {"dbeta": {"by": "pitch_visit"}}},
        "noise": {"sd": "0.1 mg"},
        "priors": {"dbeta": "3 arcmin"},
        "head": {"repeatability": {"pitch": "30 arcsec"}, "noise": {"drift": "3 mg/h", "warm_up": "0.5 mg"}},
    },
    Path("rig.toml"),
)


@pytest.fixture(scope="module")
def diagnoser():
    return Diagnoser(few_entries(), nested=False)


def diagnosed(diagnoser, data, ability):
    assert RIG.ability is not None
    chain = RIG.chain(where_of(data))
    priors = with_repeatability(RIG.priors, RIG.ability.repeatability, chain, where_of(data, chain))
    return diagnoser(data, chain=chain, noise_sd=RIG.noise_sd_g, priors=priors, ability=ability)


def test_stated_drift_is_no_effect(diagnoser):
    data = simulated(RIG, seed=5)
    stated, not_stated = (diagnosed(diagnoser, data, ability) for ability in (RIG.ability, None))
    assert stated.verdict == "adequate"
    assert not_stated.verdict != "adequate" and any(label.startswith("bias_drift") for label in not_stated.labels)
    # New positions are at visits of their own, whose errors have a prior.
    assert next_plan(stated).positions > 0


def test_effect_beyond_the_stated_noise_is_named(diagnoser):
    data = simulated(RIG, seed=6)
    bent = data.readings + np.array([0.0, 2e-3, 0.0]) * data.readings**2
    found = diagnosed(diagnoser, replace(data, readings=bent), RIG.ability)
    assert any("second_order.y" in labels for labels in (found.labels, *found.best.equivalents))
