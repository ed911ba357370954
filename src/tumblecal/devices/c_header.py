"""A C99 header without dependencies that applies the calibration with its curves of temperature and its terms."""

import json
from collections.abc import Sequence

import numpy as np

from tumblecal.data.calibration_extended import MOST_STEPS, TOLERANCE, values
from tumblecal.data.calibration_terms import Term, terms_of
from tumblecal.devices.c_header_curves import (
    REAL,
    apply_with_curves,
    constants,
    curves_comment,
    interpolated_on_device,
    numbers_with_curves,
    parameter_functions,
)
from tumblecal.devices.format_losses import attitudes
from tumblecal.devices.target import Export, Numbers, Target, numbers_after
from tumblecal.devices.temperature import temperatures
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Size of the readings for which the number of fixed-point steps is determined, g.
_FARTHEST_G = 2.0
# Terms are also in a comment, so that the file can be read.
_TERMS = "terms: "


def _c_header(export: Export) -> str:
    calibration = export.calibration
    terms = calibration.terms
    thermal = any(term.thermal for term in terms)
    curves = calibration.temperature
    in_terms = f"{REAL} temperature_degc, " if thermal else ""
    temperature = f"{REAL} temperature_degc, " if thermal or curves else ""
    return "\n".join(
        [
            "/*",
            *(f" * {line.replace('*/', '* /')}" for line in export.header),
            " *",
            f" * Readings and specific force in g; one g is {export.gravity_ms2!r} m/s^2. No memory, no library, C99.",
            f" * Define {REAL} as double before the include for double precision.",
            *([f" * {_TERMS}{json.dumps([term.record() for term in terms])}"] if terms else []),
            *curves_comment(export),
            " */",
            "#ifndef TUMBLECAL_CALIBRATION_H",
            "#define TUMBLECAL_CALIBRATION_H",
            "",
            f"#ifndef {REAL}",
            f"#define {REAL} float",
            "#endif",
            "",
            *(_terms_function(terms, in_terms) if terms else []),
            *(parameter_functions(export) if curves else []),
            f"static inline void tumblecal_apply(const {REAL} reading[3], {temperature}{REAL} force[3])",
            "{",
            *(
                apply_with_curves(export, _steps(export) if terms else 1)
                if curves
                else _constant_triad(export, thermal)
            ),
            "}",
            "",
            "#endif",
            "",
        ]
    )


def _constant_triad(export: Export, thermal: bool) -> list[str]:
    calibration = export.calibration
    return [
        f"    static const {REAL} matrix[3][3] = {{",
        *(f"        {{{constants(row)}}}," for row in calibration.matrix),
        "    };",
        f"    static const {REAL} bias[3] = {{{constants(calibration.bias)}}};",
        *(_with_terms(export, thermal) if calibration.terms else _WITHOUT_TERMS),
    ]


_PRODUCT = "matrix[i][0] * {0}[0] + matrix[i][1] * {0}[1] + matrix[i][2] * {0}[2];"
_WITHOUT_TERMS = [
    f"    {REAL} unbiased[3];",
    "    int i;",
    "    for (i = 0; i < 3; ++i) unbiased[i] = reading[i] - bias[i];",
    f"    for (i = 0; i < 3; ++i) force[i] = {_PRODUCT.format('unbiased')}",
]


def _with_terms(export: Export, thermal: bool) -> list[str]:
    lower = np.linalg.inv(export.calibration.matrix)
    to_inputs = lower / np.diag(lower)[:, None]
    return [
        f"    static const {REAL} inputs[3][3] = {{",
        *(f"        {{{constants(row)}}}," for row in to_inputs),
        "    };",
        f"    {REAL} unbiased[3], u[3], added[3] = {{0, 0, 0}};",
        "    int i, step;",
        f"    for (step = 0; step < {_steps(export)}; ++step) {{",
        "        for (i = 0; i < 3; ++i) unbiased[i] = reading[i] - added[i] - bias[i];",
        f"        for (i = 0; i < 3; ++i) force[i] = {_PRODUCT.format('unbiased')}",
        "        for (i = 0; i < 3; ++i) u[i] = inputs[i][0] * force[0] + inputs[i][1] * force[1] + inputs[i][2] * force[2];",
        f"        tumblecal_terms(u, {'temperature_degc, ' if thermal else ''}added);",
        "    }",
    ]


def _terms_function(terms: Sequence[Term], temperature: str) -> list[str]:
    sums = {axis: "".join(f" + {_term(term)}" for term in terms if term.axis == axis) for axis in AXES}
    unused = [f"    (void)u[{k}];" for k in range(3) if not any(term.powers[k] for term in terms)]
    return [
        f"static inline void tumblecal_terms(const {REAL} u[3], {temperature}{REAL} added[3])",
        "{",
        *(unused[:1] if len(unused) == 3 else []),
        *(f"    added[{k}] = 0{sums[axis]};" for k, axis in enumerate(AXES)),
        "}",
        "",
    ]


def _term(term: Term) -> str:
    factors = [f"u[{k}]" for k, power in enumerate(term.powers) for _ in range(power)]
    product = " * ".join(factors) or f"({REAL})1"
    if term.kind == "abs":
        product = f"(({product}) < 0 ? -({product}) : ({product}))"
    elif term.kind == "sign":
        product = f"({REAL})((({product}) > 0) - (({product}) < 0))"
    thermal = f" * (temperature_degc - {constants([term.reference_degc])})" * term.degc_power
    return f"{constants([term.coefficient])} * {product}{thermal}"


def _steps(export: Export) -> int:
    """Number of steps until the fixed point converges, within the range for which apply has no warning.

    **Raises:** `InputError` if it does not converge.
    """
    # A sign does not change the slope; at zero input its iteration does not converge.
    terms = [term for term in export.calibration.terms if term.kind != "sign"]
    readings = _FARTHEST_G * attitudes()
    steps = 0
    for degc in temperatures(export.calibration, export.temperatures_degc)[[0, -1]].tolist():
        calibration = export.calibration.at(degc, extrapolate=True)
        lower = np.linalg.inv(calibration.matrix)
        to_inputs = (lower / np.diag(lower)[:, None]).T
        force = calibration.linear(readings)
        for step in range(1, MOST_STEPS):
            better = calibration.linear(readings - values(terms, force @ to_inputs, degc))
            if np.max(np.abs(better - force)) <= TOLERANCE:
                steps = max(steps, step)
                break
            force = better
        else:
            raise InputError(
                "the terms of this calibration are too large for the fixed-point iteration of the C header; export to json"
            )
    return steps + 3  # other temperatures may need more steps


def _read(text: str, gravity_ms2: float) -> Numbers:
    code = text.replace(f"({REAL})", "")
    line = next((line for line in text.splitlines() if line.startswith(f" * {_TERMS}")), None)
    try:
        terms = () if line is None else terms_of(json.loads(line.split(_TERMS, 1)[1]))
    except (ValueError, RecursionError) as error:
        raise InputError(f"the comment with the terms cannot be read: {error}") from error
    if (numbers := numbers_with_curves(text, code, terms)) is not None:
        return numbers
    return Numbers(numbers_after(code, "matrix[3][3]", 9).reshape(3, 3), numbers_after(code, "bias[3]", 3), terms)


TARGETS = (
    Target(
        "c-header",
        ".h",
        "tumblecal_apply(reading, force), float or double",
        _c_header,
        _read,
        frozenset({"cross terms", "bias", "terms", "curves"}),
        "docs/files.md",
        (),
        interpolated_on_device,
    ),
)
