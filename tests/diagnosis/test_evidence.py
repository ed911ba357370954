"""Bayes factors and evidence against integrals done here: the scale by docs/method.md, the noise by quadrature."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate
from scipy.special import gammaln

from tumblecal.full_model.evidence import (
    gain,
    log_evidence,
    log_evidence_of_noise,
)


DOF = 40
METHOD = (Path(__file__).parents[2] / "docs" / "method.md").read_text(encoding="utf-8")
LOW, HIGH = map(float, re.search(r"s1 = (\d+), s2 = (\d+)", METHOD).groups())  # type: ignore[union-attr]


def log_bayes_factor(explained, rank):
    """The integral of docs/method.md over the unknown scale, by quadrature."""

    def integrand(log_scale):
        squared = np.exp(2 * log_scale)
        return (1 + squared) ** (-rank / 2) * np.exp(-0.5 * explained / (1 + squared))

    low, high = np.log(LOW), np.log(HIGH)
    top = np.clip(0.5 * np.log(explained + 1), low, high)  # where the integrand of a large `explained` rises
    value = integrate.quad(integrand, low, high, epsabs=0, epsrel=1e-10, points=[top])[0]
    return np.log(value / (high - low)) + 0.5 * explained


@pytest.mark.parametrize("rank", [1, 2, 4, 12])
def test_gain_is_the_integral_also_beyond_its_table(rank):
    explained = np.array([0.0, 1.0, 12.0, 80.0, 1500.0, 1999.9, 2000.6, 2001.5, 3e4])
    expected = [log_bayes_factor(own, rank) for own in explained.tolist()]
    np.testing.assert_allclose(gain(explained, rank), expected, rtol=0, atol=0.012)
    np.testing.assert_allclose([gain(np.array(own), rank) for own in explained], expected, rtol=0, atol=0.012)


def test_the_noise_is_integrated_out():
    """Under the prior 1/sigma: of noise alone by the gamma function, of an effect by quadrature over log sigma."""
    for total in (1e-9, 0.3, 55.0):
        exact = gammaln(DOF / 2) - np.log(2) + 0.5 * DOF * np.log(2 / total)
        assert log_evidence_of_noise(np.array(total), DOF, False) == pytest.approx(exact, abs=0.01)
    assert log_evidence_of_noise(np.array(55.0), DOF, True) == pytest.approx(-27.5)
    grid = np.linspace(-3.0, 3.0, 4001)
    for parts in ([(25.0, 1)], [(900.0, 3)], [(400.0, 2), (9.0, 1)], [(0.0, 0), (70.0, 1)]):
        total = sum(part for part, _ in parts) + 37.0
        heights = -0.5 * total / np.exp(2 * grid) - DOF * grid
        for part, rank in parts:
            heights += gain(part / np.exp(2 * grid), rank)
        by_quadrature = np.log(np.trapezoid(np.exp(heights - heights.max()), grid)) + heights.max()
        given = [(np.array(part), rank) for part, rank in parts]
        # Laplace's method is around the best sigma of the residuals, not of the whole.
        assert log_evidence(np.array(total), given, DOF, False) == pytest.approx(by_quadrature, abs=0.2)


def test_the_unit_of_unknown_noise_does_not_matter_and_rounding_is_no_evidence():
    parts, total = [(np.array([30.0, 5.0]), 2), (np.array([4.0, 0.0]), 1)], np.array([70.0, 40.0])
    evidence = log_evidence(total, parts, DOF, False)
    for unit in (1e-14, 1e8):
        scaled = log_evidence(unit * total, [(unit * part, rank) for part, rank in parts], DOF, False)
        np.testing.assert_allclose(scaled, evidence - 0.5 * DOF * np.log(unit), rtol=1e-12)
    # All but 1e-14 or 1e-15 of the total is all of it: which of two exact sets is better is not seen in such residuals.
    exact, same, not_exact = (
        log_evidence(np.array(1.0), [(np.array(1.0 - rest), 1)], DOF, False) for rest in (1e-15, 1e-14, 1e-11)
    )
    assert same == pytest.approx(exact, abs=5) and exact > not_exact + 50
    assert np.isfinite(log_evidence(np.array(0.0), [(np.array(0.0), 1)], DOF, False))


def test_a_set_that_leaves_few_degrees_of_freedom_has_no_evidence_for_unknown_noise():
    ranks = np.array([5, 7, 8, 9, 12])
    total, explained = np.full(5, 50.0), np.full(5, 49.0)
    evidence = log_evidence(total, [(explained, ranks)], 10, False)
    assert np.isfinite(evidence).tolist() == [True, True, False, False, False]
    assert np.all(evidence[2:] == -np.inf) and np.all(np.isfinite(log_evidence(total, [(explained, ranks)], 10, True)))
