"""The rig of a plan: a calibration with it states the uncertainties of the plan, and simulated errors have them."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from tumblecal.chain.rig_file import rig_of
from tumblecal.estimation.exact import fit
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.plan.cells import cells_of
from tumblecal.plan.information import uncertainties
from tumblecal.plan.limits import schedule
from tumblecal.plan.planned_rig import planned_rig
from tumblecal.plan.responses import responses_of
from tumblecal.simulation.position_means import simulated


RIG = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 90, count = 4 }
beta_deg = [0, 45, 90]
mounts = ["A", "B"]
[mounts]
A = { rotation_deg = [0, 0, 0] }
B = { rotation_deg = [0, 0, 90] }
[noise]
sd = "0.15 mg"
[head]
alpha_deg = { start = 0, step = 90, count = 4 }
"""
PRIOR = '[priors]\ndbeta = "3 arcmin"\n'
AGAIN = '[head.repeatability]\npitch = "1 arcmin"\n'
SLOW = "[head.noise]\nrandom_walk_g_per_rts = 2e-6\n"
# Settings of mounting A are visited twice, and mounting A again after B.
ORDER = np.array([0, 1, 4, 6, 2, 3, 8, 10, 12, 15, 17, 18, 20, 22, 5, 7, 0, 1, 3, 9])


def planned(text, order=ORDER):
    rig = rig_of(tomllib.loads(text), Path("rig.toml"))
    responses = responses_of(rig, cells_of(rig.ability))
    plan = schedule(responses.cells, order, rig.ability.times)
    names = tuple(map(str, range(len(order))))
    return responses, plan, rig, planned_rig(rig, responses, plan, rig.ability, names)


@pytest.mark.long
@pytest.mark.parametrize(
    "stated",
    [
        PRIOR + AGAIN + SLOW,
        pytest.param(PRIOR + AGAIN.replace("pitch", "mount"), marks=pytest.mark.long),
        pytest.param(AGAIN + "[chain.leaves.dbeta]\nfree = false\n", marks=pytest.mark.long),
    ],
    ids=["all", "mounts", "fixed but not set exactly"],
)
def test_a_calibration_states_the_uncertainties_of_the_plan(stated):
    responses, plan, rig, made = planned(RIG + stated)
    promised = uncertainties(responses, plan, rig.ability)
    made = made.__class__(**(vars(made) | {"truth": {}}))
    model = StatedModel(rig=made, noise_sd=made.noise_sd_g, priors=made.priors)
    fitted = fit(model.problem(simulated(made.__class__(**(vars(made) | {"ability": None})), 0, 0.0)))
    found = [fitted.sd[fitted.names.index(name)] for name in promised.names]
    assert found == pytest.approx(promised.sd, rel=2e-6)
