"""Findings against the variable that drives them: the points and the curve are the hidden signal, by plain numpy."""

from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.report.finding_figures import _smooth, card_figures, finding_signals
from tumblecal.report.unnamed_figure import small_unnamed_figure


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


def test_a_disturbed_position_is_marked_in_the_order_of_measurement(diagnosis):
    first, outlier = finding_signals(diagnosis).values()
    assert first.size >= outlier.size or outlier.label == "outlier_position:p21"
    outlier = next(s for s in (first, outlier) if s.label.startswith("outlier"))
    assert outlier.variable == "position number" and np.flatnonzero(outlier.marked).tolist() == [20]
    assert abs(outlier.before[20]) > 5 * SIGMA and not len(outlier.curve[0])


def test_what_drifts_is_drawn_against_time(drifting):
    ((number, drift),) = finding_signals(drifting).items()
    assert number == 1 and drift.label == "bias_drift.x" and drift.axis == 0 and drift.variable == "time / min"
    across, curve = drift.curve
    # 5 mg/h, in g a minute.
    assert np.polyfit(across, curve, 1)[0] == pytest.approx(5e-3 / 60, rel=0.2)


def test_a_smooth_function_is_found_and_noise_is_not_one():
    rng, across = np.random.default_rng(1), np.linspace(-1, 1, 24)
    share, (fine, values) = _smooth(across, 3e-4 * across**2, circular=False)
    assert share == pytest.approx(1.0) and np.allclose(values, 3e-4 * fine**2, atol=1e-9)
    assert _smooth(across, rng.normal(size=24), circular=False)[0] < 0.5
    # Eight angles: three coefficients at most, so that not any eight numbers are harmonics.
    angles = np.arange(8) * 45.0
    assert _smooth(angles, np.cos(np.radians(angles)), circular=True)[0] == pytest.approx(1.0)
    assert _smooth(angles, np.cos(3 * np.radians(angles)), circular=True)[0] < 0.2


def test_every_finding_has_a_picture_and_no_finding_has_one_of_all_residuals(diagnosis, adequate):
    for one, numbers in ((diagnosis, [1, 2]), (adequate, [0])):
        assert sorted(card_figures(one, finding_signals(one))) == numbers


def test_the_card_of_an_unexplained_error_has_the_map_of_its_most_affected_output():
    """An excess of 0.8 mg on z at six of 24 positions: one map of z with its scale, drawn for the width of a card."""
    alpha, beta = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, 360.0, 45.0), [0.0, 30.0, 60.0]))
    inside = (alpha > 100) & (alpha < 250) & (beta > 0)
    excess = SimpleNamespace(
        values=np.outer(8e-4 * inside, [0.1, 0.0, 1.0]), positions=inside, region="alpha 135 to 225"
    )
    shown = SimpleNamespace(data=SimpleNamespace(alpha_deg=alpha, beta_deg=beta))
    figure = small_unnamed_figure(shown, SimpleNamespace(excess=excess, law=None))
    panel, _ = figure.axes
    (points,) = panel.collections
    assert panel.get_title() == "z / mg" and figure.get_figwidth() < 4
    np.testing.assert_allclose(points.get_array(), 0.8 * inside)
    assert len(panel.lines[0].get_xdata()) == inside.sum() == 6
