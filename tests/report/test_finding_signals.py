"""Findings against the variable that drives them: the points and the curve are the hidden signal, by plain numpy."""

import numpy as np
import pytest

from tumblecal.show.figures.finding import finding_signals


SIGMA = 1e-4


def test_a_product_is_drawn_against_the_product_of_its_inputs(diagnosis):
    signals = {signal.label: (number, signal) for number, signal in finding_signals(diagnosis).items()}
    number, product = signals["cross_coupling.y.yz"]
    alpha, beta = np.radians(diagnosis.data.alpha_deg), np.radians(diagnosis.data.beta_deg)
    inputs = np.cos(beta) ** 2 * np.sin(alpha) * np.cos(alpha)
    assert number == 1 and product.axis == 1 and product.variable == "u_y u_z / g²"
    # The commanded angles differ by some mrad from those of the fit.
    np.testing.assert_allclose(product.across, inputs, atol=0.01)
    kept = np.arange(24) != 20
    # Hidden was 8e-4 g/g^2: the residuals without the cause follow it, with it they are noise.
    slope = np.polyfit(inputs[kept], product.before[kept], 1)[0]
    assert slope == pytest.approx(8e-4, abs=3e-4) and np.isnan(product.before[20])
    assert np.std(product.after[kept]) < 1.5 * SIGMA
    across, curve = product.curve
    assert np.polyfit(across, curve, 1)[0] == pytest.approx(slope, rel=0.1)


def test_what_drifts_is_drawn_against_time(drifting):
    ((number, drift),) = finding_signals(drifting).items()
    assert number == 1 and drift.label == "bias_drift.x" and drift.axis == 0 and drift.variable == "time / min"
    across, curve = drift.curve
    # 5 mg/h, in g a minute.
    assert np.polyfit(across, curve, 1)[0] == pytest.approx(5e-3 / 60, rel=0.2)
