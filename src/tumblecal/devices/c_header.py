"""A C99 header without dependencies that applies the calibration with its nonlinear and thermal terms."""

import json
from collections.abc import Sequence

import numpy as np

from tumblecal.data.calibration_extended import MOST_STEPS, TOLERANCE, values
from tumblecal.data.calibration_terms import Term, terms_of
from tumblecal.devices.target import Export, Numbers, Target, attitudes, numbers_after
from tumblecal.devices.temperature import temperatures
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# Size of the readings for which the number of fixed-point steps is determined, g.
_FARTHEST_G = 2.0
# Terms are also in a comment, so that the file can be read.
_TERMS = "terms: "
_REAL = "TUMBLECAL_REAL"


def _c_header(export: Export) -> str:
    calibration = export.calibration
    terms = calibration.terms
    thermal = any(term.thermal for term in terms)
    temperature = f"{_REAL} temperature_degc, " if thermal else ""
    return "\n".join(
        [
            "/*",
            *(f" * {line.replace('*/', '* /')}" for line in export.header),
            " *",
            f" * Readings and specific force in g; one g is {export.gravity_ms2!r} m/s^2. No memory, no library, C99.",
            f" * Define {_REAL} as double before the include for double precision.",
            *([f" * {_TERMS}{json.dumps([term.record() for term in terms])}"] if terms else []),
            " */",
            "#ifndef TUMBLECAL_CALIBRATION_H",
            "#define TUMBLECAL_CALIBRATION_H",
            "",
            f"#ifndef {_REAL}",
            f"#define {_REAL} float",
            "#endif",
            "",
            *(_terms_function(terms, temperature) if terms else []),
            f"static inline void tumblecal_apply(const {_REAL} reading[3], {temperature}{_REAL} force[3])",
            "{",
            f"    static const {_REAL} matrix[3][3] = {{",
            *(f"        {{{_constants(row)}}}," for row in calibration.matrix),
            "    };",
            f"    static const {_REAL} bias[3] = {{{_constants(calibration.bias)}}};",
            *(_with_terms(export, thermal) if terms else _WITHOUT_TERMS),
            "}",
            "",
            "#endif",
            "",
        ]
    )


_PRODUCT = "matrix[i][0] * {0}[0] + matrix[i][1] * {0}[1] + matrix[i][2] * {0}[2];"
_WITHOUT_TERMS = [
    f"    {_REAL} unbiased[3];",
    "    int i;",
    "    for (i = 0; i < 3; ++i) unbiased[i] = reading[i] - bias[i];",
    f"    for (i = 0; i < 3; ++i) force[i] = {_PRODUCT.format('unbiased')}",
]


def _with_terms(export: Export, thermal: bool) -> list[str]:
    lower = np.linalg.inv(export.calibration.matrix)
    to_inputs = lower / np.diag(lower)[:, None]
    return [
        f"    static const {_REAL} inputs[3][3] = {{",
        *(f"        {{{_constants(row)}}}," for row in to_inputs),
        "    };",
        f"    {_REAL} unbiased[3], u[3], added[3] = {{0, 0, 0}};",
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
        f"static inline void tumblecal_terms(const {_REAL} u[3], {temperature}{_REAL} added[3])",
        "{",
        *(unused[:1] if len(unused) == 3 else []),
        *(f"    added[{k}] = 0{sums[axis]};" for k, axis in enumerate(AXES)),
        "}",
        "",
    ]


def _term(term: Term) -> str:
    factors = [f"u[{k}]" for k, power in enumerate(term.powers) for _ in range(power)]
    product = " * ".join(factors) or f"({_REAL})1"
    if term.kind == "abs":
        product = f"(({product}) < 0 ? -({product}) : ({product}))"
    elif term.kind == "sign":
        product = f"({_REAL})((({product}) > 0) - (({product}) < 0))"
    thermal = f" * (temperature_degc - {_constants([term.reference_degc])})" * term.degc_power
    return f"{_constants([term.coefficient])} * {product}{thermal}"


def _constants(row: np.ndarray | Sequence[float]) -> str:
    return ", ".join(f"({_REAL}){float(value)!r}" for value in row)


def _steps(export: Export) -> int:
    """Number of steps until the fixed point converges, within the range for which apply has no warning.

    **Raises:** `InputError` if it does not converge.
    """
    calibration = export.calibration
    # A sign does not change the slope; at zero input its iteration does not converge.
    terms = [term for term in calibration.terms if term.kind != "sign"]
    lower = np.linalg.inv(calibration.matrix)
    to_inputs = (lower / np.diag(lower)[:, None]).T
    readings = _FARTHEST_G * attitudes()
    steps = 0
    for degc in temperatures(calibration, export.temperatures_degc)[[0, -1]]:
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
    code = text.replace(f"({_REAL})", "")
    line = next((line for line in text.splitlines() if line.startswith(f" * {_TERMS}")), None)
    try:
        terms = () if line is None else terms_of(json.loads(line.split(_TERMS, 1)[1]))
    except (ValueError, RecursionError) as error:
        raise InputError(f"the comment with the terms cannot be read: {error}") from error
    return Numbers(numbers_after(code, "matrix[3][3]", 9).reshape(3, 3), numbers_after(code, "bias[3]", 3), terms)


TARGETS = (
    Target(
        "c-header",
        ".h",
        "tumblecal_apply(reading, force), float or double",
        _c_header,
        _read,
        frozenset({"cross terms", "bias", "terms"}),
        "docs/files.md",
    ),
)
