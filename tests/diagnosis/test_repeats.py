"""Large data sets in bounds: repeats are averaged, single faulty rows stay visible, the rest is refused in words."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.data import PositionSet, repeats
from tumblecal.data.repeats import MEANS, in_bounds
from tumblecal.ground.errors import InputError


SIGMA = 1e-4


def passes(count, effect=0.0, seed=1):
    """So many passes through 4 x 12 attitudes, a minute a position; a quadratic z axis of `effect` (g/g^2)."""
    alpha, beta = np.tile(np.arange(12) * 30.0, 4 * count), np.tile(np.repeat([0.0, 30.0, 60.0, 90.0], 12), count)
    a, b = np.radians(alpha), np.radians(beta)
    readings = np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
    readings[:, 2] += effect * readings[:, 2] ** 2
    readings = readings * 1.0005 + 2e-3 + SIGMA * np.random.default_rng(seed).normal(size=readings.shape)
    names = tuple(f"p{row}" for row in range(len(alpha)))
    count = len(alpha)
    columns = {"temperature_degc": np.full(count, 25.0), "approach": np.ones(count)}
    return PositionSet(names, alpha, beta, readings, time_s=60.0 * np.arange(count), **columns)


@pytest.mark.parametrize("noise", ["unknown", "option", "columns"])
def test_means_are_those_of_their_repeats(noise):
    data = passes(42)
    sd = SIGMA * np.random.default_rng(2).uniform(0.5, 2.0, data.readings.shape)
    if noise == "columns":
        data = replace(data, sd=sd)
    bounded = in_bounds(data, SIGMA if noise == "option" else None)
    means, number = bounded.data, {name: row for row, name in enumerate(data.names)}
    assert len(means) <= MEANS and bounded.noise_sd is None and str(len(data)) in bounded.words
    assert means.n is not None and means.n.sum() == len(data)
    assert np.all(np.diff(means.time_s) >= 0)
    for k, name in enumerate(means.names):
        first, last = (number[part] for part in name.split(".."))
        rows = np.arange(first, last + 1, 48)
        weights = 1 / data.sd[rows] ** 2 if noise == "columns" else np.ones((len(rows), 3))
        np.testing.assert_allclose(
            means.readings[k], np.average(data.readings[rows], axis=0, weights=weights), atol=1e-15
        )
        np.testing.assert_allclose(means.time_s[k], data.time_s[rows].mean())
        assert (means.alpha_deg[k], means.beta_deg[k]) == (data.alpha_deg[first], data.beta_deg[first])
        if noise == "unknown":
            assert means.sd is None
        else:
            expected = weights.sum(axis=0) ** -0.5 * (1 if noise == "columns" else SIGMA)
            np.testing.assert_allclose(means.sd[k], expected)


def test_faulty_rows_stay_by_themselves():
    data = passes(42)
    readings = data.readings.copy()
    readings[1000, 1] += 30 * SIGMA
    readings[[77, 78]] = readings[[78, 77]]
    names = in_bounds(replace(data, readings=readings), None).data.names
    assert {name for name in names if ".." not in name} == {"p1000", "p77", "p78"}


def test_what_does_not_repeat_is_refused_with_its_cost_or_done_where_allowed():
    data = passes(42)
    data = replace(data, alpha_deg=np.linspace(0, 359, len(data)))
    with pytest.raises(InputError, match=r"2016 positions.*about [\d.]+ min and \d+ GiB.*--max-rows 2016") as refused:
        in_bounds(data, None)
    assert len(refused.value.faults) == 1
    allowed = in_bounds(data, None, len(data))
    assert allowed.data is data
    some = data.chosen(np.arange(600))
    bounded = in_bounds(some, 1e-4)
    assert bounded.data is some and bounded.noise_sd == 1e-4 and "about" in bounded.words
    # Samples belong to single positions.
    with pytest.raises(InputError, match="cannot be averaged"):
        in_bounds(passes(42), None, sampled=True)


@pytest.mark.long
def test_two_thousand_rows_are_diagnosed_as_means(diagnoser, monkeypatch):
    monkeypatch.setattr(repeats, "MEANS", 48)
    diagnosis = diagnoser(in_bounds(passes(42, effect=2e-4), SIGMA).data)
    assert diagnosis.labels == ("second_order.z",)
    fit = diagnosis.extended
    assert abs(fit.value("second_order.z") - 2e-4) < 4 * fit.sd[fit.names.index("second_order.z")]
    assert diagnoser(in_bounds(passes(42), SIGMA).data).verdict == "adequate"
