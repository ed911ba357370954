"""Effects of temperature over a wide range: parameters that follow it by a polynomial, hysteresis of the bias, and lag."""

from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from tumblecal.chain import Link, Parameter, Place, State, Where, coefficients
from tumblecal.effects.added_terms import output_effect
from tumblecal.effects.effect import HIGHER_ORDER, OF_BRANCH, OF_PATH, RARE, Effect
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
# Start values of the time constant of a lag, in median steps between positions, and their prior weights: a short lag is a bias
# by the rate of change, which is the simpler explanation.
_LAG_STEPS, _LAG_SHARES = (1.5, 5.0, 15.0), (0.5, 1.0, 1.0)
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
    degc = jnp.asarray(where.temperature_degc)
    order, clock = _by_clock(where)
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


def _by_clock(where: Where) -> tuple[Array, Array]:
    """The order of the positions by time, clock by clock, and the clock of each position."""
    time = jnp.asarray(where.time_s)
    clock = jnp.asarray(where.index("clock")) if where.clocks > 1 else jnp.zeros(len(time), int)
    return jnp.lexsort((time, clock)), clock


def lag_of(where: Where, tau: Array) -> Array:
    """The thermometer less the sensor, degC, if the sensor follows the thermometer with the time constant tau.

    tau: one value or a copy of it for each position, s.

    `d lag/dt = dT/dt - lag/tau`, solved exactly for a temperature that is linear between positions; zero at the first position
    by each clock. It is 0 everywhere if the temperature did not change in both directions: the lag is then a part of the
    dependence on temperature.
    """
    degc, time = jnp.asarray(where.temperature_degc), jnp.asarray(where.time_s)
    order, clock = _by_clock(where)
    same, both = jnp.diff(clock[order]) == 0, jnp.any(reached_from(where) != 0)
    passed, rises = (jnp.where(same & both, jnp.diff(column[order]), 0.0) for column in (time, degc))
    taus = jnp.broadcast_to(tau, degc.shape)[order[1:]]
    return jnp.zeros_like(degc).at[order[1:]].set(_lags_after(taus, passed, rises, jnp.where(same, 1.0, 0.0)))


@jax.custom_jvp
def _lags_after(taus: Array, passed: Array, rises: Array, same: Array) -> Array:
    """The lag after each of several rises of the temperature, degC, which took so long (s); `taus`: copies of one value;
    `same`: 0 where another clock begins, otherwise 1."""
    return _recursion(taus[0], passed, rises, same)


@_lags_after.defjvp
def _changed_lags(values, changes):
    # Each copy changes the lag at its position: the Jacobian is then that of a link without memory.
    (taus, *columns), (change, *_) = values, changes
    lags, slopes = jax.jvp(lambda tau: _recursion(tau, *columns), (taus[0],), (jnp.ones_like(taus[0]),))
    return lags, slopes * change


def _recursion(tau: Array, passed: Array, rises: Array, same: Array) -> Array:
    share = passed / tau
    # (1 - exp(-x))/x, which is 1 at 0.
    mean = jnp.where(share > 0, -jnp.expm1(-share) / jnp.where(share > 0, share, 1.0), 1.0)

    def step(lag, now):
        lag = now[0] * lag + now[1]
        return lag, lag

    return jax.lax.scan(step, jnp.zeros_like(tau), (same * jnp.exp(-share), rises * mean))[1]


class TemperatureLag(Link):
    """`A_axis += (bias + scale * u_axis) * lag` with one time constant; the lag is that of `lag_of`."""

    place: ClassVar[Place] = Place.READING
    bias: Parameter
    scale: Parameter
    tau: Parameter

    def __call__(self, state: State, where: Where) -> State:
        lag = lag_of(where, jnp.asarray(self.tau.at(where)[0]))
        sizes = zip(state.reading, state.f, self.bias.at(where), self.scale.at(where), strict=True)
        return eqx.tree_at(
            lambda s: s.reading, state, tuple([reading + (bias + scale * u) * lag for reading, u, bias, scale in sizes])
        )


def _lags(where: Where) -> tuple[Link, ...]:
    step = float(np.median(np.diff(np.sort(np.asarray(where.time_s))))) or 1.0
    links = []
    for steps in _LAG_STEPS:
        bias, scale = (
            coefficients(f"temperature_lag_{name}", AXES, unit=unit, scale=_TYPICAL)
            for name, unit in (("bias", "g/degC"), ("scale", "1/degC"))
        )
        tau = coefficients("temperature_lag_tau", unit="s", scale=steps * step)
        links.append(TemperatureLag(bias, scale, replace(tau, value=np.array([[steps * step]]))))
    return tuple(links)


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
        # On one axis a bias of second order is `bias_temperature` with `bias_temperature_square`, which leads.
        weight=_SAME_AS_PAIR if parameter == "bias" and order == 2 else RARE if order <= 3 else HIGHER_ORDER,
        least_soaks=order + 1,
    )


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
    Effect(
        "temperature_lag",
        "per axis (bias + scale u) (thermometer - sensor), the sensor following the thermometer with one time constant",
        "mg/degC",
        0.1,
        "The sensor follows the thermometer with a time constant (thermal lag): bias and scale factor are those of an earlier "
        "temperature.",
        "Put the thermometer on the sensor, change the temperature more slowly, or measure in soaks of several time constants.",
        "IEEE 1293 (temperature gradient sensitivity)",
        _lags,
        needs=("time_s", "temperature_degc"),
        weight=RARE,
        shares=_LAG_SHARES,
        pauses="any",
        not_held=OF_PATH,
        # On a ramp with few positions a lag of seven coefficients is a function of the attitude, as powers of temperature are.
        least_soaks=3,
    ),
)
