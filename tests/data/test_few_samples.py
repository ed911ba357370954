"""Sd columns of few samples: taken together where they agree, each for itself where positions differ."""

import numpy as np
import pytest

from tumblecal.data import PositionSet
from tumblecal.data.few_samples import moderated


RNG = np.random.default_rng(4)


def drawn(sd, samples, positions=24):
    """Sds of means of so many samples; `sd` of one sample, (positions, 3) or a number."""
    readings = RNG.normal(size=(samples, positions, 3)) * sd
    return readings.std(axis=0, ddof=1) / np.sqrt(samples)


@pytest.mark.parametrize("samples", [3, 5, 20])
def test_where_positions_agree_all_have_one_sd(samples):
    own = drawn(2e-4, samples)
    told = moderated(own, np.full(24, float(samples)))
    off, before = (np.abs(sd / (2e-4 / np.sqrt(samples)) - 1) for sd in (told, own))
    assert np.median(off) < 0.25 and np.mean(off) < np.mean(before)
    np.testing.assert_allclose(np.sqrt(np.mean(told**2)), np.sqrt(np.mean(own**2)), rtol=0.15)


def test_where_positions_differ_each_keeps_most_of_its_own():
    """Two groups whose sd differ by ten, and positions with 20 or 80 samples."""
    truth = 1e-4 * np.repeat([1.0, 10.0], 12)[:, None] * np.ones(3)
    for samples in (np.full(24, 20), np.tile([20, 80], 12)):
        own = np.concatenate([drawn(truth[k : k + 1], int(count), 1) for k, count in enumerate(samples)])
        told = moderated(own, samples.astype(float)) * np.sqrt(samples)[:, None]
        np.testing.assert_allclose(told / truth, 1, atol=0.6)
        # Towards each other, by less than the noise of 20 samples.
        assert 0.9 < np.exp(np.mean(np.log(told / truth))) < 1.1


def test_the_weight_of_the_other_positions_is_that_of_the_distribution_of_the_sds():
    """Variances drawn from a scaled inverse chi-square of 8 degrees of freedom: each is weighted by 19 of 19 + 8."""
    rng = np.random.default_rng(8)
    truth = 1e-4 * np.sqrt(8 / rng.chisquare(8, (3000, 3)))
    own = truth * np.sqrt(rng.chisquare(19, truth.shape) / 19 / 20)
    told = moderated(own, np.full(3000, 20.0))
    slopes = [np.polyfit(own[:, axis] ** 2, told[:, axis] ** 2, 1)[0] for axis in range(3)]
    assert np.mean(slopes) == pytest.approx(19 / (19 + 8), rel=0.03)


def test_many_samples_and_stated_sds_are_not_changed(table1):
    sd = np.full((24, 3), 1e-4) * RNG.uniform(0.5, 2, (24, 3))
    columns = (table1.names, table1.alpha_deg, table1.beta_deg, table1.readings)
    for n in (None, np.full(24, 1000.0), np.ones(24)):
        assert PositionSet(*columns, sd=sd, n=n).weighing_sd is sd
