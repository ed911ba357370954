"""Conditions of new positions, and what is promised of them: normal distributions in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from tumblecal.data import PositionSet
from tumblecal.plan.next.conditions import candidates, continued
from tumblecal.plan.next.rows import Posterior
from tumblecal.plan.next.separating import promise_of


def measured(time=True, temperature=None):
    """Twelve positions five minutes apart."""
    count = 12
    return PositionSet(
        tuple(map(str, range(count))),
        np.zeros(count),
        np.zeros(count),
        np.tile([0.0, 0.0, 1.0], (count, 1)),
        time_s=300.0 * np.arange(count) if time else None,
        temperature_degc=temperature,
    )


def test_new_positions_continue_the_time_and_the_temperature_of_the_last_ones_not_their_median():
    ramp = 24.0 + 0.2 * np.arange(12)
    conditions = continued(measured(temperature=ramp))
    assert (conditions.time_s, conditions.after_s, conditions.step_s, conditions.run) == (3600.0, 300.0, 300.0, "1")
    assert conditions.temperature_degc == pytest.approx(26.4) and conditions.last_temperature_degc == pytest.approx(
        26.2
    )
    without_time = continued(measured(time=False, temperature=ramp))
    assert without_time.temperature_degc == pytest.approx(26.2) and without_time.time_s is None


def test_a_pause_and_another_temperature_are_tried_where_an_explanation_depends_on_them():
    data = measured(temperature=24.0 + 0.2 * np.arange(12))
    assert list(candidates(data, in_time=False, with_temperature=False)) == [continued(data)]
    tried = [
        (own.after_s, round(own.temperature_degc, 1)) for own in candidates(data, in_time=True, with_temperature=True)
    ]
    assert tried == [(300, 26.4), (1650, 26.2), (1650, 24.0), (3300, 26.2), (3300, 24.0)]
    # Where the temperature hardly varied a warmer unit shows a dependence on it.
    steady = candidates(measured(temperature=np.full(12, 20.0)), in_time=False, with_temperature=True)
    assert [own.temperature_degc for own in steady] == pytest.approx([20.0, 25.0])


def promised(apart, *, sd=0.0, odds=1.0, larger=0.0, unlisted=0.0, unnamed=()):
    """A coefficient 1 +- `sd` whose signal at a new position, on x, is `apart` sd of the noise; the alternative has none."""
    known = 1.0 / max(sd, 1e-4) ** 2
    signal = apart * np.eye(3)[None, :, :1]
    with_it = Posterior(signal, np.array([[known]]), np.array([known]), np.zeros((1, 3)))
    posteriors = [with_it, Posterior(0.0 * signal, np.eye(1), np.zeros(1), np.zeros((1, 3)))]
    competition = SimpleNamespace(
        log_odds=np.log([odds]),
        alternatives=(("b",),),
        competing=[SimpleNamespace(larger=larger)] * 2,
        unlisted=unlisted,
        unnamed=list(unnamed),
    )
    return promise_of(posteriors, competition)


@pytest.mark.parametrize("apart", [4.0, 6.0])
def test_the_probability_that_two_predictions_are_told_apart(apart):
    """The log likelihood ratio of N(apart, 1) and N(0, 1) is normal: mean apart^2 / 2, variance apart^2; e^4 is needed."""
    promise = promised(apart)
    assert promise.given_listed == pytest.approx(norm.cdf((apart**2 / 2 - 4) / apart), abs=0.04)
    assert promise.odds == pytest.approx(np.exp(apart**2 / 2), rel=0.35 * apart)
    assert promise.excluded == (("b",),)


def test_what_is_not_known_of_a_coefficient_counts_against_the_promise():
    """N(6, 1 + 36/4) against N(0, 1): by two million draws of numpy."""
    rng, odds = np.random.default_rng(0), 0.5
    wide = np.sqrt(1 + 9.0)
    x = np.array([rng.normal(6.0, wide, 1_000_000), rng.normal(0.0, 1.0, 1_000_000)])
    ratio = norm.logpdf(x, 6.0, wide) - norm.logpdf(x, 0.0, 1.0) - np.log(odds)
    expected = (np.mean(ratio[0] > 4) + odds * np.mean(ratio[1] < -4)) / (1 + odds)
    told = promised(6.0, sd=0.5, odds=odds)
    assert told.given_listed == pytest.approx(expected, abs=0.04) and expected < 0.65 and not told.made


def test_a_promise_allows_for_what_is_not_among_the_explanations():
    """Their probability, and that of the true causes with further ones, which remains."""
    sure = promised(8.0)
    assert sure.made and sure.probability < 0.98 < sure.given_listed
    allowed = promised(8.0, unlisted=0.12)
    assert allowed.probability == pytest.approx(0.88 * sure.probability) and not allowed.made
    # Alone the true causes then have at most 1 / 1.3, and 0.8 is identified.
    assert promised(8.0, larger=0.1).made
    assert not promised(8.0, larger=0.3).made
    # What has no name predicts nothing, and remains.
    unnamed = promised(8.0, unnamed=[("unexplained",)])
    assert unnamed.excluded == (("b",),) and unnamed.remaining == (("unexplained",),)
