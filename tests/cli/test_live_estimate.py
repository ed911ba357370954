"""The live estimate of a capture: positions so far, in the model of all positions of the plan."""

import time

import numpy as np
import pytest

import tumblecal
from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.journal import Attempt, RunState
from tumblecal.cli.live_estimate import estimated, live_estimate
from tumblecal.estimation import exact, problem_of
from tumblecal.ground.numbers_shown import rounded_together


@pytest.fixture(scope="module")
def data():
    return tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)


@pytest.fixture(scope="module")
def plan(data):
    angles = zip(data.alpha_deg.tolist(), data.beta_deg.tolist(), strict=True)
    return CapturePlan.model_validate(
        {"positions": {"listed": [{"alpha_deg": alpha, "beta_deg": beta} for alpha, beta in angles]}}
    )


@pytest.fixture(scope="module")
def attempts(data):
    """Accepted in this order; the sd of the means is 1e-5 g, below the smallest one, which is used."""
    return [
        Attempt(k, 1, 0, 0, "", {"mean_g": mean, "sd_g": [1e-3] * 3, "n": 10_000}, wall_ns=k, log_before=0)
        for k, mean in enumerate(data.readings.tolist())
    ]


@pytest.fixture(scope="module")
def expected(data):
    names = problem_of(data).chain.names
    return exact.fit(problem_of(data, noise_sd=1e-4, priors=dict.fromkeys(names, (0.0, 0.005))))


def accepted(*attempts: Attempt) -> RunState:
    return RunState(accepted={attempt.position: attempt for attempt in attempts})


def finished(look, state: RunState, before: list[str]) -> list[str]:
    """The lines as soon as they differ from these."""
    for _ in range(6000):
        if (lines := look(state)) != before:
            return lines
        time.sleep(0.01)
    raise AssertionError(before)


def test_it_is_the_exact_fit_of_the_positions_so_far_with_its_prior(plan, attempts, expected):
    fit = estimated(plan, attempts)
    assert fit.names == expected.names
    np.testing.assert_allclose(fit.sd, expected.sd, rtol=1e-6)
    assert np.all(np.abs(fit.values - expected.values) < 1e-3 * expected.sd)
    # A larger sd of the means is used as it is.
    attempts = [*attempts]
    attempts[0] = Attempt(0, 1, 0, 0, "", attempts[0].summary | {"n": 4}, wall_ns=0, log_before=0)
    assert estimated(plan, attempts).problem.sd[:2].tolist() == [[5e-4] * 3, [1e-4] * 3]


def test_the_lines_follow_the_accepted_positions_from_the_third_on(plan, attempts, expected):
    look = live_estimate(plan)
    for known in (accepted(), accepted(*attempts[:2])):
        for _ in range(5):
            assert look(known) == []
            time.sleep(0.01)
    some = finished(look, accepted(*attempts[:7]), [])
    assert "dbeta_2" not in " ".join(some)
    lines = finished(look, accepted(*attempts), some)
    assert [line.split(":")[0] for line in lines] == ["estimate / 1e-3", "estimate / mg", "estimate / mrad"]
    for name, value, u in zip(expected.names, 1e3 * expected.values, 1e3 * expected.sd, strict=True):
        assert f"  {name} {rounded_together(value, u)}" in " ".join(lines)
