"""Curves of a fit over temperature: the change that the chain applies to the readings, fitted or known."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.chain import nominal_chain
from tumblecal.estimation import exact, problem_of, where_of
from tumblecal.estimation.curves_of_fit import curves_of
from tumblecal.ground.temperature_functions import TemperatureFunctions


@pytest.mark.parametrize("known", [True, False])
def test_curves_are_the_change_of_the_readings(table1, known):
    """Of the bias, so that the change of a reading is the curve itself."""
    data = replace(table1, temperature_degc=np.tile([20.0, 23.0, 27.0, 30.0], 6))
    where = where_of(data)
    plain = nominal_chain(where, temperature={"bias": TemperatureFunctions(2, 25.0, (18.0, 35.0))})
    changes = [name for name in plain.names if name.startswith("bias_T_")]
    changed = plain.named(dict(zip(changes, 1e-4 * np.array([1.0, -2.0, 3.0, 4.0, -5.0, 6.0]), strict=True)))
    shift = np.asarray(changed(where) - plain(where))
    data = replace(data, readings=data.readings + shift)
    fit = exact.fit(problem_of(data, changed.fixed({"bias_T"}) if known else changed, noise_sd=1e-4))
    assert len(fit.names) == 15 + 6 * (not known)
    curves = curves_of(fit)
    assert [curve.parameter for curve in curves.curves] == ["bias_x", "bias_y", "bias_z"]
    assert curves.curves[0].functions.range_degc == (20.0, 30.0)  # the measured part
    found, sd = curves.at(data.temperature_degc)[:, 3:6], 0.0 if known else 5e-4
    np.testing.assert_allclose(found, shift, atol=1e-12 + sd)
    names = [name for name in fit.names if name in ("dK_x", "bias_y", "gamma_32")]
    block = [fit.names.index(name) for name in names]
    here = [curves.covariance_order.index(name) for name in names]
    np.testing.assert_allclose(curves.covariance[np.ix_(here, here)], fit.covariance[np.ix_(block, block)])


def test_a_constant_bias_has_no_curve(table1_fit):
    assert curves_of(table1_fit) is None
