"""The test of two and three positions off together, and of one beside an effect, against least squares without them and F
distributions done here."""

from itertools import combinations
from math import comb

import numpy as np
import pytest
from scipy import stats

from tumblecal.diagnosis.causes.cause import EFFECT, Cause
from tumblecal.diagnosis.causes.faults import outlier
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.diagnosis.sets.positions_off import positions_off


POSITIONS, PARAMETERS = 8, 7
DOF = 3 * POSITIONS - PARAMETERS


@pytest.fixture(scope="module")
def plan():
    """A random linear model: its residual space (rows) and the pool of positions that may be off, whole or on one axis."""
    design = np.random.default_rng(4).normal(size=(3 * POSITIONS, PARAMETERS))
    space = np.linalg.svd(design)[0][:, PARAMETERS:].T
    whole = [np.linalg.qr(space[:, 3 * k : 3 * k + 3])[0] for k in range(POSITIONS)]
    single = [space[:, 3 * k : 3 * k + 1] / np.linalg.norm(space[:, 3 * k]) for k in range(POSITIONS)]
    causes = [outlier(f"outlier_position:{k}", (-3.0, -3.0), own[k], k) for own in (single, whole) for k in range(8)]
    return design, space, Pool.of(causes, DOF)


def bounded(design, readings, number):
    """Bonferroni's bound of the best set of this many positions, by F tests."""
    left = lambda rows: np.linalg.lstsq(design[rows], readings[rows], rcond=None)[1][0]  # noqa: E731
    every, least = np.arange(3 * POSITIONS), 1.0
    for off in combinations(range(POSITIONS), number):
        kept = every[~np.isin(every // 3, off)]
        free = DOF - 3 * number
        ratio = (left(every) - left(kept)) / (3 * number) / (left(kept) / free)
        least = min(least, stats.f.sf(ratio, 3 * number, free))
    return 2 * comb(POSITIONS, number) * least


@pytest.mark.parametrize("off", [(), (2, 5), (1, 2, 7)])
@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_the_bound_is_that_of_f_tests_without_the_positions(plan, off, scale):
    design, space, pool = plan
    for seed in range(5):
        rng = np.random.default_rng(seed)
        readings = rng.normal(size=3 * POSITIONS)
        for position in off:
            readings[3 * position : 3 * position + 3] += 6.0
        expected = min(1.0, *(bounded(design, readings, number) for number in (2, 3)))
        np.testing.assert_allclose(positions_off(pool, scale * (space @ readings)), expected, rtol=1e-3)


@pytest.mark.long
def test_noise_alone_comes_below_a_bound_no_more_often_than_it_says(plan):
    pool = plan[2]
    rng = np.random.default_rng(11)
    values = np.array([positions_off(pool, rng.normal(size=DOF)) for _ in range(3000)])
    for bound in (0.01, 0.05):
        share = np.mean(values < bound)
        assert 0.3 * bound < share < bound + 3 * np.sqrt(bound / len(values))


@pytest.fixture(scope="module")
def with_effects(plan):
    """The same with three effects: their signals in the readings, and the pool."""
    _, space, pool = plan
    signals = [np.random.default_rng(5 + width).normal(size=(3 * POSITIONS, width)) for width in (1, 1, 2)]
    effects = [
        Cause(EFFECT, f"effect_{k}", -3.0, -3.0, np.linalg.qr(space @ signal)[0]) for k, signal in enumerate(signals)
    ]
    return signals, Pool.of([*effects, *pool.causes], DOF)


def bounded_beside(design, signals, readings):
    """Bonferroni's bound of the best position and effect, by F tests."""
    left = lambda rows, model: np.linalg.lstsq(model[rows], readings[rows], rcond=None)[1][0]  # noqa: E731
    every, least = np.arange(3 * POSITIONS), 1.0
    for off in range(POSITIONS):
        for signal in signals:
            taken = 3 + signal.shape[1]
            rest = left(every[every // 3 != off], np.hstack([design, signal]))
            ratio = (left(every, design) - rest) / taken / (rest / (DOF - taken))
            least = min(least, stats.f.sf(ratio, taken, DOF - taken))
    return POSITIONS * len(signals) * least


@pytest.mark.parametrize(("effect", "off"), [(0, 5), (2, 1), (None, 3), (1, None)])
def test_the_bound_is_that_of_f_tests_without_a_position_beside_an_effect(plan, with_effects, effect, off):
    design, space, _ = plan
    signals, pool = with_effects
    for seed in range(5):
        readings = np.random.default_rng(seed).normal(size=3 * POSITIONS)
        if effect is not None:
            readings += 4.0 * signals[effect].sum(axis=1)
        if off is not None:
            readings[3 * off : 3 * off + 3] += 8.0
        alone = min(bounded(design, readings, number) for number in (2, 3))
        expected = min(1.0, 2 * min(alone, bounded_beside(design, signals, readings)))
        np.testing.assert_allclose(positions_off(pool, space @ readings), expected, rtol=5e-3)
