"""The posterior of all effects' coefficients, by other arithmetic: normal densities of scipy, term by term."""

import numpy as np
import pytest
from scipy import stats

from tumblecal.full_model import priors
from tumblecal.full_model.effect_posterior import Candidates, effect_posterior


def by_densities(signals, z, shown, always, candidates):
    """Mean and mean products summed over every scale, candidate and size, with the densities of `z` by scipy."""
    visible = np.linalg.norm(signals, axis=0)
    weights, means, products = [], [], []
    for scale, prior in zip(priors.UNDETECTED_SIZES, priors.UNDETECTED_WEIGHTS, strict=True):
        sd = np.array([scale / np.hypot(scale, size) if scale else 0.0 for size in visible])
        sd[~shown] = np.median(sd[shown])
        sd[always] = np.maximum(sd[always], 0.3)
        for named, log_prior in zip(candidates.named, candidates.log_prior, strict=True):
            sizes = np.geomspace(0.3, 300.0, 16) if named.any() else [0.0]
            for size in sizes:
                own = np.diag(sd**2 + named * size**2)
                whole = np.eye(len(z)) + signals @ own @ signals.T
                density = stats.multivariate_normal(np.zeros(len(z)), whole).logpdf(z)
                weights.append(density + np.log(prior / len(sizes)) + log_prior)
                gain = own @ signals.T @ np.linalg.inv(whole)
                means.append(gain @ z)
                products.append(own - gain @ signals @ own + np.outer(means[-1], means[-1]))
    shares = np.exp(np.array(weights) - max(weights))
    shares /= shares.sum()
    return shares @ np.array(means), np.tensordot(shares, np.array(products), 1)


@pytest.fixture
def case():
    rng = np.random.default_rng(3)
    signals = rng.normal(size=(20, 7)) * [3.0, 3.0, 10.0, 0.5, 2.0, 2.0, 0.0]
    shown = np.array([True] * 6 + [False])
    always = np.array([False] * 5 + [True, False])
    first = np.array([True, True] + [False] * 5)
    named = np.array([np.zeros(7, bool), first, np.roll(first, 2)])
    candidates = Candidates(named, np.zeros_like(named), np.log([0.25, 0.01, 0.02]))
    return signals, shown, always, candidates, rng


@pytest.mark.parametrize("size", [0.0, 0.7, 4.0])
def test_equals_the_sum_over_normal_densities(case, size):
    signals, shown, always, candidates, rng = case
    z = signals @ (size * np.array([1.0, -0.5, 0, 0, 0.1, 0.1, 0.0])) + rng.normal(size=20)
    found = effect_posterior(signals, z, shown, always, candidates, dof=len(z), known=True)
    mean, products = by_densities(signals, z, shown, always, candidates)
    np.testing.assert_allclose(found.mean, mean, atol=2e-3 * max(1.0, np.abs(mean).max()))
    np.testing.assert_allclose(found.second, products, atol=4e-3 * max(1.0, np.abs(products).max()))


def test_only_products_of_the_rows_count(case):
    """In more rows than directions, in which most of the residual is in none of the signals."""
    signals, shown, always, candidates, rng = case
    z = signals @ np.array([4.0, -2.0, 0, 0, 0.1, 0.1, 0.0]) + rng.normal(size=20)
    few = effect_posterior(signals[:6], z[:6], shown, always, candidates, dof=20, known=True)
    turned = np.linalg.qr(rng.normal(size=(20, 6)))[0]
    many = effect_posterior(turned @ signals[:6], turned @ z[:6], shown, always, candidates, dof=20, known=True)
    np.testing.assert_allclose(many.mean, few.mean, rtol=1e-9)
    np.testing.assert_allclose(many.second, few.second, atol=1e-9 * few.second.max())


def test_a_hidden_coefficient_is_as_large_as_the_others_of_its_effect(case):
    signals, shown, always, candidates, rng = case
    hidden = np.array([False] * 6 + [True])
    z = signals @ np.array([20.0, -25.0, 0, 0, 0, 0, 0]) + rng.normal(size=20)
    without = effect_posterior(signals, z, shown, always, candidates, dof=len(z), known=True)
    candidates.of_same_size[1] = hidden
    found = effect_posterior(signals, z, shown, always, candidates, dof=len(z), known=True)
    assert without.second[6, 6] < 1.0
    # Student's t of two draws about their root mean square, by its 95 % interval: 2.2 times 22.6.
    assert np.sqrt(found.second[6, 6]) == pytest.approx(2.2 * 22.6, rel=0.25)
    np.testing.assert_allclose(found.mean, without.mean)


def test_an_unlikely_explanation_with_a_huge_coefficient_is_not_followed():
    """Many small effects together may look like one that hardly shows, with a coefficient of dozens of typical sizes: its mean
    stays near zero, where least squares has the whole coefficient."""
    rng, held, squares = np.random.default_rng(5), [], []
    for _ in range(200):
        signals = rng.normal(size=(24, 30))
        signals[:, 0] *= 0.06
        shown, always = np.ones(30, bool), np.zeros(30, bool)
        truth = rng.normal(size=30)
        z = signals @ truth + rng.normal(size=24)
        named = np.arange(30) == [[-1], [0]]
        candidates = Candidates(named, np.zeros_like(named), np.log([0.25, 0.01]))
        found = effect_posterior(signals, z, shown, always, candidates, dof=len(z), known=True)
        by_least_squares = signals[:, 0] @ z / (signals[:, 0] @ signals[:, 0])
        squares.append([(found.mean[0] - truth[0]) ** 2, (by_least_squares - truth[0]) ** 2])
        sd = np.sqrt(found.second[0, 0] - found.mean[0] ** 2)
        held.append(abs(found.mean[0] - truth[0]) < 1.96 * sd)
    ours, others = np.sqrt(np.mean(squares, axis=0))
    assert ours < 0.2 * others
    assert np.mean(held) > 0.9
