"""Curves of temperature in every target, by its own formula (tests/device_formulas.py) next to apply."""

import shutil

import numpy as np
import pytest
from test_targets import FORMULAS, TERMS, G, applied, attitudes, exported, run_in_c

from tumblecal.data.calibration import Calibration
from tumblecal.data.sensor_parameters import SENSOR, triad_of
from tumblecal.data.temperature_curves import Curve, Hysteresis, TemperatureCurves, order_of_covariance
from tumblecal.ground.gravity import Gravity
from tumblecal.ground.temperature_functions import TemperatureFunctions


SPAN, T0 = (-10.0, 60.0), 25.0
CUBIC = TemperatureFunctions(3, T0, SPAN)
SPLINE = TemperatureFunctions(3, T0, SPAN, (10.0, 40.0))
LINEAR, SQUARE = TemperatureFunctions(1, T0, SPAN), TemperatureFunctions(2, T0, SPAN)
# g/degC, g/degC^2, g/degC^3: the biases change by some 10 mg over the range.
BIASES = {
    "bias_x": (1.2e-4, -1.5e-6, 2e-8, 1e-7, -2e-7),
    "bias_y": (-8e-5, 1e-6, -3e-8, -2e-7, 4e-7),
    "bias_z": (5e-5, 2e-6, 1e-8, 3e-7, -1e-7),
}
OTHERS = {"dK_x": (SQUARE, [4e-6, 3e-8]), "dK_z": (LINEAR, [-5e-6]), "gamma_31": (LINEAR, [2e-6])}
VALUES = np.array([12e-3, -9e-3, 7e-3, 5e-3, -4e-3, 3e-3, 1e-3, -2e-3, 1.5e-3])
KINDS = ["cubic", "spline"]


def unit(kind: str, *, terms=()) -> Calibration:
    functions = SPLINE if kind == "spline" else CUBIC
    curves = [Curve(name, functions, np.array(c[: functions.count])) for name, c in BIASES.items()]
    curves += [Curve(name, how, np.array(c)) for name, (how, c) in OTHERS.items()]
    order = order_of_covariance(curves)
    covariance = np.diag([1e-10] * 9 + [0.0] * (len(order) - 9))
    return Calibration(
        np.linalg.inv(triad_of(VALUES)), VALUES[3:6], np.eye(12) * 1e-12, gravity=Gravity(G, "stated"),
        temperature=TemperatureCurves(tuple(curves), covariance, order, (Hysteresis("bias_x", 1e-4, "g"),)),
        extra={"terms": list(terms)} if terms else {},
    )  # fmt: skip


def at(kind: str, degc: np.ndarray) -> np.ndarray:
    """The parameters (n, 9), from the coefficients above."""
    values, t = np.tile(VALUES, (len(degc), 1)), degc - T0
    knots = SPLINE.knots_degc if kind == "spline" else ()
    for name, c in BIASES.items():
        change = c[0] * t + c[1] * t**2 + c[2] * t**3
        for factor, knot in zip(c[3:], knots, strict=False):
            change += factor * (np.where(degc > knot, degc - knot, 0.0) ** 3 - max(T0 - knot, 0.0) ** 3)
        values[:, SENSOR.index(name)] += change
    values[:, 0] += 4e-6 * t + 3e-8 * t**2
    values[:, 2] -= 5e-6 * t
    values[:, 7] += 2e-6 * t
    return values


def readings_of(kind: str, force: np.ndarray, degc: np.ndarray) -> np.ndarray:
    values = at(kind, degc)
    return np.einsum("rij,rj->ri", triad_of(values), force) + values[:, 3:6]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", [name for name in FORMULAS if name != "c-header" or shutil.which("cc")])
def test_the_error_of_every_target_is_the_stated_loss(name, kind):
    degc = np.repeat(np.linspace(*SPAN, 141), 150)
    force = attitudes(len(degc))
    readings = readings_of(kind, force, degc)
    text, lost = exported(name, unit(kind), SPAN)
    error = 1e3 * np.max(np.abs(applied(name, text, readings, degc, G) - force))
    total = max((loss.mg for loss in lost if not loss.what.startswith("in addition")), default=0.0)
    assert error <= total * 1.03 + 3e-4 and error >= total * 0.9 - 3e-4, [str(loss) for loss in lost]
    bounds = {"c-header": 0.0, "json": 0.0, "csv": 1.0, "px4": 4.0, "ardupilot": 4.0}
    assert total <= bounds.get(name, 50.0)


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_bias_of_an_autopilot_is_the_least_squares_cubic(name, kind):
    """At zero force the scale factor has no influence: the error is the rest of a fit with equal weight over temperature."""
    degc = np.linspace(*SPAN, 1001)
    bias = at(kind, degc)[:, 3:6]
    fitted = np.array([np.polynomial.Polynomial.fit(degc, column, 3)(degc) for column in bias.T]).T
    text, lost = exported(name, unit(kind), SPAN)
    scale = np.diag(np.linalg.inv(triad_of(VALUES)))
    np.testing.assert_allclose(applied(name, text, bias, degc, G), (bias - fitted) * scale, atol=3e-8)
    rest = 1e3 * np.max(np.abs(bias - fitted))
    above = sum(loss.mg for loss in lost if "above third order" in loss.what)
    assert above == pytest.approx(rest if kind == "spline" else 0.0, rel=0.03, abs=1e-4)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc to compile with")
@pytest.mark.parametrize(("real", "tolerance"), [("float", 5e-7), ("double", 4e-15)])
@pytest.mark.parametrize("form", ["spline", "table", "terms"])
def test_the_header_in_c_agrees_to_rounding_and_keeps_the_ends(tmp_path, real, tolerance, form):
    kind = "spline"
    own = unit(kind, terms=TERMS if form == "terms" else ())
    step = 2.0 if form == "table" else None
    rng = np.random.default_rng(3)
    readings = rng.uniform(-1.4, 1.4, (20_000, 3)).astype(np.float32).astype(float)
    degc = rng.uniform(-20, 70, 20_000).astype(np.float32).astype(float)
    out = run_in_c(tmp_path, exported("c-header", own, SPAN, table_step_degc=step)[0], real, readings, degc)
    if form == "table":
        rows = np.append(np.arange(-10.0, 60.0, 2.0), 60.0)
        values = np.array([np.interp(degc, rows, column) for column in at(kind, rows).T]).T
        expected = np.linalg.solve(triad_of(values), (readings - values[:, 3:6])[:, :, None])[:, :, 0]
    else:
        expected = own.corrected(readings, np.clip(degc, *SPAN))
    clear = np.abs(expected[:, 1]) > 0.01
    np.testing.assert_allclose(out[clear], expected[clear], rtol=0, atol=tolerance)
