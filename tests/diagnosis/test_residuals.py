"""What the residuals hold that no parameter can reach, against its known distribution."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.diagnosis.findings.residuals import discrepancies, normal_quantiles


@pytest.fixture(scope="module")
def diagnosis(diagnoser, hidden):
    return diagnoser(hidden(31, {"cross_coupling.y.yz": [8e-4]}, columns=False))


def of_a_right_model(diagnosis, seed):
    """The nominal fit with residuals as pure noise would leave them, by a projection written out."""
    jacobian = diagnosis.nominal.jacobian
    noise = np.random.default_rng(seed).standard_normal(len(jacobian))
    return replace(diagnosis.nominal, rows=noise - jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0])


def test_a_product_of_y_and_z_is_a_sine_of_twice_alpha_on_y(diagnosis):
    """u_y u_z = cos(beta)^2 sin(2 alpha) / 2: largest at beta 0, gone after the extension."""
    parts = discrepancies(diagnosis.nominal, 1.0)
    worst = max(parts, key=lambda part: abs(part.in_sd or 0.0))
    assert (worst.axis, worst.order, worst.wave, worst.pitch) == ("y", 2, "sin", 0)
    assert worst.in_sd == pytest.approx(8e-4 / 2 * np.sqrt(4) / 1e-4, abs=3.5)
    after = discrepancies(diagnosis.extended, 1.0)
    assert max(abs(part.in_sd or 0.0) for part in after) < 4


def test_one_percent_of_a_right_model_lies_outside_the_envelope(diagnosis):
    shares = [np.mean(normal_quantiles(of_a_right_model(diagnosis, seed)).outside) for seed in range(40)]
    assert 0.002 < np.mean(shares) < 0.025
    plot = normal_quantiles(diagnosis.nominal)
    assert np.any(plot.outside) and np.all(plot.low < plot.middle) and np.all(plot.middle < plot.high)
    np.testing.assert_allclose(plot.normal, -plot.normal[::-1], atol=1e-12)
