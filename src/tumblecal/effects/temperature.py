"""Effects of temperature over a wide range: parameters that follow it by a polynomial, and hysteresis of the bias."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.effects.added_terms import output_effect
from tumblecal.effects.effect import HIGHER_ORDER, OF_BRANCH, RARE, Effect
from tumblecal.effects.environment import REFERENCE_DEGC, warmer
from tumblecal.ground.axes import AXES
from tumblecal.ground.soaks import ONE_TEMPERATURE_DEGC


# Typical size of the first power, g/degC or 1/degC, and the change of temperature (degC) at which every power is as large.
_TYPICAL, _SPAN_DEGC = 1e-4, 30.0
# Changes of the temperature up to this share of its range, and up to 1 degC, reverse no direction: a chamber varies so much
# within a soak.
_TURN_OVER_SHARE, _TURN_OVER_DEGC = 0.1, 2 * ONE_TEMPERATURE_DEGC
# Prior weight of an entry that is the same as two others together.
_SAME_AS_PAIR = 0.05
_ORDERS = {2: "quadratic", 3: "cubic", 4: "quartic", 5: "quintic"}
_ORDINALS = {2: "second", 3: "third", 4: "fourth", 5: "fifth"}


class TemperaturePolynomial(Link):
    """`A_axis += factor * sum of c_k (T - 25 degC)^k`; the factor is the input of the axis (a scale factor) or 1 (a bias)."""

    place: ClassVar[Place] = Place.READING
    sizes: tuple[Parameter, ...]
    axis: int = eqx.field(static=True)
    of_scale: bool = eqx.field(static=True)

    def __call__(self, state: State, where: Where) -> State:
        warm, added = warmer(where), jnp.zeros_like(state.reading[self.axis])
        for size in reversed(self.sizes):
            added = (added + size.at(where)[0]) * warm
        added = added * state.f[self.axis] if self.of_scale else added
        reading = tuple(value + added if k == self.axis else value for k, value in enumerate(state.reading))
        return eqx.tree_at(lambda s: s.reading, state, reading)


def reached_from(where: Where) -> Array:
    """The direction in which the temperature of each position was reached, 1 upwards and -1 downwards.

    It is that of the last change of more than a tenth of the range (and 1 degC) from a turning point, by the time of one clock;
    0 before the first change. It is 0 everywhere if the temperature did not change in both directions: no reading then shows a
    hysteresis.
    """
    degc, time = jnp.asarray(where.temperature_degc), jnp.asarray(where.time_s)
    clock = jnp.asarray(where.index("clock")) if where.clocks > 1 else jnp.zeros(len(time), int)
    order = jnp.lexsort((time, clock))
    turn_over = jnp.maximum(_TURN_OVER_SHARE * (jnp.max(degc) - jnp.min(degc)), _TURN_OVER_DEGC)

    def step(before, now):
        direction, low, high, last = before
        value, own = now
        same = own == last
        direction = jnp.where(same, direction, 0)
        low, high = jnp.where(same, jnp.minimum(low, value), value), jnp.where(same, jnp.maximum(high, value), value)
        up = (direction != 1) & (value - low > turn_over)
        down = (direction != -1) & (high - value > turn_over)
        direction = jnp.where(up, 1, jnp.where(down, -1, direction))
        turned = up | down
        low, high = jnp.where(turned, value, low), jnp.where(turned, value, high)
        return (direction, low, high, own), direction

    first = degc[order[0]]
    start = (jnp.zeros((), int), first, first, clock[order[0]])
    _, directions = jax.lax.scan(step, start, (degc[order], clock[order]))
    both = jnp.any(directions > 0) & jnp.any(directions < 0)
    return jnp.zeros_like(degc).at[order].set(jnp.where(both, directions, 0).astype(degc.dtype))


def _polynomial(axis: str, parameter: str, order: int) -> Effect:
    """The dependence of a bias or a scale factor on the temperature by powers 1 to `order`."""
    number, of_scale = AXES.index(axis), parameter == "scale factor"
    id = f"{'scale' if of_scale else 'bias'}_temperature_{_ORDERS[order]}.{axis}"
    base, powers = ("1" if of_scale else "g"), [int(of_scale and k == number) for k in range(3)]

    def make(where: Where) -> tuple[Link, ...]:
        names = [id, *(f"{id}^{power}" for power in range(2, order + 1))]
        units = [f"{base}/degC", *(f"{base}/degC^{power}" for power in range(2, order + 1))]
        sizes = (
            coefficients(name, unit=unit, scale=_TYPICAL / _SPAN_DEGC**lower)
            for lower, (name, unit) in enumerate(zip(names, units, strict=True))
        )
        return (TemperaturePolynomial(tuple(sizes), number, of_scale),)

    return Effect(
        id,
        f"{parameter} by powers 1 to {order} of temperature_degc - {REFERENCE_DEGC:g}",
        "(mg/g)/degC" if of_scale else "mg/degC",
        0.1,
        f"The {parameter} of the {axis} axis follows the temperature by a polynomial of {_ORDINALS[order]} order.",
        "Apply the temperature terms of the extended calibration, or keep the temperature constant; measure a further soak "
        "between two of the others as a check.",
        f"IEEE 1293 ({parameter} temperature sensitivity, {_ORDINALS[order]} order)",
        make,
        needs=("temperature_degc",),
        forms=tuple(
            [
                {"axis": axis, "powers": powers, "degc_power": power, "reference_degc": REFERENCE_DEGC}
                for power in range(1, order + 1)
            ]
        ),
        weight=_weight(parameter, order),
        least_soaks=order + 1,
    )


def _weight(parameter: str, order: int) -> float:
    """Prior weight. On one axis a bias of second order is `bias_temperature` with `bias_temperature_square`, which leads."""
    if parameter == "bias" and order == 2:
        return _SAME_AS_PAIR
    return RARE if order <= 3 else HIGHER_ORDER


def _hysteresis(axis: str) -> Effect:
    return output_effect(
        f"bias_hysteresis.{axis}",
        axis,
        lambda u, where: reached_from(where),
        unit="mg",
        typical=0.1,
        physics="bias +K if the temperature of the position was reached upwards, -K if downwards",
        needs=("time_s", "temperature_degc"),
        pauses="any",
        cause=f"The bias of the {axis} axis at one temperature differs after warming and after cooling (thermal hysteresis).",
        advice="Approach each temperature from the same side, as in use; measure the soaks again in the reverse order, which "
        "separates hysteresis from drift.",
        source="IEEE 1293 (thermal hysteresis of the bias)",
        weight=RARE,
        not_held=OF_BRANCH,
    )


# The linear dependence is an entry of its own.
ENTRIES = (
    *(_polynomial(axis, "bias", order) for order in _ORDERS for axis in AXES),
    *(_polynomial(axis, "scale factor", order) for order in _ORDERS for axis in AXES),
    *(_hysteresis(axis) for axis in AXES),
)
