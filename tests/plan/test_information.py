"""The covariance that a schedule gives, against an exact fit and against a covariance with random effects in numpy."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal import Problem, fit
from tumblecal.chain.head_ability import Repeatability, SlowNoise, Times
from tumblecal.plan.cells import cells_of
from tumblecal.plan.information import uncertainties
from tumblecal.plan.limits import schedule
from tumblecal.plan.responses import responses_of


@pytest.fixture(scope="module")
def rig(head):
    """The head with the settings of its plan, no repeatability and the usual times."""
    ability = replace(
        head.ability,
        alpha_deg=(0.0, 90.0, 180.0, 270.0),
        beta_deg=(0.0, 45.0, 90.0),
        times=Times(),
        repeatability=Repeatability(),
    )
    return replace(head, ability=ability)


@pytest.fixture(scope="module")
def responses(rig):
    return responses_of(rig, cells_of(rig.ability))


def test_standard_deviations_of_a_plan_are_those_of_its_fit(rig, responses):
    order = np.arange(len(responses.cells))
    planned = schedule(responses.cells, order, rig.ability.times)
    covariance = uncertainties(responses, planned, rig.ability).covariance
    chain = rig.chain(rig.where)
    problem = Problem.from_arrays(
        chain, rig.where, np.asarray(chain(rig.where)), noise_sd=0.15e-3, priors={"dbeta": (0.0, np.radians(0.05))}
    )
    fitted = fit(problem)
    sd = np.sqrt(np.diag(covariance)) * responses.scales
    assert sd == pytest.approx([fitted.sd[fitted.names.index(name)] for name in responses.names], rel=1e-6)


def test_visits_and_slow_noise_are_a_covariance_of_the_readings(rig, responses):
    """The same by generalised least squares: every random effect and every slow part is in the covariance of the readings."""
    ability = replace(
        rig.ability,
        repeatability=Repeatability(pitch=1e-4),
        slow_noise=SlowNoise(random_walk_g_per_rts=2e-6),
        times=Times(dwell_s=30.0, settle_s=5.0, turn_s=10.0, pitch_change_s=100.0, remount_s=900.0),
    )
    responses = responses_of(replace(rig, ability=ability), responses.cells)
    # Pitch setting 0 of mounting A is visited twice.
    order = np.array([0, 1, 4, 6, 2, 3, 8, 10, 12, 15, 17, 18, 20, 22])
    planned = schedule(responses.cells, order, ability.times)
    assert planned.pitch_visit.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6]
    assert planned.start_s[:3].tolist() == [5.0, 50.0, 50.0 + 30 + 5 + 10 + 100]
    found = uncertainties(responses, planned, ability).covariance

    n, cells = len(order), responses.cells
    to_pitch = responses.pitch.columns[order][:, :, 0]
    scale, prior, again = 1e-3, np.radians(0.05), 1e-4
    same_angle = cells.beta_deg[order][:, None] == cells.beta_deg[order]
    same_visit = planned.pitch_visit[:, None] == planned.pitch_visit
    of_pitch = (prior**2 * same_angle + again**2 * same_visit) / scale**2
    # A random walk from the first sample of the run, averaged over two dwells: the earlier mean instant, to first order.
    middle = planned.start_s - planned.start_s[0] + 15.0
    walk = 2e-6**2 * (np.minimum.outer(middle, middle) - 30.0 / 6 * np.eye(n))
    total = np.zeros((3 * n, 3 * n))
    for i in range(n):
        for j in range(n):
            block = of_pitch[i, j] * np.outer(to_pitch[i], to_pitch[j])
            total[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = block + np.eye(3) * (walk[i, j] + (i == j) * 0.15e-3**2)
    # Mount angles are unknown without bound: columns of their own.
    mount = np.concatenate(
        [responses.mount.columns[order] * (planned.mount_visit == k)[:, None, None] for k in (0, 1)], axis=2
    )
    columns = np.concatenate([responses.columns[order], mount], axis=2).reshape(3 * n, -1)
    expected = np.linalg.inv(columns.T @ np.linalg.solve(total, columns))[:9, :9]
    assert np.sqrt(np.diag(found)) == pytest.approx(np.sqrt(np.diag(expected)), rel=2e-3)
