"""Curves of temperature as C: the sensor parameters by Horner's scheme, or by linear interpolation of a table.

A spline is written as a polynomial for each interval between knots, about the middle of the interval. In single precision these
powers are as exact as the readings, which the truncated powers of `TemperatureFunctions` are not.
"""

import json
import re
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.polynomial.polynomial import polyadd, polypow

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import Term
from tumblecal.data.sensor_parameters import SENSOR, triad_of
from tumblecal.data.temperature_curves import Curve
from tumblecal.data.temperature_curves_file import StatedTemperature
from tumblecal.devices.target import TEMPERATURE, Export, Numbers, inverse, numbers_after
from tumblecal.devices.temperature_table import in_table, linear_curves
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_json import validated


REAL = "TUMBLECAL_REAL"
# The curves are also in a comment, so that the file can be read.
CURVES = "curves: "
# A smaller rotation of the frame is due to rounding.
_SAME = 1e-12


def constants(row: np.ndarray | list[float]) -> str:
    """Numbers as constants of C, with all digits."""
    return ", ".join(f"({REAL}){float(value)!r}" for value in row)


def curves_comment(export: Export) -> list[str]:
    """The comment with matrix, bias and curves; none for a table, which is read itself."""
    calibration, curves = export.calibration, export.calibration.temperature
    if curves is None or len(export.table_degc):
        return []
    content = StatedTemperature.of(curves).model_dump(exclude_unset=True, exclude={"covariance"})
    record = {"matrix": calibration.matrix.tolist(), "bias": calibration.bias.tolist(), "temperature": content}
    return [f" * {CURVES}{json.dumps(record)}"]


def parameter_functions(export: Export) -> list[str]:
    """The C functions `tumblecal_in_range` and `tumblecal_parameters`."""
    curves = export.calibration.temperature
    assert curves is not None
    low, high = export.temperatures_degc or curves.range_degc
    return [
        "/* Whether a temperature is in the range of the calibration; outside, the parameters are those at the nearest end. */",
        f"static inline int tumblecal_in_range({REAL} temperature_degc)",
        "{",
        f"    return temperature_degc >= {constants([low])} && temperature_degc <= {constants([high])};",
        "}",
        "",
        f"/* {', '.join(SENSOR)}: biases in g, the others without unit. */",
        f"static inline void tumblecal_parameters({REAL} temperature_degc, {REAL} p[9])",
        "{",
        *(_interpolated(export) if len(export.table_degc) else _horner(export, (low, high))),
        "}",
        "",
    ]


def _horner(export: Export, span: tuple[float, float]) -> list[str]:
    middles, ends, powers = pieces(export.calibration, span)
    count, _, terms = powers.shape
    return [
        f"    static const {REAL} middle[{count}] = {{{constants(middles)}}};",
        *([f"    static const {REAL} end[{count}] = {{{constants(ends)}}};"] if count > 1 else []),
        f"    static const {REAL} power[{count}][9][{terms}] = {{",
        *(f"        {{{', '.join(f'{{{constants(row)}}}' for row in piece)}}}," for piece in powers),
        "    };",
        f"    {REAL} t;",
        "    int i, k, piece = 0;",
        *([f"    while (piece < {count - 1} && temperature_degc > end[piece]) ++piece;"] if count > 1 else []),
        "    t = temperature_degc - middle[piece];",
        "    for (i = 0; i < 9; ++i) {",
        f"        p[i] = power[piece][i][{terms - 1}];",
        f"        for (k = {terms - 2}; k >= 0; --k) p[i] = p[i] * t + power[piece][i][k];",
        "    }",
    ]


def _interpolated(export: Export) -> list[str]:
    degc, calibration = export.table_degc, export.calibration
    assert calibration.temperature is not None
    values = calibration.sensor.of(SENSOR).values + calibration.temperature.at(degc)
    return [
        f"    static const {REAL} degc[{len(degc)}] = {{{constants(degc)}}};",
        f"    static const {REAL} table[{len(degc)}][9] = {{",
        *(f"        {{{constants(row)}}}," for row in values),
        "    };",
        f"    {REAL} share;",
        "    int i, row = 0;",
        f"    while (row < {len(degc) - 2} && temperature_degc > degc[row + 1]) ++row;",
        "    share = (temperature_degc - degc[row]) / (degc[row + 1] - degc[row]);",
        "    for (i = 0; i < 9; ++i) p[i] = table[row][i] + share * (table[row + 1][i] - table[row][i]);",
    ]


