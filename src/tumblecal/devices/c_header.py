"""A C99 header without dependencies that applies the calibration with its curves of temperature and its terms.

The curves are polynomials by Horner's scheme, or a table. A spline is written as a polynomial for each interval between knots,
about the middle of the interval: in single precision these powers are as exact as the readings.
"""

import json
import re
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial

from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_extended import MOST_STEPS, TOLERANCE, values
from tumblecal.data.calibration_terms import Term
from tumblecal.data.sensor_parameters import SENSOR, triad_of
from tumblecal.devices.format_losses import attitudes
from tumblecal.devices.over_temperature import in_table, temperatures
from tumblecal.devices.own_formats import device_record, read_device_file
from tumblecal.devices.target import LINEAR, TEMPERATURE, Export, Target
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


_REAL = "TUMBLECAL_REAL"
# Size of the readings for which the number of fixed-point steps is determined, g.
_FARTHEST_G = 2.0
# The numbers are also in a comment, so that the file can be read.
_STATED = "calibration"


def _write(export: Export) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    calibration = export.calibration
    terms, curves, sensor = calibration.terms, calibration.temperature, calibration.sensor.of(SENSOR).values
    of_terms = f"{_REAL} temperature_degc, " if any(term.thermal for term in terms) else ""
    content = {
        "header": export.header,
        "gravity_ms2": export.gravity_ms2,
        "names": SENSOR,
        "matrix": calibration.matrix,
        "bias": calibration.bias,
        "rotation": calibration.matrix @ triad_of(sensor),
        "scale": np.diag(np.linalg.inv(calibration.matrix)),
        "sums": ["".join(f" + {_term(t)}" for t in terms if t.axis == axis) for axis in AXES] if terms else [],
        "inputs_unused": not any(any(term.powers) for term in terms),
        "steps": _steps(export) if terms else 1,
        "of_terms": of_terms,
        "of_apply": f"{_REAL} temperature_degc, " if of_terms or curves else "",
        "curves": curves,
        "stated": f"{_STATED}: {json.dumps(device_record(_on_device(calibration, export)[0]))}",
    }
    if curves is not None:
        degc, span = export.table_degc, export.temperatures_degc or curves.range_degc
        middles, ends, powers = pieces(calibration, span)
        content |= {"span": span, "middles": middles, "ends": ends, "powers": powers, "degc": degc}
        content["rows"] = (sensor + curves.at(degc)).tolist()
    loader = PackageLoader("tumblecal.devices")
    environment = Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True)
    environment.filters["c"] = _constants
    return environment.get_template("calibration.h.j2").render(content)


def _constants(numbers: float | Iterable) -> str:
    """A number, or nested numbers, as constants of C with all digits."""
    if isinstance(numbers, Iterable):
        return f"{{{', '.join(map(_constants, numbers))}}}"
    return f"({_REAL}){float(numbers)!r}"


def _term(term: Term) -> str:
    factors = [f"u[{k}]" for k, power in enumerate(term.powers) for _ in range(power)]
    product = " * ".join(factors) or f"({_REAL})1"
    if term.kind == "abs":
        product = f"(({product}) < 0 ? -({product}) : ({product}))"
    elif term.kind == "sign":
        product = f"({_REAL})((({product}) > 0) - (({product}) < 0))"
    thermal = f" * (temperature_degc - {_constants(term.reference_degc)})" * term.degc_power
    return f"{_constants(term.coefficient)} * {product}{thermal}"


def _steps(export: Export) -> int:
    """Number of steps until the fixed point converges, within the range for which apply has no warning.

    **Raises:** `InputError` if it does not converge.
    """
    # A sign does not change the slope; at zero input its iteration does not converge.
    terms = [term for term in export.calibration.terms if term.kind != "sign"]
    readings, most = _FARTHEST_G * attitudes(), 0
    for degc in temperatures(export.calibration, export.temperatures_degc)[[0, -1]].tolist():
        calibration = export.calibration.at(degc, extrapolate=True)
        forward = np.linalg.inv(calibration.matrix)
        force, better, step = np.full_like(readings, np.inf), calibration.linear(readings), 0
        while np.max(np.abs(better - force)) > TOLERANCE:
            force, step = better, step + 1
            if step == MOST_STEPS:
                raise InputError(
                    "the terms of this calibration are too large for the fixed-point iteration of the C header; export to "
                    "json"
                )
            added = values(terms, force @ (forward / np.diag(forward)[:, None]).T, degc)
            better = calibration.linear(readings - added)
        most = max(most, step)
    return most + 3  # other temperatures may need more steps


def pieces(
    calibration: Calibration, span: tuple[float, float]
) -> tuple[Float[np.ndarray, " pieces"], Float[np.ndarray, " pieces"], Float[np.ndarray, "pieces 9 powers"]]:
    """Middle and upper end of each interval between the knots of all curves (degC), and the parameters there by powers of
    the temperature minus the middle."""
    curves = calibration.temperature.curves if calibration.temperature else ()
    knots = {knot for curve in curves for knot in curve.knots_degc if span[0] < knot < span[1]}
    edges = np.array([span[0], *sorted(knots), span[1]])
    middles, widths = (edges[:-1] + edges[1:]) / 2, np.diff(edges)
    powers = np.zeros((len(middles), len(SENSOR), 1 + max([1, *(curve.order for curve in curves)])))
    powers[:, :, 0] = calibration.sensor.of(SENSOR).values
    for piece, (middle, width) in enumerate(zip(middles, widths, strict=True)):
        for curve in curves:
            # Without a knot inside, as many points as coefficients determine the polynomial.
            steps = np.linspace(-width, width, curve.order + 1) / 2
            changes = curve.coefficients @ curve.functions.values(middle + steps)
            coefficients = np.asarray(Polynomial.fit(steps, changes, curve.order).convert().coef, float)
            powers[piece, SENSOR.index(curve.parameter), : len(coefficients)] += coefficients
    return middles, edges[1:], powers


def _on_device(calibration: Calibration, export: Export) -> tuple[Calibration, str]:
    """The calibration that a table of the header applies."""
    rows = export.table_degc if calibration.temperature is not None else np.zeros(0)
    return in_table(calibration, rows), f"{TEMPERATURE} (linear interpolation between {len(rows)} rows)"


def _read(text: str, gravity_ms2: float) -> Calibration:
    line = re.search(rf"^ \* {_STATED}: (.*)$", text, re.MULTILINE)
    if line is None:
        raise InputError(f"the comment `{_STATED}:` with its numbers is missing; export the calibration again")
    return read_device_file(line[1])


TARGETS = (
    Target(
        "c-header",
        "tumblecal_apply(reading, force), float or double",
        _write,
        _read,
        LINEAR | {"terms", "curves"},
        "docs/files.md",
        (),
        _on_device,
    ),
)
