"""The causes' own curve: what is drawn over the nominal residuals is the signal that was hidden in them."""

import numpy as np

from tumblecal.report.diagnosis_signal import by_angle, by_column, explained


SIGMA = 1e-4


def test_the_curve_is_what_the_hidden_product_leaves(diagnosis):
    """A nominal fit in plain numpy of the noise-free signal leaves what the curve shows, to within the noise's part."""
    alpha, beta = diagnosis.data.alpha_deg, diagnosis.data.beta_deg
    u = np.stack(
        [
            -np.sin(np.radians(beta)),
            np.cos(np.radians(beta)) * np.sin(np.radians(alpha)),
            np.cos(np.radians(beta)) * np.cos(np.radians(alpha)),
        ],
        axis=1,
    )
    known = explained(diagnosis)
    assert np.isnan(known[20]).all() and not np.isnan(np.delete(known, 20, axis=0)).any()
    for setting in (0.0, 45.0, 90.0):
        here = beta == setting
        for curve in by_angle(diagnosis, here):
            at = np.interp(alpha[here], curve.across, curve.signal[:, 1])
            measured = ~np.isnan(known[here, 1])
            np.testing.assert_allclose(at[measured], known[here, 1][measured], atol=0.2 * SIGMA)
    assert by_angle(diagnosis, beta == 45.0)
    # Hidden was 8e-4 u_y u_z on y: the residuals follow it where it is largest.
    hidden = 8e-4 * u[:, 1] * u[:, 2]
    kept = np.arange(24) != 20
    assert np.corrcoef(known[kept, 1], hidden[kept])[0, 1] > 0.9


def test_what_drifts_has_its_curve_in_time_and_none_by_angle(drifting):
    assert drifting.labels == ("bias_drift.x",)
    assert not any(by_angle(drifting, drifting.data.beta_deg == setting) for setting in (0.0, 45.0, 90.0))
    (curve,) = by_column(drifting, "time_s", drifting.data.time_s)
    np.testing.assert_array_equal(curve.across, drifting.data.time_s)
    assert curve.signal[-1, 0] - curve.signal[0, 0] > 5 * SIGMA
    assert not by_column(drifting, "temperature_degc", np.full(24, 20.0))


def test_there_is_no_curve_where_nothing_was_inserted(adequate):
    assert (
        by_angle(adequate, adequate.data.beta_deg == 45.0) == []
        and by_column(adequate, "time_s", np.arange(24.0)) == []
    )
