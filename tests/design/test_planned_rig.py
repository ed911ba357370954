"""The rig of a plan: a calibration with it states the uncertainties of the plan, and simulated errors have them."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from tumblecal.chain.rig_file import rig_of
from tumblecal.cli.model_options import StatedModel
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.evaluation import uncertainties
from tumblecal.design.model.planned_rig import planned_rig
from tumblecal.design.model.responses import responses_of
from tumblecal.design.model.schedule import schedule
from tumblecal.estimation.exact import fit
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


@pytest.mark.long
def test_simulated_errors_have_the_promised_dispersion():
    """Errors of settings and visits, white noise and a random walk of one-second steps, all drawn here."""
    responses, plan, rig, _ = planned(RIG + PRIOR + AGAIN + SLOW)
    promised = uncertainties(responses, plan, rig.ability)
    rng, draws, count, scale = np.random.default_rng(1), 1500, len(ORDER), responses.pitch.scale
    cells = responses.cells
    per_angle = np.radians(3 / 60) * rng.standard_normal((draws, 3))[:, cells.pitch[ORDER]]
    visits = plan.pitch_visit
    per_visit = np.radians(1 / 60) * rng.standard_normal((draws, visits.max() + 1))[:, visits]
    readings = (per_angle + per_visit)[:, :, None] / scale * responses.pitch.columns[ORDER][:, :, 0]
    mounts = rng.standard_normal((draws, plan.mount_visit.max() + 1, 3))[:, plan.mount_visit]
    readings += np.einsum("dnk,nak->dna", mounts, responses.mount.columns[ORDER])
    dwell, seconds = int(rig.ability.times.dwell_s), int(plan.end_s) + 1
    first = np.round(plan.start_s - plan.start_s[0]).astype(int)
    for axis in range(3):
        walk = np.cumsum(2e-6 * rng.standard_normal((draws, seconds)), axis=1)
        means = [walk[:, start : start + dwell].mean(axis=1) for start in first]
        readings[:, :, axis] += np.stack(means, axis=1) + 0.15e-3 * rng.standard_normal((draws, count))

    # Generalised least squares with the mountings as unknowns, in numpy.
    same = cells.pitch[ORDER][:, None] == cells.pitch[ORDER]
    of_pitch = np.radians(3 / 60) ** 2 * same + np.radians(1 / 60) ** 2 * (visits[:, None] == visits)
    column = responses.pitch.columns[ORDER][:, :, 0] / scale
    middle = plan.start_s - plan.start_s[0] + dwell / 2
    slow = 2e-6**2 * (np.minimum.outer(middle, middle) - dwell / 6 * np.eye(count)) + 0.15e-3**2 * np.eye(count)
    total = np.einsum("ij,ia,jb->iajb", of_pitch, column, column) + np.einsum("ij,ab->iajb", slow, np.eye(3))
    of_mounts = [
        responses.mount.columns[ORDER] * (plan.mount_visit == k)[:, None, None] for k in np.unique(plan.mount_visit)
    ]
    design = np.concatenate([responses.columns[ORDER], *of_mounts], axis=2).reshape(3 * count, -1)
    weights = np.linalg.solve(total.reshape(3 * count, -1), design)
    estimates = readings.reshape(draws, -1) @ weights @ np.linalg.pinv(design.T @ weights)
    dispersion = np.std(estimates[:, : len(promised.names)], axis=0) * responses.scales
    assert dispersion == pytest.approx(promised.sd, rel=0.07)
