"""The live estimate of a capture: positions so far, in the model of all positions of the plan."""

import numpy as np
import pytest

import tumblecal
from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.cli.live_estimate import live_estimate
from tumblecal.estimation import exact, problem_of


def test_it_is_the_exact_fit_of_the_positions_so_far_with_its_prior():
    data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
    angles = zip(data.alpha_deg.tolist(), data.beta_deg.tolist(), strict=True)
    plan = CapturePlan.model_validate(
        {"positions": {"listed": [{"alpha_deg": alpha, "beta_deg": beta} for alpha, beta in angles]}}
    )
    rows = [(k, data.readings[k], np.full(3, 1e-5)) for k in range(24)]  # below the smallest sd, which is used
    estimate = live_estimate(plan)
    assert estimate(rows[:2]) == []
    names = problem_of(data).chain.names
    expected = exact.fit(problem_of(data, noise_sd=1e-4, priors=dict.fromkeys(names, (0.0, 0.005))))
    shown = {name: (1e-3 * value, 1e-3 * sd) for name, value, sd, _ in estimate(rows)}
    assert shown.keys() == set(expected.names)
    for name, value, sd in zip(expected.names, expected.values, expected.sd, strict=True):
        assert shown[name][0] == pytest.approx(value, abs=1e-3 * sd) and shown[name][1] == pytest.approx(sd, rel=1e-6)
    # In any order; the pitch error of a setting that is not measured yet is not shown.
    some = estimate([rows[k] for k in (9, 3, 5, 1, 7, 12, 14)])
    assert 3 <= len(some) < 15 and "dbeta_2" not in [name for name, *_ in some]
    for name, value, sd, _ in some:
        assert abs(value - 1e3 * expected.value(name)) < 5 * sd
