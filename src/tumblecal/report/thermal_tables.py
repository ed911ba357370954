"""Tables of a temperature calibration: parameters, coefficients, held-out rows, orders."""

import numpy as np

from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.ground.numbers_shown import changed, rounded
from tumblecal.ground.units import shown
from tumblecal.report.thermal_estimates import known_at_reference, parameters_at, sd_at, varying
from tumblecal.report.thermal_words import order_words, source_words
from tumblecal.show.tables import Table
from tumblecal.thermal.model import LEAVES
from tumblecal.thermal.result import ThermalResult


def reference_table(result: ThermalResult) -> Table:
    """The parameters at the reference temperature."""
    sensor, rows = result.calibration.sensor.of(SENSOR), []
    for name, value, sd in zip(sensor.names, sensor.values.tolist(), sensor.sd.tolist(), strict=True):
        unit, factor = shown(GROUPS[leaf_of(name)][1])
        source = source_words(result, name)
        cells = ["", ""] if source == "not determined" else rounded(value * factor, sd * factor)
        rows.append([name, *cells, unit, source])
    return Table(["parameter", "value", "u", "unit", "source"], rows, text=(0, 3, 4))


def coefficient_table(result: ThermalResult) -> Table:
    """The physical coefficients of all curves with standard uncertainties."""
    rows = []
    if (curves := result.curves) is not None:
        sd = np.sqrt(np.diag(curves.covariance))
        place = len(SENSOR)
        for curve in curves.curves:
            for name, unit, value in zip(curve.coefficient_names, curve.units, curve.coefficients, strict=True):
                base, divisor = unit.split("/", 1)
                display, factor = shown(base)
                rows.append([name, *_scaled(value * factor, sd[place] * factor), f"{display}/{divisor}"])
                place += 1
    return Table(["coefficient", "value", "u", "unit"], rows, text=(0, 3))


def _scaled(value: float, u: float) -> list[str]:
    """A value and its uncertainty with a common power of ten, if they are small."""
    power = int(np.floor(np.log10(max(abs(value), u)))) if max(abs(value), u) > 0 else 0
    if power >= -2:
        return rounded(value, u)
    return [f"{digits}e{power}" for digits in rounded(value / 10.0**power, u / 10.0**power)]


def temperature_table(result: ThermalResult) -> Table:
    """Parameters that follow temperature, with standard uncertainties, at the ends of the range and at the reference."""
    low, high = result.table.range_degc
    degc = np.unique([low, min(max(result.reference_degc, low), high), high])
    values, sd = parameters_at(result, degc), sd_at(result, degc)
    rows = []
    for name in varying(result):
        k, (unit, factor) = SENSOR.index(name), shown(GROUPS[leaf_of(name)][1])
        at_each = zip(values[:, k] * factor, sd[:, k] * factor, strict=True)
        cells = [cell for value, u in at_each for cell in (rounded(value, u) if u > 0 else ["0", ""])]
        words = name if known_at_reference(result, name) else f"change of {name}"
        rows.append([words, unit, *cells])
    return Table(
        ["parameter", "unit", *(cell for each in degc for cell in (f"at {each:.1f} degC", "u"))], rows, text=(0, 1)
    )


def held_out_table(result: ThermalResult) -> Table:
    """Errors on held-out rows, root mean square."""
    rows = []
    for part in result.held_out:
        before, after = changed(part.before_mg, part.after_mg).split(" -> ")
        rows.append([part.label, str(part.rows), before, after, f"{part.noise_mg:.3g}"])
    header = ["held-out rows", "rows", "at the reference / mg", "at the temperature / mg", "noise / mg"]
    return Table(header, rows, text=(0,))


def order_table(result: ThermalResult) -> Table:
    """For each leaf, the orders that were considered and the chosen one."""
    choice, rows = result.choice, []
    for leaf, words in LEAVES.items():
        if leaf in choice.forced and leaf not in choice.highest:
            rows.append([words, "0", order_words(result, leaf), "stated"])
            continue
        if leaf not in choice.highest:
            rows.append([words, "", "", "not separated by these attitudes"])
            continue
        reason = "evidence and prediction"
        if leaf in choice.forced:
            reason = "stated"
        elif leaf in choice.dropped:
            reason = "a higher order does not improve the prediction"
        rows.append([words, f"0 to {choice.highest[leaf]}", order_words(result, leaf), reason])
    return Table(["dependence of", "considered orders", "chosen", "by"], rows, text=(0, 1, 2, 3))
