"""A polynomial in one variable is one finding, its coefficients about one reference; from records made by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.diagnosis.causes.cause import EFFECT, NO_SLOT, Cause
from tumblecal.effects import catalogue
from tumblecal.report.diagnosis_verdict import _finding


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
    ("values", "unit", "words", "about", "offset"),
    [
        (
            {"bias_temperature.x": 5e-5, "bias_temperature_square.x": 4e-6},
            (1e-3, 1e-3, "mg/degC", "mg/degC/degC"),
            "The bias of the x axis depends on the temperature",
            "about 25 degC",
            25.0 - DEGC.mean(),
        ),
        (
            {"bias_drift.y": 3e-8, "bias_drift_square.y": -2e-11},
            (1e-3 / 3600, 1e-3 / 3600**2, "mg/h", "mg/h/h"),
            "The bias of the y axis depends on the time",
            "at the first position",
            -np.mean(TIME_S - TIME_S[0]),
        ),
    ],
)
def test_coefficients_are_about_one_reference(values, unit, words, about, offset):
    """`b (v - m)^2` has the slope `2 b (r - m)` at r, and its uncertainty is that of the sum."""
    first, second = values.values()
    sd = np.array([abs(first) / 8, abs(second) / 20])
    covariance = np.diag(sd) @ np.array([[1.0, -0.3], [-0.3, 1.0]]) @ np.diag(sd)
    said = _finding(diagnosis(values, covariance), [cause(id) for id in values])
    weights = np.array([1.0, 2 * offset])
    slope, slope_sd = weights @ [first, second] / unit[0], np.sqrt(weights @ covariance @ weights) / unit[0]
    low, _, high = said.size.removesuffix(f" {about}").partition(" and ")
    for text, value, own_sd, name in (
        (low, slope, slope_sd, unit[2]),
        (high, second / unit[1], sd[1] / unit[1], unit[3]),
    ):
        number, _, rest = text.partition(" +- ")
        assert rest.split() == [rest.split()[0], name]
        assert float(number) == pytest.approx(value, abs=0.06 * own_sd)
        assert float(rest.split()[0]) == pytest.approx(own_sd, rel=0.06)
    assert said.words == words and said.size.endswith(about) and said.id == " + ".join(values)
