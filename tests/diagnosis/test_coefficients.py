"""The coefficients of a polynomial in one variable about one reference; from records made by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.diagnosis.causes.cause import EFFECT, NO_SLOT, Cause
from tumblecal.diagnosis.coefficients import about_one_reference
from tumblecal.effects import catalogue


ENTRIES = catalogue()
DEGC, TIME_S = np.array([10.0, 18.0, 26.0, 30.0]), np.array([100.0, 1900.0, 2500.0, 3700.0])
UNITS = {"bias_temperature": "g/degC", "bias_temperature_square": "g/degC/degC", "bias_drift": "g/s"}
UNITS |= {"bias_drift_square": "g/s/s", "second_order": "g/g^2", "third_order": "g/g^3"}


def cause(id):
    polynomial, order = ENTRIES[id].polynomial
    slot = replace(
        NO_SLOT, id=id, names=(id,), units=(UNITS[id.rpartition(".")[0]],), polynomial=polynomial, order=order
    )
    return Cause(EFFECT, id, 0.0, 0.0, slot=slot)


def diagnosis(values, covariance):
    ids = [*values]
    fit = SimpleNamespace(
        names=tuple(ids), values=np.array([*values.values()]), covariance=np.array(covariance),
        sd=np.sqrt(np.diag(covariance)),
    )  # fmt: skip
    return SimpleNamespace(
        extended=fit,
        entries=ENTRIES,
        data=SimpleNamespace(temperature_degc=DEGC),
        problem=SimpleNamespace(where=SimpleNamespace(time_s=TIME_S, clocks=1)),
        determined={id: [SimpleNamespace(weights={id: 1.0})] for id in ids},
        in_use=SimpleNamespace(names=()),
    )


@pytest.mark.parametrize(
    ("values", "unit", "about", "offset"),
    [
        (
            {"bias_temperature.x": 5e-5, "bias_temperature_square.x": 4e-6},
            (1e-3, 1e-3, "mg/degC", "mg/degC/degC"),
            25.0,
            25.0 - DEGC.mean(),
        ),
        (
            {"bias_drift.y": 3e-8, "bias_drift_square.y": -2e-11},
            (1e-3 / 3600, 1e-3 / 3600**2, "mg/h", "mg/h/h"),
            0.0,
            -np.mean(TIME_S - TIME_S[0]),
        ),
    ],
)
def test_coefficients_are_about_one_reference(values, unit, about, offset):
    """`b (v - m)^2` has the slope `2 b (r - m)` at r, and its uncertainty is that of the sum."""
    first, second = values.values()
    sd = np.array([abs(first) / 8, abs(second) / 20])
    covariance = np.diag(sd) @ np.array([[1.0, -0.3], [-0.3, 1.0]]) @ np.diag(sd)
    (low, high), reference = about_one_reference(diagnosis(values, covariance), [cause(id) for id in values])
    weights = np.array([1.0, 2 * offset])
    slope, slope_sd = weights @ [first, second] / unit[0], np.sqrt(weights @ covariance @ weights) / unit[0]
    assert reference == about and (low.unit, high.unit) == unit[2:]
    assert (low.value, low.sd) == pytest.approx((slope, slope_sd))
    assert (high.value, high.sd) == pytest.approx((second / unit[1], sd[1] / unit[1]))
