"""Effects of the accelerometers: nonlinearity, asymmetry, cross-coupling (model equation of IEEE 1293)."""

from itertools import combinations

import jax.numpy as jnp

from tumblecal.effects.effect import Effect, output_effect
from tumblecal.ground.axes import AXES


_MODEL = "IEEE 1293, accelerometer model equation"


def _power(axis: int, power: int):
    return lambda u, where: u[axis] ** power


def _product(first: int, second: int):
    return lambda u, where: u[first] * u[second]


def _size(axis: int):
    return lambda u, where: jnp.abs(u[axis])


def _sign(axis: int):
    return lambda u, where: jnp.sign(u[axis])


def _form(axis: str, powers: dict[int, int], kind: str = "product") -> dict:
    return {"axis": axis, "powers": [powers.get(place, 0) for place in range(3)], "kind": kind}


def _axis_entries(place: int, axis: str) -> tuple[Effect, ...]:
    others = tuple(other for other in range(3) if other != place)
    return (
        output_effect(
            f"second_order.{axis}",
            axis,
            _power(place, 2),
            unit="mg/g^2",
            typical=0.2,
            physics="K2 u^2",
            forms=(_form(axis, {place: 2}),),
            symbol="K2",
            cause=f"Second-order nonlinearity of the {axis} axis: output bends with the square of its input.",
            advice="Apply the quadratic term from the extended calibration; check for vibration rectification.",
            source=_MODEL,
        ),
        output_effect(
            f"third_order.{axis}",
            axis,
            _power(place, 3),
            unit="mg/g^3",
            typical=0.2,
            physics="K3 u^3",
            forms=(_form(axis, {place: 3}),),
            symbol="K3",
            cause=f"Third-order nonlinearity of the {axis} axis: gain differs between small and large inputs.",
            advice="Apply the cubic term from the extended calibration.",
            source=_MODEL,
        ),
        output_effect(
            f"scale_asymmetry.{axis}",
            axis,
            _size(place),
            unit="mg/g",
            typical=0.2,
            physics="K1' abs(u)",
            forms=(_form(axis, {place: 1}, "abs"),),
            symbol="K1'",
            cause=f"The {axis} axis has another scale factor for positive than for negative input.",
            advice="Apply separate scale factors for the two signs; look at the readout electronics.",
            source=_MODEL,
        ),
        output_effect(
            f"bias_asymmetry.{axis}",
            axis,
            _sign(place),
            unit="mg",
            typical=0.2,
            physics="K0' sgn(u)",
            forms=(_form(axis, {place: 1}, "sign"),),
            symbol="K0'",
            cause=f"The {axis} axis jumps when its input changes sign (dead zone or stiction).",
            advice="Measure a few positions close to zero input; look for a dead zone in the converter.",
            source=_MODEL,
            kinked=True,
        ),
        *(
            output_effect(
                f"cross_coupling.{axis}.{AXES[first]}{AXES[second]}",
                axis,
                _product(first, second),
                unit="mg/g^2",
                typical=0.2,
                physics=f"K u_{AXES[first]} u_{AXES[second]} on output {axis}",
                symbol=_cross_symbol(place, first, second),
                forms=(_form(axis, {first: 1, second: 1}),),
                cause=f"Cross-coupling: output {axis} depends on the product of inputs {AXES[first]} and {AXES[second]}.",
                advice="Apply the product term from the extended calibration; it is a property of the proof mass's suspension.",
                source=_MODEL,
            )
            for first, second in combinations(range(3), 2)
        ),
        output_effect(
            f"cross_axis_square.{axis}",
            axis,
            tuple(_power(other, 2) for other in others),
            unit="mg/g^2",
            typical=0.2,
            physics=f"Kpp u_{AXES[others[0]]}^2 + Koo u_{AXES[others[1]]}^2 on output {axis}",
            symbol="Kpp, Koo",
            forms=tuple(_form(axis, {other: 2}) for other in others),
            components=tuple(AXES[other] + AXES[other] for other in others),
            cause=f"Output {axis} depends on the squares of the two other inputs.",
            advice="Apply the square terms from the extended calibration.",
            source=_MODEL,
        ),
    )


def _cross_symbol(place: int, first: int, second: int) -> str:
    """Kip or Kio when the axis's own input takes part, Kpo when not; p and o follow the input axis cyclically."""
    if place not in (first, second):
        return "Kpo"
    other = second if first == place else first
    return "Kip" if other == (place + 1) % 3 else "Kio"


ENTRIES = tuple(entry for place, axis in enumerate(AXES) for entry in _axis_entries(place, axis))
