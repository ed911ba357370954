"""The covariance of dwells under slow noise of a head, against means of many drawn or sampled signals in numpy."""

import numpy as np
import pytest

from tumblecal.chain.head_ability import SlowNoise, Times
from tumblecal.noise.of_head import slow_covariance, tabulated_covariance


TIMES = Times(dwell_s=60.0)
START = 10.0 + np.array([0.0, 85.0, 290.0, 375.0, 2400.0, 9000.0])


def test_drift_and_warm_up_are_signals_of_random_size():
    stated = SlowNoise(drift_g_per_h=2e-4, warm_up_g=1e-3, warm_up_time_s=700.0)
    samples = START[:, None] + (np.arange(6000) + 0.5) * 60.0 / 6000
    drift = 2e-4 * (samples.mean(axis=1) - samples.mean()) / 3600
    warm_up = 1e-3 * np.exp(-(samples - START[0]) / 700.0).mean(axis=1)
    expected = np.outer(drift, drift) + np.outer(warm_up, warm_up)
    assert slow_covariance(stated, TIMES, START) == pytest.approx(np.tile(expected, (3, 1, 1)), rel=1e-6)


def test_the_tabulated_covariance_is_the_exact_one():
    stated = SlowNoise(1e-5, 2e-7, 3e-5, 700.0, 1e-4, 1e-3, 2000.0)
    exact = slow_covariance(stated, TIMES, START)
    assert tabulated_covariance(stated, TIMES, 9000.0)(START) == pytest.approx(exact[0], rel=2e-6)
