"""Drifts of data by several clocks: nothing that is said of a rate depends on the length of a pause."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.chain import nominal_chain, settings
from tumblecal.data import PositionSet
from tumblecal.data.joined import joined
from tumblecal.effects import catalogue
from tumblecal.effects.catalogue import links
from tumblecal.effects.effect import Effect
from tumblecal.estimation import exact
from tumblecal.estimation.position_problem import problem_of


DRIFT_G_S = -1.77e-3 / 3600
SIGMA = 1e-4


def two_files(pause_s: float) -> list[PositionSet]:
    """A perfect triad whose x output drifts, at 4 x 8 and 8 positions; the second file's clock starts again."""
    alpha, beta = (np.concatenate(own) for own in ((np.tile(np.arange(0, 360, 45.0), 4), np.arange(8) * 45.0),
                                                   (np.repeat([0.0, 30, 60, 90], 8), np.repeat([0.0, 60], 4))))  # fmt: skip
    a, b = np.radians(alpha), np.radians(beta)
    ideal = np.stack([-np.sin(b), np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)], axis=1)
    time = np.concatenate([np.arange(32) * 60.0, 32 * 60 + pause_s + np.arange(8) * 60.0])
    readings = ideal + SIGMA * np.random.default_rng(1).normal(size=ideal.shape)
    readings[:, 0] += DRIFT_G_S * time
    own = time - np.where(np.arange(40) < 32, 0.0, time[32])
    names = tuple(f"p{k}" for k in range(40))
    whole = PositionSet(names, alpha, beta, readings, time_s=own)
    return [
        replace(whole.chosen(rows), source=f"{name}.csv") for name, rows in (("a", range(32)), ("b", range(32, 40)))
    ]


def rate_and_change(data: PositionSet) -> tuple[np.ndarray, np.ndarray]:
    """Rate (g/s) and change over the pause (g) of the fitted drift, with their sd."""
    problem = problem_of(data, noise_sd=SIGMA)
    link = links(catalogue(), ("bias_drift.x",), problem.where)["bias_drift.x"][0]
    fit = exact.fit(problem.with_links(link))
    own = [fit.names.index(name) for name in fit.names if name.startswith("bias_drift")]
    assert [fit.names[k] for k in own] == ["bias_drift.x", "bias_drift.x_after_pause_1"][: len(own)]
    return fit.values[own], fit.sd[own]


def by_least_squares(data: PositionSet) -> tuple[float, float]:
    """The rate by numpy: x outputs with bias, scale, misalignments, a drift and a level of the second file free."""
    # With dbeta of every setting free, what x reads at one setting says nothing of its bias and scale factor.
    later = np.arange(40) >= 32
    setting = data.beta_deg[:, None] == np.unique(data.beta_deg)
    time = np.where(later, data.time_s - data.time_s[32], data.time_s)
    turned = np.stack([np.sin(data.alpha), np.cos(data.alpha)], axis=1) * np.cos(data.beta)[:, None]
    columns = np.column_stack([setting, turned, time, later])
    values = np.linalg.lstsq(columns, data.readings[:, 0], rcond=None)[0]
    sd = SIGMA * np.sqrt(np.linalg.inv(columns.T @ columns)[-2, -2])
    return float(values[-2]), float(sd)


def test_a_rate_does_not_depend_on_a_pause_of_unknown_length():
    """The pause was taken as one mean step: the rate came out as -9 mg/h after a pause of two hours."""
    shifted = joined(two_files(7200.0))
    assert len(set(shifted.clock)) == 2
    values, sd = rate_and_change(shifted)
    expected, expected_sd = by_least_squares(shifted)
    # The other axes say a little of the pitch errors as well.
    assert abs(values[0] - expected) < 0.5 * expected_sd and 0.5 * expected_sd < sd[0] < 1.05 * expected_sd
    assert abs(values[0] - DRIFT_G_S) < 3 * sd[0]
    assert abs(values[1] - DRIFT_G_S * (32 * 60 + 7200.0)) < 3 * sd[1]
    # However the times of the second file are written, and with any pause, the rate is the same number.
    later = np.arange(40) >= 32
    for assumed in (600.0, 1e6):
        moved = replace(shifted, time_s=shifted.time_s + assumed * later)
        np.testing.assert_allclose(rate_and_change(moved)[0], values, rtol=1e-6)
    # With the pause known the same rows tell it some ten times as well.
    known = joined([own if k == 0 else replace(own, time_s=own.time_s + 32 * 60 + 7200.0)
                    for k, own in enumerate(two_files(7200.0))])  # fmt: skip
    assert known.clock is None
    value, better = rate_and_change(known)
    assert better[0] < sd[0] / 5 and abs(value[0] - DRIFT_G_S) < 3 * better[0]


TIMED = [one for one in catalogue().values() if one.make is not None and "time_s" in one.needs and one.pauses == "any"]


@pytest.mark.parametrize("effect", TIMED, ids=lambda own: own.id)
def test_every_effect_of_time_says_nothing_across_an_unknown_pause(effect: Effect):
    """The signals that an effect can make are the same, however long the pause is taken to be."""
    time = np.array([0.0, 60, 130, 190, 0, 70, 120, 200])
    clock, alpha, beta = ["a"] * 4 + ["b"] * 4, np.arange(8.0), np.tile(np.repeat([0.0, 1.0], 2), 2)

    def signals(pause: float) -> np.ndarray:
        where = settings(
            alpha, beta, run=clock, clock=clock, time_s=time + pause * np.repeat([0, 1], 4), approach=np.ones(8),
            temperature_degc=25 + np.sin(alpha),
        )  # fmt: skip
        chain = nominal_chain(where)
        chain = chain + effect.make(where)[0]
        names = [name for name in chain.names if name.startswith(effect.id) and "tau" not in name]
        return np.stack([np.asarray(chain.named({name: 1e-3})(where)) for name in names])

    np.testing.assert_allclose(signals(250.0), signals(9e5), atol=1e-12)


def test_an_effect_that_needs_the_length_of_a_pause_is_not_testable():
    where = settings(np.zeros(4), np.zeros(4), time_s=np.arange(4.0), clock=["a", "a", "b", "b"], run=["1"] * 3 + ["2"])
    drift = catalogue()["run_drift.x"]
    assert drift.lacking(where) == "pauses of unknown length"
    assert catalogue()["bias_drift_square.x"].lacking(where) == "pauses of unknown length"
    own = replace(catalogue()["bias_drift.x"], pauses="")
    assert own.lacking(where) == "pauses of unknown length"
    assert not own.lacking(settings(np.zeros(2), np.zeros(2), time_s=np.arange(2.0)))
