"""The result of a temperature calibration in words: verdict first, then parameters, signals, improvement and limits."""

from collections.abc import Iterator

import numpy as np

from tumblecal.data.sensor_parameters import SENSOR, leaf_of
from tumblecal.ground.counted import counted
from tumblecal.ground.units import shown
from tumblecal.report.tables import Table
from tumblecal.thermal.model import LEAVES
from tumblecal.thermal.result import FoundSignal, ThermalResult
from tumblecal.thermal.signals import WORDS


_ORDERS = ("constant", "linear", "quadratic", "cubic", "of fourth order", "of fifth order")


def thermal_lines(result: ThermalResult) -> Iterator[str]:
    """The findings, one line each, the most important first."""
    low, high = result.table.range_degc
    yield f"Temperature: {low:.1f} to {high:.1f} degC; reference {result.reference_degc:.4g} degC"
    yield f"Use: {result.calibration.use.words}"
    yield from _improvement(result)
    yield from _orders(result)
    for signal in result.signals:
        yield _signal(signal)
    yield from combination_lines(result)
    if result.noise_factor > 1.2:
        yield (
            f"The residuals are {result.noise_factor:.2g} times the standard uncertainties of the bins; all uncertainties are "
            "multiplied by this factor"
        )


def _improvement(result: ThermalResult) -> Iterator[str]:
    for part in result.held_out:
        yield (
            f"Held-out rows ({part.label}, {counted(part.rows, 'row')}): errors {part.before_mg:.3g} mg without "
            f"temperature terms, {part.after_mg:.3g} mg with them; noise {part.noise_mg:.3g} mg"
        )
    if not result.held_out:
        yield "No part of the data could be left out, so the improvement on other data is not known"


def _orders(result: ThermalResult) -> Iterator[str]:
    orders, highest = result.choice.orders, result.choice.highest
    followed = [f"{words} {order_words(result, leaf)}" for leaf, words in LEAVES.items() if orders.get(leaf)]
    constant = [LEAVES[leaf] for leaf in highest if not orders.get(leaf)]
    yield f"Dependence on temperature: {', '.join(followed) or 'none found'}"
    if constant:
        yield f"No dependence found: {', '.join(constant)}"
    if result.choice.dropped:
        names = ", ".join(LEAVES[leaf] for leaf in result.choice.dropped)
        yield f"A higher order of {names} was dropped, because it does not improve the prediction of rows outside the fit"
    lowest = min(highest.values(), default=0)
    if 0 < lowest < 3:
        yield f"{counted(lowest + 1, 'temperature')} cannot determine an order above {lowest}"


def order_words(result: ThermalResult, leaf: str) -> str:
    """The order of a leaf: `cubic`, or `by a cubic spline with 2 knots`."""
    functions = result.choice.model.functions[leaf]
    if functions.knots_degc:
        return f"by a cubic spline with {counted(len(functions.knots_degc), 'knot')}"
    return _ORDERS[functions.order]


def _signal(signal: FoundSignal) -> str:
    sizes = ", ".join(f"{axis} {1e3 * size:.3g}" for axis, size in zip("xyz", signal.half_width, strict=True))
    words = f"{signal.name}: {WORDS[signal.name]}; largest size {sizes} mg. No correction includes it"
    if signal.name == "lag":
        words += f"; delay {signal.coefficients[0]:.3g} s (standard uncertainty {signal.sd[0]:.2g} s)"
    if signal.not_separated:
        words += f". These data cannot separate it from {' or '.join(signal.not_separated)}"
        words += ": repeat the ramp at a different rate, or with soaks"
    return words


def combination_lines(result: ThermalResult) -> Iterator[str]:
    """Combinations that the attitudes do not separate."""
    missing = [LEAVES[leaf] for leaf in LEAVES if leaf not in result.choice.highest]
    if missing and result.choice.model.free != ("dK", "bias", "gamma"):
        count = counted(len(result.table.attitudes), "attitude")
        yield f"{count} cannot separate the change of the {', '.join(missing)} from that of the bias"
    if result.combinations:
        yield f"The curves of the biases are those of the combinations {'; '.join(result.combinations)}"


def coefficient_table(result: ThermalResult) -> Table:
    """The physical coefficients of all curves with standard uncertainties."""
    curves = result.curves
    rows = []
    if curves is not None:
        sd = np.sqrt(np.diag(curves.covariance))
        place = len(SENSOR)
        for curve in curves.curves:
            for name, unit, value in zip(curve.coefficient_names, curve.units, curve.coefficients, strict=True):
                display, factor = _display(unit)
                rows.append([name, f"{value * factor:.5g}", f"{sd[place] * factor:.2g}", display])
                place += 1
    return Table(("coefficient", "value", "standard uncertainty", "unit"), rows)


def _display(unit: str) -> tuple[str, float]:
    base, divisor = unit.split("/", 1)
    display, factor = shown(base)
    return f"{display}/{divisor}", factor


def reference_table(result: ThermalResult) -> Table:
    """The parameters at the reference temperature."""
    sensor = result.calibration.sensor.of(SENSOR)
    rows = []
    for name, value, sd in zip(sensor.names, sensor.values.tolist(), sensor.sd.tolist(), strict=True):
        unit, factor = shown({"dK": "1", "bias": "g", "gamma": "rad"}[leaf_of(name)])
        rows.append([name, f"{value * factor:.5g}", f"{sd * factor:.2g}" if sd else "not determined", unit])
    return Table(("parameter", "value", "standard uncertainty", "unit"), rows)
