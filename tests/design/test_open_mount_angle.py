"""A plan that leaves an angle of a mounting undetermined is one that a calibration and a diagnosis accept."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from tumblecal.chain.rig_file import rig_of
from tumblecal.cli.model_options import StatedModel
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.planned_rig import planned_rig
from tumblecal.design.model.responses import responses_of
from tumblecal.design.model.schedule import schedule
from tumblecal.diagnosis.findings.determined import require_determined
from tumblecal.estimation.exact import fit
from tumblecal.estimation.linearised import linearised
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
STATED = '[priors]\ndbeta = "3 arcmin"\n[head.repeatability]\npitch = "1 arcmin"\n'


@pytest.mark.parametrize("stated", ["", STATED], ids=["unknown", "prior and repeatability"])
def test_a_response_of_rounding_size_determines_nothing(stated):
    """Two positions of the second mounting at 90 deg: one of its angles acts by cos 90 deg alone."""
    rig = rig_of(tomllib.loads(RIG + stated), Path("rig.toml"))
    assert rig.ability is not None
    responses = responses_of(rig, cells_of(rig.ability))
    plan = schedule(responses.cells, np.array([*range(12), 20, 22]), rig.ability.times)
    made = planned_rig(rig, responses, plan, rig.ability, tuple(map(str, range(14))))
    problem = StatedModel(rig=made, noise_sd=made.noise_sd_g, priors=made.priors).problem(simulated(made, 0, 1e-4))
    require_determined(problem, np.asarray(linearised(problem, problem.chain.vector)[1]))
    assert np.all(np.isfinite(fit(problem).sd))
