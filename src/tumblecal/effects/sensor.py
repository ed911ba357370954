"""Effects of the accelerometers: nonlinearity, asymmetry, cross-coupling (model equation of IEEE 1293)."""

from functools import partial
from itertools import combinations

import jax.numpy as jnp

from tumblecal.effects.added_terms import output_effect
from tumblecal.effects.effect import HIGHER_ORDER, Effect
from tumblecal.ground.axes import AXES


# Every term here is from the model equation, with a size that occurs in good instruments.
_term = partial(output_effect, typical=0.2, source="IEEE 1293, accelerometer model equation")


def _power(axis: int, power: int):
    return lambda u, where: u[axis] ** power


def _form(axis: str, powers: dict[int, int], kind: str = "product") -> dict:
    return {"axis": axis, "powers": [powers.get(number, 0) for number in range(3)], "kind": kind}


def _nonlinearities(number: int, axis: str) -> tuple[Effect, ...]:
    return (
        _term(
            f"second_order.{axis}",
            axis,
            _power(number, 2),
            unit="mg/g^2",
            physics="K2 u^2",
            forms=(_form(axis, {number: 2}),),
            symbol="K2",
            cause=f"Second-order nonlinearity of the {axis} axis: its output has a term in the square of its input.",
            advice="Apply the quadratic term from the extended calibration; check for vibration rectification.",
        ),
        _term(
            f"third_order.{axis}",
            axis,
            _power(number, 3),
            unit="mg/g^3",
            physics="K3 u^3",
            forms=(_form(axis, {number: 3}),),
            symbol="K3",
            cause=f"Third-order nonlinearity of the {axis} axis: its output has a term in the cube of its input.",
            advice="Apply the cubic term from the extended calibration.",
        ),
        _term(
            f"fifth_order.{axis}",
            axis,
            _power(number, 5),
            unit="mg/g^5",
            physics="K5 u^5",
            forms=(_form(axis, {number: 5}),),
            symbol="K5",
            cause=f"Fifth-order nonlinearity of the {axis} axis: its output has a term in the fifth power of its input.",
            advice="Apply the term from the extended calibration; check the range.",
            weight=HIGHER_ORDER,
        ),
    )


def _asymmetries(number: int, axis: str) -> tuple[Effect, ...]:
    return (
        _term(
            f"scale_asymmetry.{axis}",
            axis,
            lambda u, where: jnp.abs(u[number]),
            unit="mg/g",
            physics="K1' abs(u)",
            forms=(_form(axis, {number: 1}, "abs"),),
            symbol="K1'",
            cause=f"The scale factor of the {axis} axis differs between positive and negative input.",
            advice="Apply separate scale factors for the two signs; check the readout electronics.",
        ),
        _term(
            f"bias_asymmetry.{axis}",
            axis,
            lambda u, where: jnp.sign(u[number]),
            unit="mg",
            physics="K0' sgn(u)",
            forms=(_form(axis, {number: 1}, "sign"),),
            symbol="K0'",
            cause=f"The {axis} axis jumps when its input changes sign (dead zone or stiction).",
            advice="Measure a few positions close to zero input; look for a dead zone in the converter.",
            kinked=True,
        ),
    )


def _cross_coupling(number: int, axis: str, first: int, second: int) -> Effect:
    inputs = AXES[first], AXES[second]
    return _term(
        f"cross_coupling.{axis}.{''.join(inputs)}",
        axis,
        lambda u, where: u[first] * u[second],
        unit="mg/g^2",
        physics=f"K u_{inputs[0]} u_{inputs[1]} on output {axis}",
        symbol=_cross_symbol(number, first, second),
        forms=(_form(axis, {first: 1, second: 1}),),
        cause=f"Cross-coupling: output {axis} depends on the product of inputs {' and '.join(inputs)}.",
        advice="Apply the product term from the extended calibration; it is a property of the proof mass's suspension.",
    )


def _cross_symbol(number: int, first: int, second: int) -> str:
    """Kip or Kio if the product includes the input of the axis, otherwise Kpo; p and o follow the input axis cyclically."""
    if number not in (first, second):
        return "Kpo"
    other = second if first == number else first
    return "Kip" if other == (number + 1) % 3 else "Kio"


def _cross_axis_square(number: int, axis: str) -> Effect:
    first, second = (other for other in range(3) if other != number)
    return _term(
        f"cross_axis_square.{axis}",
        axis,
        (_power(first, 2), _power(second, 2)),
        unit="mg/g^2",
        physics=f"Kpp u_{AXES[first]}^2 + Koo u_{AXES[second]}^2 on output {axis}",
        symbol="Kpp, Koo",
        forms=(_form(axis, {first: 2}), _form(axis, {second: 2})),
        components=(2 * AXES[first], 2 * AXES[second]),
        cause=f"Output {axis} depends on the squares of the two other inputs.",
        advice="Apply the square terms from the extended calibration.",
    )


ENTRIES = tuple(
    entry
    for number, axis in enumerate(AXES)
    for entry in (
        *_nonlinearities(number, axis),
        *_asymmetries(number, axis),
        *(_cross_coupling(number, axis, *inputs) for inputs in combinations(range(3), 2)),
        _cross_axis_square(number, axis),
    )
)
