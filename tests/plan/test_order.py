"""The order of a plan against brute force over all orders, with readings, trends and their covariances in numpy."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from tumblecal.chain.head_ability import HeadAbility, Repeatability, SlowNoise, Times
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import cells_of
from tumblecal.plan.limits import schedule
from tumblecal.plan.order import best_order
from tumblecal.plan.responses import Responses, Setting


SD, SCALE = 0.2e-3, 1e-3
DRIFT = SlowNoise(drift_g_per_h=1e-2)
WALK = SlowNoise(random_walk_g_per_rts=2e-5)


class Worst:
    """The largest standard deviation."""

    def of(self, covariance):
        return np.sqrt(np.max(np.diagonal(covariance, axis1=-2, axis2=-1), axis=-1))


def head(slow_noise, again=1e-4):
    return HeadAbility(
        alpha_deg=tuple(range(0, 360, 45)),
        beta_deg=(0.0, 40.0),
        mounts=("A", "B"),
        times=Times(dwell_s=60.0, settle_s=5.0, turn_s=10.0, pitch_change_s=90.0, remount_s=900.0),
        repeatability=Repeatability(pitch=again),
        slow_noise=slow_noise,
    )


def responses_to(ability, again=1e-4):
    """Biases, scale factors and the pitch setting of a triad whose spindle is its x axis in mounting A, its y axis in B."""
    cells = cells_of(ability)
    a, b = np.radians(cells.alpha_deg), np.radians(cells.beta_deg)
    force = np.stack([np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
    tilt = np.stack([np.cos(b), -np.sin(b) * np.sin(a), -np.sin(b) * np.cos(a)], axis=1)
    other = np.array(cells.mounts) == "B"
    force[other], tilt[other] = np.roll(force[other], 1, axis=1), np.roll(tilt[other], 1, axis=1)
    columns = SCALE * np.concatenate([np.tile(np.eye(3), (len(a), 1, 1)), force[:, :, None] * np.eye(3)], axis=2)
    pitch = Setting(SCALE * tilt[:, :, None], 2e-4 / SCALE, again / SCALE)
    none = Setting(np.zeros((len(a), 3, 3)), 0.0, 0.0)
    names = tuple(f"{kind}_{axis}" for kind in ("bias", "dK") for axis in "xyz")
    return Responses(cells, names, np.full(6, SCALE), columns, np.zeros((6, 6)), pitch, none, SD)


def worst_sd(responses, ability, order, trend=None, walk=0.0):
    """Worst standard deviation of an order by generalised least squares, and its duration, s; `trend`: unknown drifts too."""
    cells, times = responses.cells, ability.times
    start, at = [], times.settle_s
    visit, visits = [0], 0
    for k, cell in enumerate(order):
        if k:
            last = order[k - 1]
            other = cells.mounts[cell] != cells.mounts[last]
            pitch = other or cells.beta_deg[cell] != cells.beta_deg[last]
            visits += pitch
            visit.append(visits)
            at += times.settle_s + (cells.alpha_deg[cell] != cells.alpha_deg[last]) * times.turn_s
            at += pitch * times.pitch_change_s + other * times.remount_s
        start.append(at)
        at += times.dwell_s
    order, start, visit, count = np.array(order), np.array(start), np.array(visit), len(order)
    # Means of a walk over dwells, from the first instant on, to first order of the sampling.
    since = start - start[0] + times.dwell_s / 2
    walk = walk**2 * (np.minimum.outer(since, since) - times.dwell_s / 6 * np.eye(count))
    tilt, beta = responses.pitch.columns[order][:, :, 0].ravel() / SCALE, np.repeat(cells.beta_deg[order], 3)
    visit = np.repeat(visit, 3)
    common = 2e-4**2 * (beta[:, None] == beta) + ability.repeatability.pitch**2 * (visit[:, None] == visit)
    covariance = np.kron(walk + SD**2 * np.eye(count), np.eye(3)) + common * np.outer(tilt, tilt)
    columns = responses.columns[order].reshape(3 * count, -1)
    if trend is not None:
        columns = np.hstack([columns, np.kron((start - start.mean())[:, None], np.eye(3))])
    columns = columns / np.linalg.norm(columns, axis=0) * (sizes := np.linalg.norm(columns, axis=0)).mean()
    of_all = np.linalg.inv(columns.T @ np.linalg.solve(covariance, columns))
    sd = np.sqrt(np.diag(of_all)) / sizes * sizes.mean()
    return np.max(sd[:6]), at


def cells_at(responses, listed):
    cells = responses.cells
    keys = list(zip(cells.mounts, cells.beta_deg.tolist(), cells.alpha_deg.tolist(), strict=True))
    return np.array([keys.index((mount, float(beta), float(alpha))) for mount, beta, alpha in listed])


@pytest.mark.parametrize(
    ("slow", "trend", "walk"), [(DRIFT, True, 0.0), pytest.param(WALK, None, 2e-5, marks=pytest.mark.long)]
)
def test_the_search_finds_the_best_of_all_orders(slow, trend, walk):
    ability = head(slow)
    responses = responses_to(ability)
    chosen = cells_at(
        responses, [("A", 0, 0), ("A", 0, 90), ("A", 0, 225), ("A", 40, 45), ("A", 40, 180), ("A", 40, 315)]
    )
    every = {order: worst_sd(responses, ability, order, trend, walk) for order in permutations(chosen.tolist())}
    found = best_order(responses, ability, Worst(), chosen, seed=3)
    sd, end_s = every[tuple(found.schedule.cells.tolist())]
    assert found.value == pytest.approx(sd, rel=2e-2 if walk else 1e-3)
    assert found.schedule.end_s == pytest.approx(end_s)
    # Without a limit a longer order must pay: the criterion times the square root of the duration is the least.
    assert sd * end_s**0.5 == pytest.approx(min(sd * end_s**0.5 for sd, end_s in every.values()), rel=1e-3)
    # Within a limit that allows one change of the pitch setting only.
    limit = min(end_s for _, end_s in every.values()) + 20
    found = best_order(responses, ability, Worst(), chosen, minutes=limit / 60, seed=3)
    best = min(sd for sd, end_s in every.values() if end_s <= limit)
    assert found.schedule.end_s <= limit
    assert worst_sd(responses, ability, found.schedule.cells.tolist(), trend, walk)[0] == pytest.approx(best, rel=3e-3)


@pytest.mark.long
def test_changes_of_settings_are_paid_for():
    ability = head(SlowNoise())
    responses = responses_to(ability)
    chosen = np.array([26, 3, 17, 9, 31, 0, 20, 14])
    # Four visits: two pitch settings of two mountings. 8 dwells with 5 s each, 7 moves of which one is a remount.
    shortest = 8 * 65 + 7 * 10 + 3 * 90 + 900
    for kind in ("best", "random"):
        found = best_order(responses, ability, Worst(), chosen, kind=kind).schedule
        assert sorted(found.cells.tolist()) == sorted(chosen.tolist())
        assert found.pitch_visit[-1] == 3 and found.mount_visit[-1] == 1
        assert shortest - 40 <= found.end_s <= shortest
    with pytest.raises(InputError, match="8 positions need at least 30 min"):
        best_order(responses, ability, Worst(), chosen, minutes=20)
    # Positions that are repeated without a turn: the search may not exceed the least time.
    twice = np.repeat(chosen[:4], 2)
    least = best_order(responses, ability, Worst(), twice, kind="keep").schedule
    tight = best_order(responses, ability, Worst(), np.sort(twice)[::-1], minutes=least.minutes)
    assert tight.schedule.minutes <= least.minutes
    # One mounting: 16 dwells, 15 turns and one change of the pitch setting fit into the first limit.
    walking, chosen = replace(ability, slow_noise=WALK), np.arange(16)
    limited = best_order(responses, walking, Worst(), chosen, minutes=22)
    longer = best_order(responses, walking, Worst(), chosen, minutes=30)
    assert limited.schedule.minutes <= 22 and limited.schedule.pitch_visit[-1] == 1
    assert 22 < longer.schedule.minutes <= 30 and longer.value < limited.value
    again = best_order(responses, walking, Worst(), chosen, minutes=22)
    assert again.schedule.cells.tolist() == limited.schedule.cells.tolist()


def test_an_order_continues_measured_positions():
    ability = head(DRIFT)
    responses = responses_to(ability)
    measured = schedule(responses.cells, np.arange(8), ability.times)
    found = best_order(responses, ability, Worst(), np.arange(8, 16), measured=np.arange(8)).schedule
    assert found.cells[:8].tolist() == list(range(8)) and sorted(found.cells[8:]) == list(range(8, 16))
    assert found.start_s[:8] == pytest.approx(measured.start_s)
    assert found.start_s[8] >= measured.end_s + 95 and found.pitch_visit[7:9].tolist() == [0, 1]