def apply_with_curves(export: Export, steps: int) -> list[str]:
    """The lines of `tumblecal_apply`: the input along each axis, then the exact solution of the triangular equations."""
    calibration, curves = export.calibration, export.calibration.temperature
    assert curves is not None
    low, high = (constants([end]) for end in export.temperatures_degc or curves.range_degc)
    terms, thermal = calibration.terms, any(term.thermal for term in calibration.terms)
    rotation = calibration.matrix @ triad_of(calibration.sensor.of(SENSOR).values)
    turned = bool(np.max(np.abs(rotation - np.eye(3))) > _SAME)
    out = "f" if turned else "force"
    solve = "u[i] = (reading[i] - {0}p[3 + i]) / (1 + p[i]);"
    inputs = f"    for (i = 0; i < 3; ++i) {solve.format('')}"
    loop = [
        f"    for (step = 0; step < {steps}; ++step) {{",
        f"        for (i = 0; i < 3; ++i) {solve.format('added[i] - ')}",
        f"        tumblecal_terms(u, {'temperature_degc, ' if thermal else ''}added);",
        "    }",
    ]
    return [
        f"    {REAL} p[9], u[3]{', added[3] = {0, 0, 0}' if terms else ''}{', f[3]' if turned else ''};",
        *([f"    static const {REAL} rotation[3][3] = {{"] if turned else []),
        *([f"        {{{constants(row)}}}," for row in rotation] + ["    };"] if turned else []),
        f"    int i{', step' if terms else ''};",
        f"    if (temperature_degc < {low}) temperature_degc = {low};",
        f"    if (temperature_degc > {high}) temperature_degc = {high};",
        "    tumblecal_parameters(temperature_degc, p);",
        *(loop if terms else [inputs]),
        f"    {out}[0] = u[0];",
        f"    {out}[1] = u[1] - p[6] * {out}[0];",
        f"    {out}[2] = u[2] - p[7] * {out}[0] - p[8] * {out}[1];",
        *(
            [
                "    for (i = 0; i < 3; ++i) force[i] = rotation[i][0] * f[0] + rotation[i][1] * f[1] + rotation[i][2] * f[2];"
            ]
            if turned
            else []
        ),
    ]


def pieces(
    calibration: Calibration, span: tuple[float, float]
) -> tuple[Float[np.ndarray, " pieces"], Float[np.ndarray, " pieces"], Float[np.ndarray, "pieces 9 powers"]]:
    """Middle and upper end of each interval between the knots of all curves (degC), and the parameters there by powers of
    the temperature minus the middle."""
    curves = calibration.temperature
    assert curves is not None
    knots = {knot for curve in curves.curves for knot in curve.functions.knots_degc if span[0] < knot < span[1]}
    edges = np.array([span[0], *sorted(knots), span[1]])
    middles, reference = (edges[:-1] + edges[1:]) / 2, calibration.sensor.of(SENSOR).values
    order = max(curve.functions.order for curve in curves.curves)
    powers = np.zeros((len(middles), len(SENSOR), max(order, 1) + 1))
    powers[:, :, 0] = reference
    for piece, middle in enumerate(middles.tolist()):
        for curve in curves.curves:
            expanded = _about(curve, middle)
            powers[piece, SENSOR.index(curve.parameter), : len(expanded)] += expanded
    return middles, edges[1:], powers


def _about(curve: Curve, middle: float) -> np.ndarray:
    """A curve by powers of the temperature minus the middle of an interval without knots."""
    functions = curve.functions
    expanded = np.zeros(1)
    of_powers = zip(curve.coefficients[: functions.order], range(1, functions.order + 1), strict=True)
    for coefficient, power in of_powers:
        expanded = polyadd(expanded, coefficient * polypow([middle - functions.reference_degc, 1.0], power))
    for coefficient, knot in zip(curve.coefficients[functions.order :], functions.knots_degc, strict=True):
        constant = -(max(functions.reference_degc - knot, 0.0) ** functions.order)
        above = polypow([middle - knot, 1.0], functions.order) if middle > knot else np.zeros(1)
        expanded = polyadd(expanded, coefficient * polyadd(above, [constant]))
    return expanded


def interpolated_on_device(calibration: Calibration, export: Export) -> tuple[Calibration, str]:
    """The calibration that a table of the header applies."""
    rows = export.table_degc if calibration.temperature is not None else np.zeros(0)
    return in_table(calibration, rows), f"{TEMPERATURE} (linear interpolation between {len(rows)} rows)"


def numbers_with_curves(text: str, code: str, terms: tuple[Term, ...]) -> Numbers | None:
    """Matrix, bias and curves of a header; None for a header without curves.

    **Raises:** `InputError` for a table or a comment that cannot be read.
    """
    if table := re.search(r"\btable\[(\d{1,4})\]\[9\]", code):
        count = int(table[1])
        values = numbers_after(code, table[0], 9 * count).reshape(count, 9)
        at_reference, curves = linear_curves(numbers_after(code, f"degc[{count}]", count), values)
        return Numbers(inverse(triad_of(at_reference), "diag(1 + dK) T"), at_reference[3:6], terms, curves)
    line = next((line for line in text.splitlines() if line.startswith(f" * {CURVES}")), None)
    if line is None:
        return None
    try:
        record: Any = json.loads(line.split(CURVES, 1)[1])
        count = len(record["temperature"]["covariance_order"])
        stated = record["temperature"] | {"covariance": np.zeros((count, count)).tolist()}
        matrix, bias = np.array(record["matrix"], float), np.array(record["bias"], float)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(f"the comment with the curves cannot be read: {error}") from error
    if matrix.shape != (3, 3) or bias.shape != (3,):
        raise InputError("the comment with the curves cannot be read: matrix and bias must have 3 rows")
    curves = validated(stated, StatedTemperature, "", "temperature").curves_of_temperature()
    return Numbers(matrix, bias, terms, curves)
